// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Several tools in one field: each tool's result is that of a field with it alone, bit for bit, in streams of scans,
/// on any number of threads, with a budget, after a resume, on every backend; and the best tool follows its rule.
#include "accessvdb/tool_spec.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <string>

#include "accessvdb/access_map.h"
#include "accessvdb/batch_query.h"
#include "accessvdb/device_view.h"
#include "accessvdb/error.h"
#include "accessvdb/saved_state.h"
#include "parity/random_world.h"
#include "property/several_tools.h"
#include "support/determinism_support.h"
#include "support/scratch_folder.h"

namespace accessvdb::test {
namespace {

/// The field of each tool alone.
std::vector<AccessibilityField> aloneOf(const std::vector<ToolSpec>& tools, const FieldParams& params) {
  std::vector<AccessibilityField> fields;
  for (const ToolSpec& tool : tools) fields.emplace_back(tool.tool, toolParams(tool, params));
  return fields;
}

bool inOrder(const SurfacePoint& a, const SurfacePoint& b, int limit_a, int limit_b) {
  const auto stage = [](const SurfacePoint& p) {
    if (p.label == PointLabel::Unscored && p.reason == PointReason::Confidence) return 4;  // it may yet be reached
    if (p.reason == PointReason::Tool) return 3;
    if (p.reason == PointReason::Arm || p.reason == PointReason::Unknown) return 2;
    return p.reason == PointReason::Unseen ? 1 : 0;
  };
  if (stage(a) != stage(b)) return stage(a) > stage(b);
  if (stage(a) != 3) return true;
  return std::uint64_t{a.score} * static_cast<std::uint64_t>(limit_b) <=
         std::uint64_t{b.score} * static_cast<std::uint64_t>(limit_a);
}

/// What the merged point must be, from the points of each tool, written down anew.
void expectMerged(const SurfacePoint& merged, const std::vector<SurfacePoint>& each, const std::vector<int>& limits) {
  std::uint32_t mask = 0;
  for (std::size_t k = 0; k < each.size(); ++k) {
    if (each[k].label == PointLabel::Accessible) mask |= 1u << k;
  }
  ASSERT_EQ(merged.tools, mask);
  ASSERT_LT(merged.tool, each.size());
  ASSERT_TRUE(sameVerdict(merged, each[merged.tool])) << text(merged) << "; " << text(each[merged.tool]);
  ASSERT_EQ(merged.orientation_WT.coeffs(), each[merged.tool].orientation_WT.coeffs());
  for (std::size_t k = 0; k < each.size(); ++k) {
    if (mask != 0) {
      ASSERT_FALSE(k < merged.tool && each[k].label == PointLabel::Accessible);
      continue;
    }
    const std::size_t best = merged.tool;
    if (k < best) {  // an earlier tool must have been strictly worse
      ASSERT_FALSE(inOrder(each[k], each[best], limits[k], limits[best])) << k << " came as close as " << best;
    } else {
      ASSERT_TRUE(inOrder(each[best], each[k], limits[best], limits[k])) << k << " came closer than " << best;
    }
  }
}

/// @return points at which another tool than the first stands
std::size_t expectTogetherAsAlone(const AccessibilityField& together, const std::vector<AccessibilityField>& alone) {
  std::vector<FieldSnapshot> each;
  std::vector<int> limits;
  for (std::size_t k = 0; k < alone.size(); ++k) {
    SCOPED_TRACE("tool " + std::to_string(k));
    each.push_back(alone[k].snapshot());
    limits.push_back(alone[k].collisionLimit());
    EXPECT_EQ(together.collisionLimit(k), limits.back());
    expectSame(together.toolSnapshot(k), each.back());
    if (testing::Test::HasFatalFailure()) return 0;
  }
  std::size_t others = 0;
  const FieldSnapshot merged = together.snapshot();
  EXPECT_EQ(merged.points.size(), each.front().points.size());
  for (std::size_t n = 0; n < merged.points.size(); ++n) {
    std::vector<SurfacePoint> of_each;
    for (const FieldSnapshot& field : each) of_each.push_back(field.points[n]);
    expectMerged(merged.points[n], of_each, limits);
    if (testing::Test::HasFatalFailure()) return 0;
    others += merged.points[n].tool > 0 ? 1 : 0;
  }
  return others;
}

/// @param every  scans of an update
void expectStreamAsAlone(const std::vector<ToolSpec>& tools, const FieldParams& params, int every) {
  AccessibilityField together(tools, params);
  std::vector<AccessibilityField> alone = aloneOf(tools, params);
  const std::vector<Scan> scans = wallScans(7, 9, 900);
  std::size_t others = 0;
  for (std::size_t n = 0; n < scans.size(); ++n) {
    const double stamp_s = 4.0 * static_cast<double>(n);
    together.integrateScan(scans[n].points_S, scans[n].T_W_S, stamp_s);
    for (AccessibilityField& field : alone) field.integrateScan(scans[n].points_S, scans[n].T_W_S, stamp_s);
    if (n % static_cast<std::size_t>(every) != 0) continue;
    together.update();
    for (AccessibilityField& field : alone) field.update();
    SCOPED_TRACE("scan " + std::to_string(n));
    others = expectTogetherAsAlone(together, alone);
    if (testing::Test::HasFatalFailure()) return;
  }
  EXPECT_GT(others, 20u);
  EXPECT_GT(together.snapshot().count(PointLabel::Accessible), 50u);
}

TEST(SeveralTools, AreEachAsAloneInAStream) {
  for (const int threads : {1, 2}) {
    SCOPED_TRACE(threads);
    FieldParams params = paramsAt(0.04);
    params.threads = threads;
    expectStreamAsAlone(threeTools(), params, 1);
  }
}

/// Free space ages between the scans, and time passes without any.
TEST(SeveralTools, AreEachAsAloneWhereTheMapForgets) {
  FieldParams params = paramsAt(0.04);
  params.change.mode = ChangeMode::Full;
  params.change.free_for_s = 15;
  expectStreamAsAlone(threeTools(), params, 2);

  AccessibilityField together(threeTools(), params);
  std::vector<AccessibilityField> alone = aloneOf(threeTools(), params);
  const std::vector<Scan> scans = wallScans(7, 4, 900);
  const auto at = [&](double stamp_s, std::span<const Eigen::Vector3f> points_S, const Eigen::Isometry3d& T_W_S) {
    together.integrateScan(points_S, T_W_S, stamp_s);
    for (AccessibilityField& field : alone) field.integrateScan(points_S, T_W_S, stamp_s);
  };
  for (const Scan& scan : scans) at(1, scan.points_S, scan.T_W_S);
  together.update();
  for (AccessibilityField& field : alone) field.update();
  const std::uint64_t before = together.snapshot().count(PointLabel::Accessible);
  EXPECT_GT(before, 20u);
  at(100, {}, scans.front().T_W_S);
  together.update();
  for (AccessibilityField& field : alone) field.update();
  expectTogetherAsAlone(together, alone);
  EXPECT_EQ(together.snapshot().count(PointLabel::Accessible), 0u);
}

TEST(SeveralTools, AreEachAsAloneWithABudget) {
  FieldParams params = paramsAt(0.04);
  params.update.budget_points = 150;
  expectStreamAsAlone(threeTools(), params, 2);
}

/// Tools that share directions with one that is not the first.
TEST(SeveralTools, ShareViewsInAnyOrder) {
  const std::vector<ToolSpec> three = threeTools();
  const std::vector<ToolSpec> tools = {three[0], spec(armTool(), OrientationSet::sphere(20), 5, "arm_too"), three[1],
                                       three[2]};
  expectStreamAsAlone(tools, paramsAt(0.05), 1);
}

TEST(SeveralTools, AreEachAsAloneInRandomWorlds) {
  constexpr std::array<const char*, 4> kSets = {"yaw", "yaw", "sphere:30", "pitch:-30:30:10"};
  std::size_t reached = 0, blocked = 0;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    SCOPED_TRACE(seed);
    Random random(900 + seed);
    FieldParams params = randomParams(random);
    params.update.policy = UpdatePolicy::Exact;
    params.approach.viewpoints = params.approach.coarse_to_fine = false;
    params.approach.num_directions = std::min(params.approach.num_directions, 36);  // fits pitch:-30:30:10
    params.backend = testedBackend();
    params.threads = 1 + static_cast<int>(seed % 2);
    std::vector<ToolSpec> tools;
    for (int k = 1 + random.below(4); k >= 0; --k) {
      const OrientationSet set = OrientationSet::parse(kSets[static_cast<std::size_t>(random.below(4))]);
      tools.push_back(spec(randomTool(random, params.tsdf.voxel_size_m), set, random.below(12) - 1));
    }
    AccessibilityField together(tools, params);
    std::vector<AccessibilityField> alone = aloneOf(tools, params);
    for (const RayScan& scan : randomScans(random, params.tsdf.voxel_size_m)) {
      together.integrateRays(scan.points_W, scan.origins_W);
      for (AccessibilityField& field : alone) field.integrateRays(scan.points_W, scan.origins_W);
      together.update();
      for (AccessibilityField& field : alone) field.update();
    }
    static_cast<void>(expectTogetherAsAlone(together, alone));
    if (HasFatalFailure()) return;
    const FieldSnapshot scratch = together.evaluateFromScratch(), now = together.snapshot();
    for (std::size_t n = 0; n < now.points.size(); ++n) {
      ASSERT_EQ(now.points[n].tools, scratch.points[n].tools) << n;
      ASSERT_EQ(now.points[n].label, scratch.points[n].label) << n;
      if (now.points[n].label == PointLabel::Accessible) {
        ASSERT_EQ(now.points[n].tool, scratch.points[n].tool) << n;
        ASSERT_EQ(now.points[n].direction, scratch.points[n].direction) << n;
      }
    }
    reached += now.count(PointLabel::Accessible);
    blocked += now.count(PointLabel::Blocked);
  }
  EXPECT_GT(reached, 500u);
  EXPECT_GT(blocked, 500u);
}

/// The same beside the next scan.
TEST(SeveralTools, UpdateBesideTheNextScan) {
  AccessibilityField together(threeTools(), paramsAt(0.05));
  std::vector<AccessibilityField> alone = aloneOf(threeTools(), paramsAt(0.05));
  UpdateTicket ticket;
  for (const Scan& scan : wallScans(3, 5, 700)) {
    together.integrateScan(scan.points_S, scan.T_W_S);
    ticket = together.updateAsync();
    for (AccessibilityField& field : alone) {
      field.integrateScan(scan.points_S, scan.T_W_S);
      field.update();
    }
  }
  ticket.wait();
  EXPECT_GT(expectTogetherAsAlone(together, alone), 20u);
}

TEST(SeveralTools, AddingOneNeverTakesAccessAway) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Random random(300 + seed);
    FieldParams params = randomParams(random);
    params.update.policy = UpdatePolicy::Exact;
    params.approach.viewpoints = params.approach.coarse_to_fine = false;
    params.backend = testedBackend();
    std::vector<ToolSpec> more;
    for (int k = 0; k < 4; ++k) {
      more.push_back(spec(randomTool(random, params.tsdf.voxel_size_m), params.approach.orientations, random.below(9)));
    }
    const std::vector<ToolSpec> some(more.begin(), more.begin() + 1 + random.below(3));
    AccessibilityField few(some, params), many(more, params);
    for (const RayScan& scan : randomScans(random, params.tsdf.voxel_size_m)) {
      few.integrateRays(scan.points_W, scan.origins_W);
      many.integrateRays(scan.points_W, scan.origins_W);
    }
    few.update();
    many.update();
    const FieldSnapshot before = few.snapshot(), after = many.snapshot();
    for (std::size_t n = 0; n < before.points.size(); ++n) {
      if (before.points[n].label != PointLabel::Accessible) continue;
      ASSERT_EQ(after.points[n].label, PointLabel::Accessible) << seed << ", point " << n;
      if (some.size() > 1) {
        ASSERT_EQ(after.points[n].tools & before.points[n].tools, before.points[n].tools);
      }
    }
  }
}

/// One tool in a list is that tool: no mask, the same bits.
TEST(SeveralTools, OneInAListIsOneAlone) {
  FieldParams params = paramsAt(0.05);
  params.scoring.max_collisions = 12;
  params.approach.orientations = OrientationSet::sphere(20);
  AccessibilityField one({spec(armTool(), OrientationSet::sphere(20), 12)}, paramsAt(0.05)), alone(armTool(), params);
  for (const Scan& scan : wallScans(5, 4, 700)) {
    one.integrateScan(scan.points_S, scan.T_W_S);
    alone.integrateScan(scan.points_S, scan.T_W_S);
  }
  one.update();
  alone.update();
  expectSame(one.snapshot(), alone.snapshot());
  for (const SurfacePoint& point : one.snapshot().points) ASSERT_EQ(point.tools, 0u);
  EXPECT_EQ(one.params().describe(), alone.params().describe());
}

/// -1 is stricter than every other limit, 0 is the rule.
TEST(SeveralTools, LimitsAreTheirOwn) {
  const std::vector<ToolSpec> tools = {spec(armTool(), OrientationSet::yaw(), -1, "none"),
                                       spec(armTool(), OrientationSet::yaw(), 0, "rule"),
                                       spec(armTool(), OrientationSet::yaw(), 1000, "many")};
  AccessibilityField field(tools, paramsAt(0.05));
  for (const Scan& scan : wallScans(5, 4, 900)) field.integrateScan(scan.points_S, scan.T_W_S);
  field.update();
  EXPECT_EQ(field.collisionLimit(0), 1);
  EXPECT_GT(field.collisionLimit(1), 1);
  EXPECT_EQ(field.collisionLimit(2), 1001);
  std::array<std::size_t, 3> reached = {};
  for (const SurfacePoint& point : field.snapshot().points) {
    const std::uint32_t mask = point.tools;
    for (std::size_t k = 0; k < 3; ++k) reached[k] += mask >> k & 1;
    ASSERT_TRUE((mask & 1) == 0 || (mask & 6) == 6) << mask;
    ASSERT_TRUE((mask & 2) == 0 || (mask & 4) == 4) << mask;
  }
  EXPECT_LT(reached[0], reached[1]);
  EXPECT_LT(reached[1], reached[2]);
  for (const SurfacePoint& point : field.toolSnapshot(0).accessible()) ASSERT_EQ(point.score, 0);
}

/// Every interface shows the best tool.
TEST(SeveralTools, AreWhatUsersSee) {
  const std::vector<ToolSpec> tools = threeTools();
  AccessibilityField field(tools, paramsAt(0.04));
  for (const Scan& scan : wallScans(5, 5, 1200)) field.integrateScan(scan.points_S, scan.T_W_S);
  field.update();
  const FieldSnapshot snapshot = field.snapshot();
  if (testedBackend() == BackendKind::Cuda) GTEST_SKIP() << "compares arrays in host memory";
  const DeviceView view = field.hostView();
  const BatchQuery query = field.batchQuery();
  std::size_t others = 0;
  for (const SurfacePoint& point : snapshot.points) {
    const auto at = field.pointAt(point.position_W);
    ASSERT_TRUE(at);
    ASSERT_TRUE(sameVerdict(*at, point));
    ASSERT_EQ(at->tool, point.tool);
    ASSERT_EQ(at->tools, point.tools);
    PointAnswer answer;
    query.at({&point.position_W, 1}, {&answer, 1});
    ASSERT_EQ(answer.label, point.label);
    ASSERT_EQ(answer.reason, point.reason);
    ASSERT_EQ(answer.score, point.score);
    ASSERT_EQ(answer.direction_W, point.direction_W);
    ASSERT_EQ(view.points.label[point.id], point.label);
    ASSERT_EQ(view.points.score[point.id], point.score);
    ASSERT_TRUE(same(view.points.stability[point.id], point.stability));
    float direction[3];
    ASSERT_EQ(view.directionOf(point.id, direction), point.direction != kNoDirection);
    ASSERT_LT((Eigen::Vector3f(direction) - point.direction_W).norm(), 1e-6f);
    if (point.tool > 0 && point.direction != kNoDirection) ++others;
  }
  EXPECT_GT(others, 20u);
  // The access map of each tool agrees with its own label.
  std::size_t asked = 0;
  for (std::size_t n = 0; n < snapshot.points.size() && asked < 40; n += 37) {
    const SurfacePoint& point = snapshot.points[n];
    if (point.label == PointLabel::Unscored) continue;
    for (std::size_t k = 0; k < tools.size(); ++k) {
      const auto map = field.accessMap(point.position_W, k);
      ASSERT_TRUE(map);
      ASSERT_EQ(map->collision_limit, field.collisionLimit(k));
      ASSERT_EQ(map->directions.size(), static_cast<std::size_t>(tools[k].orientations.count(180)));
      ASSERT_EQ(map->reasons()[0] > 0, (point.tools >> k & 1) != 0) << "tool " << k << ", point " << n;
    }
    ++asked;
  }
  EXPECT_THROW(static_cast<void>(field.accessMap({0, 0, 0}, 3)), InvalidArgument);
  EXPECT_THROW(static_cast<void>(field.toolSnapshot(3)), InvalidArgument);
}

TEST(SeveralTools, GoOnFromAStateOfAMapThatForgets) {
  const ScratchFolder folder;
  const std::vector<Scan> scans = wallScans(9, 8, 900);
  FieldParams params = paramsAt(0.05);
  params.change.mode = ChangeMode::Full;
  params.change.free_for_s = 15;
  AccessibilityField whole(threeTools(), params), first(threeTools(), params);
  const auto add = [&](AccessibilityField& field, std::size_t n) {
    field.integrateScan(scans[n].points_S, scans[n].T_W_S, 4.0 * static_cast<double>(n));
  };
  for (std::size_t n = 0; n < scans.size(); ++n) add(whole, n);
  for (std::size_t n = 0; n < 5; ++n) add(first, n);
  const auto file = folder.path() / "state";
  first.saveState(file);
  AccessibilityField second = AccessibilityField::loadState(file, threeTools(), testedBackend());
  for (std::size_t n = 5; n < scans.size(); ++n) add(second, n);
  whole.update();
  second.update();
  for (std::size_t k = 0; k < 3; ++k) expectSame(second.toolSnapshot(k), whole.toolSnapshot(k));
  second.saveState(folder.path() / "second");
  whole.saveState(folder.path() / "whole");
  const auto bytesOf = [&](const char* name) {
    std::ifstream in(folder.path() / name, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(in), {});
  };
  EXPECT_GT(bytesOf("whole").size(), 1000u);
  EXPECT_TRUE(bytesOf("second") == bytesOf("whole"));
}

TEST(SeveralTools, GoOnFromASavedState) {
  const ScratchFolder folder;
  const std::vector<Scan> scans = wallScans(9, 6, 900);
  AccessibilityField whole(threeTools(), paramsAt(0.05)), first(threeTools(), paramsAt(0.05));
  for (std::size_t n = 0; n < scans.size(); ++n) {
    whole.integrateScan(scans[n].points_S, scans[n].T_W_S);
    if (n < 3) first.integrateScan(scans[n].points_S, scans[n].T_W_S);
  }
  const auto file = folder.path() / "state";
  first.saveState(file);
  const SavedState saved = inspectState(file);
  ASSERT_EQ(saved.tools.size(), 3u);
  EXPECT_EQ(saved.tools[1].name, "pencil");
  EXPECT_EQ(saved.tools[1].orientations, "sphere:20");
  EXPECT_EQ(saved.tools[1].max_collisions, -1);
  AccessibilityField second = AccessibilityField::loadState(file, threeTools(), testedBackend());
  for (std::size_t n = 3; n < scans.size(); ++n) second.integrateScan(scans[n].points_S, scans[n].T_W_S);
  whole.update();
  second.update();
  expectSame(second.snapshot(), whole.snapshot());
  for (std::size_t k = 0; k < 3; ++k) expectSame(second.toolSnapshot(k), whole.toolSnapshot(k));

  const auto idOf = [&](const std::vector<ToolSpec>& tools) -> std::string {
    try {
      static_cast<void>(AccessibilityField::loadState(file, tools, testedBackend()));
    } catch (const UnusableInput& error) {
      return error.id();
    }
    return "";
  };
  EXPECT_EQ(idOf(threeTools()), "");
  std::vector<ToolSpec> other = threeTools();
  std::swap(other[0], other[2]);
  EXPECT_EQ(idOf(other), "state.tool");
  other = threeTools();
  other[1].max_collisions = 3;
  EXPECT_EQ(idOf(other), "state.tool");
  other = threeTools();
  other[0].orientations = OrientationSet::sphere(30);
  EXPECT_EQ(idOf(other), "state.tool");
  other.pop_back();
  EXPECT_EQ(idOf(other), "state.tool");
  EXPECT_EQ(idOf({threeTools().front()}), "state.tool");
}

}  // namespace
}  // namespace accessvdb::test

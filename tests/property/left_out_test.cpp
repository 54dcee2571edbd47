// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is left out blocks: whatever a field has no place for, its accessible points are among those of a field that
/// takes in everything, after every step.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/batch_query.h"
#include "accessvdb/device_view.h"
#include "accessvdb/error.h"
#include "accessvdb/saved_state.h"
#include "accessvdb/tool_spec.h"
#include "support/determinism_support.h"
#include "support/limited_worlds.h"
#include "support/scratch_folder.h"

namespace accessvdb::test {
namespace {

/// ACCESSVDB_CHANGE_DEVICE=cuda: the limited field is on the GPU.
BackendKind backend() { return backendNamedBy("ACCESSVDB_CHANGE_DEVICE"); }

std::string bytesIn(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

TEST(LeftOut, AccessiblePointsAreAmongThoseOfAFieldThatGrows) {
  LimitCounts counts;
  const std::uint64_t worlds = worldCount(240);
  for (std::uint64_t number = 0; number < worlds; ++number) {
    SCOPED_TRACE("world " + std::to_string(number));
    expectContained(number, backend(), counts);
    if (HasFatalFailure()) return;
  }
  // There was something to lose, and not all was lost.
  EXPECT_GT(counts.left_out, 100 * worlds);
  EXPECT_GT(counts.unlimited - counts.limited, counts.steps);
  EXPECT_GT(counts.limited, counts.steps);
  EXPECT_GT(counts.voxels, 1000 * worlds);
  EXPECT_GT(counts.gone, worlds);
}

/// It ends in nothing wider than itself, so it can touch a flat wall.
ToolGeometry rod() { return boxTool({0, -0.03f, -0.03f}, {0.9f, 0.03f, 0.03f}); }

/// A wall at x = 2 that all scans see, and from scan 10 on a panel 0.8 m before it.
std::vector<Scan> wallThenPanel(int scans) {
  std::mt19937_64 random(7);
  std::vector<Scan> out;
  for (int s = 0; s < scans; ++s) {
    Scan& scan = out.emplace_back();
    scan.T_W_S.translation() = Eigen::Vector3d(0, uniform(random, -0.1, 0.1), uniform(random, -0.1, 0.1));
    for (int i = -30; i < 30; ++i) {
      for (int k = -30; k < 30; ++k) {
        const bool panel = s >= 10 && std::abs(i) < 28 && std::abs(k) < 28;
        const Eigen::Vector3d p_W(panel ? 1.2 : 2, 0.02 * (i + uniform(random, 0, 1)),
                                  0.02 * (k + uniform(random, 0, 1)));
        scan.points_S.push_back((p_W - scan.T_W_S.translation()).cast<float>());
      }
    }
  }
  return out;
}

std::size_t accessibleOnWall(const AccessibilityField& field) {
  const FieldSnapshot now = field.snapshot();
  return static_cast<std::size_t>(std::ranges::count_if(now.points, [](const SurfacePoint& p) {
    return p.label == PointLabel::Accessible && p.position_W.x() > 1.8 && std::abs(p.position_W.y()) < 0.3 &&
           std::abs(p.position_W.z()) < 0.3;
  }));
}

FieldParams panelParams() {
  FieldParams params = limitedWorldParams(2);
  params.backend = backend();
  return params;
}

TEST(LeftOut, AnObstacleThatComesWithTheMapFullBlocks) {
  const std::vector<Scan> scans = wallThenPanel(11);
  for (const std::size_t most : {std::size_t{1} << 17, std::size_t{3}, std::size_t{0}}) {
    SCOPED_TRACE(most);
    AccessibilityField field(rod(), panelParams());
    for (int n = 0; n < 10; ++n) fuse(field, scans[static_cast<std::size_t>(n)], n);
    ASSERT_GT(accessibleOnWall(field), 100u);
    field.stopGrowing(most);
    EXPECT_FALSE(field.grows());
    fuse(field, scans[9], 10);
    EXPECT_GT(accessibleOnWall(field), 100u) << "what is known is not lost";
    fuse(field, scans[10], 11);
    EXPECT_EQ(accessibleOnWall(field), 0u);
  }
}

TEST(LeftOut, EveryViewOfAPointSaysTheSame) {
  const std::vector<Scan> scans = wallThenPanel(11);
  AccessibilityField field(rod(), panelParams());
  for (int n = 0; n < 10; ++n) fuse(field, scans[static_cast<std::size_t>(n)], n);
  // Away from the map, so that the map's facts are what they were: only the points know.
  field.leaveOut(std::vector<Eigen::Vector3d>{{1.9, 0.9, 0}}, 0.1);
  EXPECT_GT(accessibleOnWall(field), 100u) << "labels are as of the last update";
  field.update();
  const FieldSnapshot now = field.snapshot();
  const BatchQuery query = field.batchQuery();
  std::vector<Eigen::Vector3d> places;
  for (const SurfacePoint& point : now.points) places.push_back(point.position_W);
  std::vector<PointAnswer> answers(places.size());
  query.at(places, answers);
  std::size_t withheld = 0;
  for (std::size_t n = 0; n < now.points.size(); ++n) {
    EXPECT_EQ(answers[n].label, now.points[n].label);
    EXPECT_EQ(answers[n].reason, now.points[n].reason);
    EXPECT_EQ(field.pointAt(places[n])->label, now.points[n].label);
    if (now.points[n].label == PointLabel::Unscored && now.points[n].reason == PointReason::Confidence) ++withheld;
  }
  EXPECT_GT(withheld, 100u);
  if (backend() == BackendKind::Cpu) {
    const DeviceView view = field.hostView();
    for (std::size_t n = 0; n < now.points.size(); ++n) ASSERT_EQ(view.points.label[n], now.points[n].label);
  }
}

TEST(LeftOut, ASavedStateGoesOnAsIfThereHadBeenNoStop) {
  const ScratchFolder folder;
  for (const std::uint64_t number : {0, 3, 4, 77, 112}) {
    SCOPED_TRACE(number);
    LimitedWorld world(number);
    AccessibilityField straight(rod(), limitedWorldParams(number));
    const std::size_t most = number == 77 ? 12 : std::size_t{1} << 17;
    for (int n = 0; n < 10; ++n) {
      if (n == 3) straight.stopGrowing(most);
      fuse(straight, world.scan(n), n);
    }
    straight.leaveOut(std::vector<Eigen::Vector3d>{{5, 5, 5}}, 0.3);
    straight.update();
    straight.saveState(folder / "a.avst");
    AccessibilityField loaded = AccessibilityField::loadState(folder / "a.avst", rod(), BackendKind::Cpu, 1);
    loaded.saveState(folder / "b.avst");
    EXPECT_TRUE(bytesIn(folder / "a.avst") == bytesIn(folder / "b.avst"));
    loaded.stopGrowing(most);
    for (int n = 10; n < 14; ++n) {
      const Scan scan = world.scan(n);
      fuse(straight, scan, n);
      fuse(loaded, scan, n);
    }
    const FieldSnapshot as_if = straight.snapshot(), now = loaded.snapshot();
    ASSERT_EQ(as_if.points.size(), now.points.size());
    for (std::size_t n = 0; n < now.points.size(); ++n) {
      ASSERT_EQ(as_if.points[n].label, now.points[n].label) << n;
      if (now.points[n].label == PointLabel::Accessible) {
        ASSERT_EQ(as_if.points[n].score, now.points[n].score) << n;
        ASSERT_EQ(as_if.points[n].direction, now.points[n].direction) << n;
      }
    }
  }
}

/// A post goes. Rays open it, but not beside a thing that was left out: had that been taken in, the verdict could be
/// another.
TEST(LeftOut, WhatIsGoneBesideAThingThatWasLeftOutStaysShut) {
  FieldParams params = limitedWorldParams(8);
  ASSERT_EQ(params.change.mode, ChangeMode::Full);
  params.tsdf.voxel_size_m = 0.04;
  params.change.free_for_s = std::numeric_limits<double>::infinity();
  const auto opened = [&](bool with_thing) {
    std::mt19937_64 random(5);
    const SeenBox wall = {{2, -3, -2}, {2.2, 3, 2}}, post = {{1.15, -0.35, -2}, {1.2, -0.05, 2}},
                  thing = {{1.15, 0.2, -2}, {1.2, 0.5, 2}};
    AccessibilityField field(rod(), params);
    for (int n = 0; n < 40; ++n) {
      if (n == 12) field.stopGrowing();
      const Eigen::Array3d from(uniform(random, -0.02, 0.02), uniform(random, -0.2, 0.2), uniform(random, -0.2, 0.2));
      Scan scan;
      scan.T_W_S.translation() = from.matrix();
      for (int k = 0; k < 2500; ++k) {
        const Eigen::Array3d along = Eigen::Array3d(2, uniform(random, -0.9, 0.9), uniform(random, -0.5, 0.5)) - from;
        double nearest = wall.entry(from, along);
        if (n < 12) nearest = std::min(nearest, post.entry(from, along));
        if (n >= 12 && with_thing) nearest = std::min(nearest, thing.entry(from, along));
        scan.points_S.push_back((nearest * along).matrix().cast<float>());
      }
      const FrameStats stats = field.integrateScan(scan.points_S, scan.T_W_S, 0.1 * n);
      field.update();
      EXPECT_EQ(stats.left_out_returns > 100, n >= 12 && with_thing) << n;
    }
    std::size_t open = 0;
    for (const SurfacePoint& point : field.snapshot().points) {
      if (point.position_W.x() > 1.4 || point.position_W.y() > 0) continue;
      open += field.hostView().collides(point.position_W.data()) ? 0 : 1;
    }
    return open;
  };
  const std::size_t alone = opened(false), beside = opened(true);
  EXPECT_GT(alone, 50u);
  EXPECT_LT(beside, alone / 4);
}

/// A budget delays, and leaves nothing out. But a label whose turn has not come is not certain.
TEST(LeftOut, NoPointIsConfidentWhileOneWaits) {
  FieldParams params = panelParams();
  params.update.budget_points = 40;
  AccessibilityField field(rod(), params);
  const std::vector<Scan> scans = wallThenPanel(10);
  const auto confident = [&] {
    const FieldSnapshot now = field.snapshot();
    return std::ranges::count_if(now.points, [](const SurfacePoint& p) { return p.confident; });
  };
  for (const Scan& scan : scans) field.integrateScan(scan.points_S, scan.T_W_S);
  UpdateStats stats = field.update();
  ASSERT_GT(stats.backlog, 0u);
  EXPECT_GT(field.snapshot().count(PointLabel::Accessible), 0u);
  EXPECT_EQ(confident(), 0);
  while (stats.backlog > 0) stats = field.update();
  EXPECT_GT(confident(), 100);
}

/// With memory again, a return that is fused takes the place of what was left out there.
TEST(LeftOut, AFieldThatGrowsAgainTakesInWhatItSees) {
  const ScratchFolder folder;
  const std::vector<Scan> scans = wallThenPanel(30);
  AccessibilityField field(rod(), panelParams()), unlimited(rod(), panelParams());
  for (int n = 0; n < 30; ++n) fuse(unlimited, scans[static_cast<std::size_t>(n)], n);
  for (int n = 0; n < 10; ++n) fuse(field, scans[static_cast<std::size_t>(n)], n);
  field.stopGrowing();
  for (int n = 10; n < 12; ++n) fuse(field, scans[static_cast<std::size_t>(n)], n);
  field.saveState(folder / "full.avst");
  AccessibilityField again = AccessibilityField::loadState(folder / "full.avst", rod(), backend(), 1);
  EXPECT_TRUE(again.grows());
  EXPECT_EQ(accessibleOnWall(again), 0u);
  const auto onPanel = [&](PointLabel label) {
    const FieldSnapshot now = again.snapshot();
    return std::ranges::count_if(now.points,
                                 [&](const SurfacePoint& p) { return p.position_W.x() < 1.4 && p.label == label; });
  };
  EXPECT_EQ(onPanel(PointLabel::Accessible), 0);
  for (int n = 12; n < 30; ++n) fuse(again, scans[static_cast<std::size_t>(n)], n);
  EXPECT_LE(accessibleOnWall(again), accessibleOnWall(unlimited));
  EXPECT_GT(onPanel(PointLabel::Accessible), 100);
}

TEST(LeftOut, BadPlacesAndRadiiAreRefusedOrNoReturns) {
  AccessibilityField field(rod(), panelParams());
  const std::vector<Scan> scans = wallThenPanel(10);
  for (int n = 0; n < 10; ++n) fuse(field, scans[static_cast<std::size_t>(n)], n);
  const FieldSnapshot before = field.snapshot();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  field.leaveOut(std::vector<Eigen::Vector3d>{{nan, 0, 0}, {0, 1e300, 0}, {0, 0, -1e300 * 1e300}}, 0.1);
  field.update();
  expectSame(before, field.snapshot());
  for (const double radius : {-1.0, nan, 1e7}) EXPECT_THROW(field.leaveOut({}, radius), InvalidArgument);
  FieldParams projective = panelParams();
  projective.backend = BackendKind::Cpu;
  projective.tsdf.region = UpdateRegion::Projective;
  AccessibilityField other(rod(), projective);
  EXPECT_THROW(other.stopGrowing(), InvalidArgument);
  // Far more places than are kept: larger ones in their stead, so the map is closed, not open.
  std::vector<Eigen::Vector3d> many;
  std::mt19937_64 random(1);
  for (int n = 0; n < 100000; ++n) {
    many.emplace_back(uniform(random, -300, 300), uniform(random, -300, 300), uniform(random, -300, 300));
  }
  many.emplace_back(1.9, 0, 0);
  field.leaveOut(many, 0.1);
  field.update();
  EXPECT_EQ(accessibleOnWall(field), 0u);
  EXPECT_LT(field.memoryUse().point_host_bytes, std::uint64_t{300} << 20);
}

}  // namespace
}  // namespace accessvdb::test

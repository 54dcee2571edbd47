// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Free space that rays and the platform make known: labels follow it, and it takes nothing away.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <string>
#include <vector>

#include "accessvdb/access_map.h"
#include "accessvdb/accessibility_field.h"
#include "accessvdb/batch_query.h"
#include "accessvdb/error.h"
#include "accessvdb/scan_io.h"
#include "support/scratch_folder.h"
#include "support/walk_generator.h"

namespace accessvdb {
namespace {

test::WalkGenerator walk() {
  test::WalkOptions options = test::shortWalk(10, 1500);
  options.seed = 4;
  return test::WalkGenerator(options);
}

FieldParams paramsOf(double clear_rays_m, double platform_radius_m) {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.05;
  params.tsdf.min_range_m = 0.5;
  params.tsdf.clear_rays_m = clear_rays_m;
  params.tsdf.platform_radius_m = platform_radius_m;
  params.change.mode = ChangeMode::Off;
  params.backend = BackendKind::Cpu;
  return params;
}

constexpr double kAll = std::numeric_limits<double>::infinity();

void expectEqualToScratch(const AccessibilityField& field) {
  const FieldSnapshot now = field.snapshot(), scratch = field.evaluateFromScratch();
  ASSERT_EQ(now.points.size(), scratch.points.size());
  std::size_t differ = 0;
  for (std::size_t n = 0; n < now.points.size(); ++n) {
    const SurfacePoint &a = now.points[n], &b = scratch.points[n];
    const bool accessible = a.label == PointLabel::Accessible;
    differ += a.label != b.label || (accessible && (a.score != b.score || a.direction != b.direction)) ? 1 : 0;
  }
  EXPECT_EQ(differ, 0U);
}

TEST(ClearRays, ChangeLabelsOnlyWhereADirectionWasUnknown) {
  for (const ChangeMode mode : {ChangeMode::Off, ChangeMode::Block, ChangeMode::Full}) {
    FieldParams params = paramsOf(kAll, 0.3), band = paramsOf(0, 0);
    params.change.mode = band.change.mode = mode;
    AccessibilityField field(ToolGeometry::builtin("builtin:pruner"), params),
        without(ToolGeometry::builtin("builtin:pruner"), band);
    const auto frames = walk();
    for (int n = 0; n < 10; ++n) {
      const auto scan = frames.frame(n);
      field.integrateScan(scan.points_S, scan.T_W_S, 0.1 * n);
      without.integrateScan(scan.points_S, scan.T_W_S, 0.1 * n);
      if (n % 3 != 0) continue;
      field.update();
      without.update();
      expectEqualToScratch(field);
    }
    field.update();
    without.update();
    if (mode != ChangeMode::Off) continue;  // what has gone may also differ by what rays saw
    const std::vector<SurfacePoint> now = field.snapshot().points, before = without.snapshot().points;
    ASSERT_EQ(now.size(), before.size());
    std::size_t lost = 0, unexplained = 0, changed = 0, accessible = 0;
    for (std::size_t n = 0; n < now.size(); ++n) {
      ASSERT_EQ(now[n].position_W, before[n].position_W);
      accessible += before[n].label == PointLabel::Accessible ? 1 : 0;
      lost += before[n].label == PointLabel::Accessible && now[n].label != PointLabel::Accessible ? 1 : 0;
      if (now[n].label == before[n].label) continue;
      ++changed;
      const auto reasons = without.accessMap(before[n].position_W)->reasons();
      unexplained += reasons[static_cast<std::size_t>(PointReason::Unknown)] == 0 ? 1 : 0;
    }
    EXPECT_GT(accessible, 100U);
    EXPECT_EQ(lost, 0U);
    EXPECT_EQ(unexplained, 0U);
    EXPECT_GT(changed, 20U);
  }
}

TEST(ClearRays, WhereThePlatformWasASphereFits) {
  AccessibilityField field(ToolGeometry::builtin("builtin:pencil"), paramsOf(20, 0.4)),
      without(ToolGeometry::builtin("builtin:pencil"), paramsOf(0, 0));
  std::vector<CapsuleQuery> spheres;
  const auto frames = walk();
  for (int n = 0; n < 10; ++n) {
    const auto scan = frames.frame(n);
    field.integrateScan(scan.points_S, scan.T_W_S);
    without.integrateScan(scan.points_S, scan.T_W_S);
    const Eigen::Vector3d q_W = scan.T_W_S.translation();
    spheres.push_back({q_W, q_W, 0.35});
  }
  std::vector<CapsuleAnswer> free(spheres.size()), unknown(spheres.size());
  field.batchQuery().along(spheres, free);
  without.batchQuery().along(spheres, unknown);
  for (std::size_t n = 0; n < spheres.size(); ++n) {
    EXPECT_TRUE(free[n].valid && !free[n].unknown && !free[n].collision) << n;
    EXPECT_TRUE(unknown[n].unknown) << n;
  }
}

TEST(ClearRays, GoOnFromAState) {
  const test::ScratchFolder folder;
  const auto frames = walk();
  const auto take = [&](AccessibilityField& field, int from, int to) {
    for (int n = from; n < to; ++n) {
      const auto scan = frames.frame(n);
      field.integrateScan(scan.points_S, scan.T_W_S);
    }
  };
  AccessibilityField whole(ToolGeometry::builtin("builtin:pencil"), paramsOf(3, 0.3)),
      part(ToolGeometry::builtin("builtin:pencil"), paramsOf(3, 0.3));
  take(whole, 0, 8);
  take(part, 0, 4);
  part.saveState(folder / "state");
  AccessibilityField resumed =
      AccessibilityField::loadState(folder / "state", ToolGeometry::builtin("builtin:pencil"), BackendKind::Cpu, 1);
  EXPECT_EQ(resumed.params().tsdf.clear_rays_m, 3);
  EXPECT_EQ(resumed.params().tsdf.platform_radius_m, 0.3);
  take(resumed, 4, 8);
  whole.saveState(folder / "whole");
  resumed.saveState(folder / "resumed");
  const auto bytesOf = [&](const char* name) {
    std::ifstream in(folder / name, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(in), {});
  };
  EXPECT_GT(bytesOf("whole").size(), 1000U);
  EXPECT_EQ(bytesOf("whole"), bytesOf("resumed"));
}

TEST(ClearRays, AreRefusedWhereTheyWouldBeWrong) {
  const auto subjectOf = [](FieldParams params) {
    try {
      static_cast<void>(params.resolved());
    } catch (const InvalidArgument& error) {
      return error.subject();
    }
    return std::string("nothing");
  };
  EXPECT_EQ(subjectOf(paramsOf(-1, 0)), "clear_rays_m");
  EXPECT_EQ(subjectOf(paramsOf(std::numeric_limits<double>::quiet_NaN(), 0)), "clear_rays_m");
  EXPECT_EQ(subjectOf(paramsOf(0, -1)), "platform_radius_m");
  EXPECT_EQ(subjectOf(paramsOf(0, kAll)), "platform_radius_m");
  EXPECT_EQ(subjectOf(paramsOf(0, 128 * 0.05 + 0.01)), "platform_radius_m");
  EXPECT_EQ(subjectOf(paramsOf(kAll, 128 * 0.05)), "nothing");
  FieldParams tile = paramsOf(5, 0);
  tile.origin_W = {0, 0, 0};
  tile.window = FieldWindow{{0, 0}, {128, 128}};
  EXPECT_EQ(subjectOf(tile), "window");
  FieldParams projective = paramsOf(0, 0.3);
  projective.tsdf.region = UpdateRegion::Projective;
  EXPECT_EQ(subjectOf(projective), "clear_rays_m");
}

/// A recording of others: what carried the sensor is at none of its places unknown, or in anything's way.
TEST(ClearRays, TheSensorsOwnPlacesAreFree) {
  const char* given = std::getenv("ACCESSVDB_TEST_DATA");
  const std::filesystem::path folder =
      std::filesystem::path(given != nullptr ? given : ACCESSVDB_SOURCE_DIR "/../shared/data") / "scans_poses_balm";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no test data: " << folder;
  auto scans = io::ScanSequence::open({.scans = folder, .poses = folder / "poses_tum.txt"});
  FieldParams params = paramsOf(20, 0.4);
  params.tsdf.min_range_m = 0;
  AccessibilityField field(ToolGeometry::builtin("builtin:pruner"), params);
  std::vector<CapsuleQuery> places;
  for (std::size_t step = 0; step < scans.size(); ++step) {
    const io::ScanRecord scan = scans.read(step);
    field.integrateScan(scan.points_S, scan.T_W_S);
    places.push_back({scan.T_W_S.translation(), scan.T_W_S.translation(), 0.35});
  }
  ASSERT_EQ(places.size(), 12U);
  for (const CapsuleAnswer& answer : field.batchQuery().along(places)) EXPECT_TRUE(answer.free());
}

}  // namespace
}  // namespace accessvdb

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// New things block, as a field shows it: labels against a field without, exact updates, saved states, tiles, the
/// mirror of distances, queries; and the time of a field.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/batch_query.h"
#include "accessvdb/device_view.h"
#include "accessvdb/saved_state.h"
#include "accessvdb/tsdf_volume.h"
#include "support/determinism_support.h"
#include "support/scratch_folder.h"

namespace accessvdb::test {
namespace {

constexpr double kVoxel_m = 0.04;

/// ACCESSVDB_CHANGE_DEVICE=cuda: fields are on the GPU, but for those whose mirror is read on the host.
BackendKind backend() { return backendNamedBy("ACCESSVDB_CHANGE_DEVICE"); }

FieldParams paramsOf(ChangeMode mode) {
  FieldParams params;
  params.tsdf.voxel_size_m = kVoxel_m;
  params.tsdf.range_noise_m = 0.01;
  params.change.mode = mode;
  params.backend = backend();
  params.threads = 2;
  params.approach.num_directions = 36;
  return params;
}

/// A wall at x = 2 m, from x = 0; a post comes and goes before it: there in scans 12 .. 19, 30 .. 33, 36, 38, 40 ...
/// The last part flickers.
bool postAt(int scan) { return (scan >= 12 && scan < 20) || (scan >= 30 && scan < 34) || (scan > 34 && scan % 2 == 0); }

std::vector<Eigen::Vector3f> wallAndPost(int scan) {
  std::mt19937_64 random(static_cast<std::uint64_t>(scan) + 100);
  std::vector<Eigen::Vector3f> points;
  for (int n = 0; n < 2500; ++n) {
    const double y = uniform(random, -0.8, 0.8), z = uniform(random, -0.5, 0.5);
    const double post_m = 2 - 3.5 * kVoxel_m, y_at_post = y * post_m / 2;
    const bool hits = postAt(scan) && std::abs(y_at_post - 0.1) < 1.5 * kVoxel_m;
    const double share = (hits ? post_m : 2.0) / 2 + uniform(random, -0.003, 0.003);
    points.emplace_back(static_cast<float>(2 * share), static_cast<float>(y * share), static_cast<float>(z * share));
  }
  return points;
}
constexpr int kScans = 44;

void fuse(AccessibilityField& field, int from, int to) {
  for (int scan = from; scan < to; ++scan) field.integrateScan(wallAndPost(scan), Eigen::Isometry3d::Identity());
}

std::vector<openvdb::Coord> blockedIn(const TsdfVolume& volume) {
  std::vector<openvdb::Coord> blocked;
  const auto weights = volume.weight();
  for (auto voxel = weights->cbeginValueOn(); voxel; ++voxel) {
    if (volume.at(voxel.getCoord()).blocked) blocked.push_back(voxel.getCoord());
  }
  return blocked;
}

/// At every moment; and the map itself keeps its bits.
TEST(ChangingField, NoPointIsAccessibleThatIsNotWithoutVotes) {
  AccessibilityField off(armTool(), paramsOf(ChangeMode::Off)), block(armTool(), paramsOf(ChangeMode::Block));
  std::uint64_t taken = 0, most_blocked = 0;
  for (int scan = 0; scan < kScans; ++scan) {
    fuse(off, scan, scan + 1);
    fuse(block, scan, scan + 1);
    off.update();
    block.update();
    const FieldSnapshot without = off.snapshot(), with = block.snapshot();
    ASSERT_EQ(without.points.size(), with.points.size());
    for (std::size_t n = 0; n < with.points.size(); ++n) {
      const bool free_without = without.points[n].label == PointLabel::Accessible;
      const bool free_with = with.points[n].label == PointLabel::Accessible;
      ASSERT_TRUE(free_without || !free_with) << "scan " << scan << " point " << n;
      taken += free_without && !free_with ? 1 : 0;
      ASSERT_EQ(without.points[n].weight, with.points[n].weight);
    }
    most_blocked = std::max<std::uint64_t>(most_blocked, blockedIn(block.volume()).size());
  }
  EXPECT_EQ(off.volume().memoryBytes() <= block.volume().memoryBytes(), true);
  EXPECT_GT(taken, 100u);
  EXPECT_GT(most_blocked, 50u);
}

/// Labels of both rhythms equal a full evaluation, with votes that come, go and flicker between two updates.
TEST(ChangingField, UpdatesStayExact) {
  FieldSnapshot last[2];
  for (const int every : {1, 7}) {
    AccessibilityField field(armTool(), paramsOf(ChangeMode::Block));
    for (int scan = 0; scan < kScans; ++scan) {
      fuse(field, scan, scan + 1);
      if ((scan + 1) % every != 0 && scan + 1 < kScans) continue;
      field.update();
      const FieldSnapshot now = field.snapshot(), scratch = field.evaluateFromScratch();
      for (std::size_t n = 0; n < now.points.size(); ++n) {
        ASSERT_EQ(now.points[n].label, scratch.points[n].label) << "scan " << scan << " point " << n;
        if (now.points[n].label != PointLabel::Accessible) continue;
        ASSERT_EQ(now.points[n].score, scratch.points[n].score);
        ASSERT_EQ(now.points[n].direction, scratch.points[n].direction);
      }
    }
    last[every == 1 ? 0 : 1] = field.snapshot();
  }
  ASSERT_EQ(last[0].points.size(), last[1].points.size());
  for (std::size_t n = 0; n < last[0].points.size(); ++n) ASSERT_EQ(last[0].points[n].label, last[1].points[n].label);
}

/// A post that stands 3.5 voxels before the wall takes points within six scans; ten scans after it left they are back.
TEST(ChangingField, PointsBehindAPostAreBlockedAndFreeAgain) {
  AccessibilityField off(armTool(), paramsOf(ChangeMode::Off)), block(armTool(), paramsOf(ChangeMode::Block));
  const auto accessibleAfter = [](AccessibilityField& field, int from, int to) {
    fuse(field, from, to);
    field.update();
    return static_cast<double>(field.snapshot().count(PointLabel::Accessible));
  };
  EXPECT_EQ(accessibleAfter(block, 0, 12), accessibleAfter(off, 0, 12));
  EXPECT_LT(accessibleAfter(block, 12, 18), 0.8 * accessibleAfter(off, 12, 18));
  fuse(off, 18, 20);
  fuse(block, 18, 20);
  EXPECT_GT(blockedIn(block.volume()).size(), 30u);
  EXPECT_GT(accessibleAfter(block, 20, 30), 0.95 * accessibleAfter(off, 20, 30));
}

/// A state in the middle of votes goes on as if there had been no stop.
TEST(ChangingField, ASavedStateKeepsVotesAndTime) {
  const ScratchFolder folder;
  for (const int stop : {13, 14, 18, 23, 37}) {
    SCOPED_TRACE(stop);
    FieldParams params = paramsOf(ChangeMode::Block);
    params.mirror_distance = true;
    AccessibilityField straight(armTool(), params);
    fuse(straight, 0, stop);
    straight.integrateScan(wallAndPost(stop), Eigen::Isometry3d::Identity(), 17.25);
    straight.saveState(folder / "a.avst");
    EXPECT_EQ(inspectState(folder / "a.avst").latest_stamp_s, 17.25);
    AccessibilityField loaded = AccessibilityField::loadState(folder / "a.avst", armTool(), backend(), 1);
    EXPECT_EQ(loaded.latestStamp_s(), 17.25);
    EXPECT_EQ(loaded.params().change.mode, ChangeMode::Block);
    EXPECT_EQ(blockedIn(loaded.volume()), blockedIn(straight.volume()));
    for (int scan = stop + 1; scan < kScans; ++scan) {
      fuse(straight, scan, scan + 1);
      fuse(loaded, scan, scan + 1);
      ASSERT_EQ(blockedIn(loaded.volume()), blockedIn(straight.volume())) << scan;
    }
    straight.update();
    loaded.update();
    expectSame(straight.snapshot(), loaded.snapshot());
    straight.saveState(folder / "b.avst");
    loaded.saveState(folder / "c.avst");
    EXPECT_EQ(inspectState(folder / "b.avst").sha256, inspectState(folder / "c.avst").sha256);
  }
}

/// Whatever hands out a distance says 0 where the facts say "collides".
TEST(ChangingField, BlockedVoxelsHaveNoDistance) {
  FieldParams params = paramsOf(ChangeMode::Block);
  params.mirror_distance = true;
  params.backend = BackendKind::Cpu;
  AccessibilityField field(armTool(), params);
  std::size_t checked = 0, released = 0;
  std::vector<openvdb::Coord> before;
  for (int scan = 0; scan < kScans; ++scan) {
    fuse(field, scan, scan + 1);
    const std::vector<openvdb::Coord> blocked = blockedIn(field.volume());
    const auto distances = field.volume().distance();
    const DeviceView view = field.hostView();
    std::vector<Eigen::Vector3d> positions_W;
    std::vector<CapsuleQuery> capsules;
    const auto positionOf = [&](const openvdb::Coord& ijk) -> Eigen::Vector3d {
      return field.origin_W() + kVoxel_m * Eigen::Vector3d(ijk.x(), ijk.y(), ijk.z());
    };
    for (const openvdb::Coord& ijk : blocked) {
      positions_W.push_back(positionOf(ijk));
      capsules.push_back({positions_W.back(), positions_W.back(), 0.001});
      EXPECT_EQ(distances->tree().getValue(ijk), 0.0f);
      ASSERT_EQ(view.distanceAt(positions_W.back().data()), 0.0f);
    }
    for (const openvdb::Coord& ijk : before) {
      const VoxelState state = field.volume().at(ijk);
      ASSERT_EQ(view.distanceAt(positionOf(ijk).data()), state.distance_m) << "also after it was released";
      released += state.blocked ? 0 : 1;
    }
    const BatchQuery query = field.batchQuery();
    std::vector<PointAnswer> answers(positions_W.size());
    query.at(positions_W, answers);
    for (const PointAnswer& answer : answers) EXPECT_EQ(answer.distance_m, 0.0f);
    for (const CapsuleAnswer& answer : query.along(capsules)) {
      EXPECT_TRUE(answer.collision);
      EXPECT_LT(answer.min_distance_m, 1e-6f);  // the axis is relative to the capsule's own anchor
    }
    checked += blocked.size();
    before = blocked;
  }
  EXPECT_GT(checked, 200u);
  EXPECT_GT(released, 20u);
}

TEST(ChangingField, TimeIsTheLatestStampAndNeverRunsBackwards) {
  AccessibilityField field(armTool(), paramsOf(ChangeMode::Block));
  const Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
  const auto points = wallAndPost(0);
  EXPECT_FALSE(field.latestStamp_s());
  field.integrateScan(points, T_W_S);
  field.integrateScan(points, T_W_S, std::numeric_limits<double>::quiet_NaN());
  field.integrateScan(points, T_W_S, std::numeric_limits<double>::infinity());
  EXPECT_FALSE(field.latestStamp_s());
  field.integrateScan(points, T_W_S, -5);
  EXPECT_EQ(field.latestStamp_s(), -5);
  field.integrateScan(points, T_W_S, 10);
  field.integrateScan(points, T_W_S, 3);
  field.integrateScan(points, T_W_S);
  EXPECT_EQ(field.latestStamp_s(), 10);
  const std::vector<Eigen::Vector3d> points_W = {{2, 0, 0}}, origins_W = {{0, 0, 0}};
  field.integrateRays(points_W, origins_W, 12);
  EXPECT_EQ(field.latestStamp_s(), 12);
  // A refused scan changes nothing.
  Eigen::Isometry3d bad = T_W_S;
  bad.translation().x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_ANY_THROW(field.integrateScan(points, bad, 99));
  EXPECT_EQ(field.latestStamp_s(), 12);
}

/// Stamps decide nothing yet, and are no part of a map.
TEST(ChangingField, StampsChangeNoLabel) {
  AccessibilityField with(armTool(), paramsOf(ChangeMode::Block)), without(armTool(), paramsOf(ChangeMode::Block));
  for (int scan = 0; scan < 20; ++scan) {
    with.integrateScan(wallAndPost(scan), Eigen::Isometry3d::Identity(), scan % 3 == 0 ? -1e9 * scan : 1e18 * scan);
    fuse(without, scan, scan + 1);
  }
  with.update();
  without.update();
  expectSame(with.snapshot(), without.snapshot());
}

TEST(ChangingField, OtherRegionsHaveNoVotes) {
  for (const UpdateRegion region : {UpdateRegion::FullCube, UpdateRegion::Projective}) {
    FieldParams params = paramsOf(ChangeMode::Block);
    params.tsdf.region = region;
    EXPECT_EQ(params.resolved().change.mode, ChangeMode::Off);
    EXPECT_EQ(params.resolved().describe().find("\nchange "), std::string::npos);
  }
  EXPECT_EQ(FieldParams::paper(0.01).resolved().change.mode, ChangeMode::Off);
  EXPECT_NE(FieldParams{}.resolved().describe().find("\nchange block\n"), std::string::npos);
}

}  // namespace
}  // namespace accessvdb::test

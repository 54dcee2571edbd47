// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a person takes out of a map that forgets: nothing that was known of it decides what comes after. Compared with
/// fields that never saw it, and with the rules in docs/design/change.md, "By hand".
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/region.h"
#include "accessvdb/tsdf_volume.h"
#include "accessvdb/what_if.h"
#include "support/determinism_support.h"
#include "support/region_worlds.h"
#include "support/scratch_folder.h"

namespace accessvdb::test {
namespace {

constexpr double kVoxel_m = 0.04, kThing_m = 1.2;
/// Its voxels, at 2 m, lie behind its surface: nothing of it is in the way of a tool that touches it.
constexpr double kWall_m = 1.985;

FieldParams forgettingParams() {
  FieldParams params;
  params.tsdf.voxel_size_m = kVoxel_m;
  params.tsdf.range_noise_m = 0.01;
  params.change.mode = ChangeMode::Full;
  params.origin_W = {{0, 0, 0}};
  params.backend = changeBackend();
  params.threads = 2;
  params.approach.num_directions = 36;
  return params;
}

/// What stands before a wall: rays that cross this part of a plane return from it, by chance or all of them.
struct Thing {
  double half_y = 0, half_z = 0;  ///< around y = z = 0
  double returns = 0;             ///< share of the rays; 0: nothing is there
};

/// A sensor near the origin that looks at the wall, each scan from another place.
class Looks {
 public:
  explicit Looks(std::uint64_t seed) : random_(seed) {}

  /// @param half  of the part of the wall that is looked at, metres
  void scan(AccessibilityField& field, const Thing& thing, double half = 0.5, int rays = 1500) {
    Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
    T_W_S.translation() = Eigen::Vector3d(0, uniform(random_, -0.2, 0.2), uniform(random_, -0.2, 0.2));
    const Eigen::Vector3d sensor = T_W_S.translation();
    std::vector<Eigen::Vector3f> points_S;
    for (int n = 0; n < rays; ++n) {
      const Eigen::Vector3d at(kWall_m, uniform(random_, -half, half), uniform(random_, -half, half));
      const Eigen::Vector3d at_thing = sensor + kThing_m / kWall_m * (at - sensor);
      const bool meets = std::abs(at_thing.y()) < thing.half_y && std::abs(at_thing.z()) < thing.half_z;
      const bool hits = uniform(random_, 0, 1) < thing.returns && meets;
      points_S.push_back(((hits ? at_thing : at) - sensor).cast<float>());
    }
    field.integrateScan(points_S, T_W_S, stamp_s_ += 0.1);
  }
  void scans(AccessibilityField& field, int count, const Thing& thing) {
    for (int n = 0; n < count; ++n) scan(field, thing);
  }

 private:
  std::mt19937_64 random_;
  double stamp_s_ = 0;
};

const Thing kBoard = {0.2, 0.2, 1};
bool isWhereTheBoardWas(const Eigen::Vector3d& p_W) {
  return p_W.x() < 1.6 && std::abs(p_W.y()) < 0.25 && std::abs(p_W.z()) < 0.25;
}
Region boardRegion() { return Region::box({1.0, -0.3, -0.3}, {1.5, 0.3, 0.3}); }

bool collides(const AccessibilityField& field, const openvdb::Coord& ijk) {
  const VoxelState state = field.volume().at(ijk);
  return state.weight > 0 && !(state.distance_m >= static_cast<float>(0.5 * kVoxel_m));
}
/// Colliding voxels where the board was, and behind it.
std::size_t blockedVoxels(const AccessibilityField& field) {
  std::size_t count = 0;
  for (int x = 25; x <= 38; ++x) {
    for (int y = -7; y <= 7; ++y) {
      for (int z = -7; z <= 7; ++z) count += collides(field, {x, y, z}) ? 1 : 0;
    }
  }
  return count;
}

/// Opening by rays keeps the confidence of the points around; a removal takes it away, also what was kept before.
TEST(GoneByHand, KeepsNoConfidence) {
  for (const RemovedAs as : {RemovedAs::Free, RemovedAs::Unknown}) {
    AccessibilityField field(armTool(), forgettingParams());
    Looks looks(1);
    looks.scans(field, 30, kBoard);
    std::size_t changed = 0;
    for (int n = 0; n < 60 && changed < 10; ++n) {
      looks.scan(field, {}, 0.5, 200);
      field.update();
      changed = field.snapshot().reasons()[static_cast<std::size_t>(PointReason::Changed)];
    }
    ASSERT_GE(changed, 10u) << "some of the board has gone by evidence, and its neighbours' confidence was kept";
    std::size_t kept = 0;
    for (const SurfacePoint& point : field.snapshot().points) {
      kept += isWhereTheBoardWas(point.position_W) && point.reason != PointReason::Changed ? 1 : 0;
    }
    ASSERT_GE(kept, 10u) << "and some has not";
    field.removeRegion(boardRegion(), as);
    field.update();
    const FieldSnapshot now = field.snapshot();
    for (const SurfacePoint& point : now.points) {
      if (!isWhereTheBoardWas(point.position_W)) continue;
      // All observed voxels around it were taken out.
      EXPECT_LE(point.weight, as == RemovedAs::Free ? 0 : 1);
      EXPECT_EQ(point.label, PointLabel::Unscored);
      if (as == RemovedAs::Free) {
        EXPECT_EQ(point.reason, PointReason::Changed);
      }
    }
    expectExact(field);
  }
}

/// A twig that is met once in 20 rays comes where a solid thing was removed: runs of 60 misses come all the time. The
/// many returns of the thing before must not count as the twig's.
TEST(GoneByHand, WhatComesAfterwardsHasRecordsOfItsOwn) {
  for (const RemovedAs as : {RemovedAs::Free, RemovedAs::Unknown}) {
    AccessibilityField removed(armTool(), forgettingParams()), never(armTool(), forgettingParams());
    Looks looks(2), other(2);
    looks.scans(removed, 60, kBoard);
    other.scans(never, 60, {});
    removed.removeRegion(boardRegion(), as);
    if (as == RemovedAs::Unknown) {  // until rays have opened it
      looks.scans(removed, 20, {});
      other.scans(never, 20, {});
    }
    const Thing twigs = {0.19, 0.19, 0.05};
    Looks of_twigs(3), of_never(3);
    std::size_t twig_points = 0;
    for (int n = 0; n < 400; ++n) {
      of_twigs.scan(removed, twigs, 0.45, 600);
      of_never.scan(never, twigs, 0.45, 600);
      if (n % 50 != 49) continue;
      never.update();
      removed.update();
      for (const SurfacePoint& point : never.snapshot().points) {
        if (point.position_W.x() > 1.6) continue;
        ASSERT_NE(point.reason, PointReason::Changed) << "scan " << n;
        ++twig_points;
        const auto there = removed.pointAt(point.position_W);
        ASSERT_TRUE(there);
        ASSERT_NE(there->reason, PointReason::Changed) << "scan " << n << " at " << point.position_W.transpose();
      }
    }
    EXPECT_GT(twig_points, 200u);
  }
}

/// "Still collides; a ray that sees through it opens it": the person's word is a verdict. As long as it stands for all
/// that, its returns say so, and nothing opens.
TEST(GoneByHand, UnknownOpensByTheFirstRaysThroughIt) {
  for (const bool stands : {false, true}) {
    AccessibilityField field(armTool(), forgettingParams());
    Looks looks(4);
    looks.scans(field, 60, kBoard);
    const std::size_t before = blockedVoxels(field);
    ASSERT_GT(before, 200u);
    const Removal removal = field.removeRegion(Region::box({1.0, -0.3, -0.3}, {1.25, 0.3, 0.3}));
    EXPECT_EQ(removal.flipped_voxels, 0u);
    EXPECT_EQ(blockedVoxels(field), before) << "a removal as unknown opens nothing by itself";
    for (int n = 0; n < 3; ++n) looks.scan(field, stands ? kBoard : Thing{}, 0.5, 6000);
    if (stands) {
      EXPECT_EQ(blockedVoxels(field), before);
    } else {
      EXPECT_LT(blockedVoxels(field), before / 10) << "its shadow, which the box did not hold, opens too";
    }
  }
}

/// A point that was taken out as free comes back with a return, not with a look at what is behind it.
TEST(GoneByHand, APointComesBackByAReturnOnly) {
  AccessibilityField field(armTool(), forgettingParams());
  Looks looks(5);
  // The board is so near the wall that the wall's returns observe its voxels.
  const auto scan = [&](bool board, double shift_m) {
    std::vector<Eigen::Vector3f> points_S;
    for (double y = -0.5; y < 0.5; y += 0.02) {
      for (double z = -0.5; z < 0.5; z += 0.02) {
        const bool hits = board && std::abs(y) < 0.2 && std::abs(z) < 0.2;
        const double x = hits ? kWall_m - 2 * kVoxel_m : kWall_m;
        points_S.emplace_back(float(x), float((y + shift_m) * x / kWall_m), float((z + shift_m) * x / kWall_m));
      }
    }
    field.integrateScan(points_S, Eigen::Isometry3d::Identity());
  };
  for (int n = 0; n < 10; ++n) scan(true, 0.001 * n);
  field.removeRegion(Region::box({1.8, -0.3, -0.3}, {1.96, 0.3, 0.3}), RemovedAs::Free);
  const auto changedAndObserved = [&] {
    field.update();
    std::array<std::size_t, 2> count = {};
    for (const SurfacePoint& point : field.snapshot().points) {
      if (point.position_W.x() > 1.94 || std::abs(point.position_W.y()) > 0.15) continue;
      count[0] += point.reason == PointReason::Changed ? 1 : 0;
      count[1] += point.weight > 0 ? 1 : 0;
    }
    return count;
  };
  const std::size_t gone = changedAndObserved()[0];
  ASSERT_GT(gone, 30u);
  for (int n = 0; n < 5; ++n) scan(false, 0.001 * n);
  EXPECT_EQ(changedAndObserved()[0], gone);
  EXPECT_GT(changedAndObserved()[1], gone / 2) << "the wall's returns observe their voxels again";
  scan(true, 0.002);
  EXPECT_LT(changedAndObserved()[0], gone / 2);
}

/// What a cut would open is what it opens, also where some has gone by evidence; and a saved state goes on as before.
TEST(GoneByHand, WhatIfAndSavedStatesAgree) {
  const ScratchFolder folder;
  std::size_t opened = 0, changed = 0;
  for (std::uint64_t seed = 10; seed < 16; ++seed) {
    FieldParams params = forgettingParams();
    params.scoring.confidence_min = 0.6;
    AccessibilityField field(armTool(), params);
    for (int time = 0; time < 3; ++time) {
      for (const Scan& scan : wallScans(seed, 6, 1200)) field.integrateScan(scan.points_S, scan.T_W_S);
    }
    // Now some of the clutter is not there any more.
    std::mt19937_64 random(seed);
    const auto lookThrough = [&random](std::array<AccessibilityField*, 2> fields) {
      const Eigen::Vector3d sensor(0, uniform(random, -0.2, 1.2), uniform(random, 0.8, 1.2));
      std::vector<Eigen::Vector3f> points_S;
      for (int n = 0; n < 700; ++n) {
        const Eigen::Vector3d at(2, uniform(random, -0.5, 1.5), uniform(random, 0.3, 1.7));
        points_S.push_back((at - sensor).cast<float>());
      }
      for (AccessibilityField* each : fields) {
        if (each != nullptr) each->integrateScan(points_S, Eigen::Isometry3d(Eigen::Translation3d(sensor)));
      }
    };
    for (int n = 0; n < 14; ++n) lookThrough({&field, nullptr});
    field.update();
    const FieldSnapshot before = field.snapshot();
    changed += before.reasons()[static_cast<std::size_t>(PointReason::Changed)];
    const std::vector<Region> regions = {
        Region::box({seed % 2 == 0 ? 1.0 : 1.5, 0.2, 0.2}, {1.9, seed % 3 == 0 ? 0.5 : 0.8, 1.8})};
    const WhatIf what_if = field.whatIf(regions);
    field.removeRegion(regions[0], RemovedAs::Free);
    field.update();
    expectExact(field);
    const FieldSnapshot after = field.snapshot();
    std::vector<std::uint32_t> expected, found;
    for (std::size_t n = 0; n < before.points.size(); ++n) {
      if (before.points[n].label == PointLabel::Blocked && after.points[n].label == PointLabel::Accessible) {
        expected.push_back(before.points[n].id);
      }
    }
    for (const SurfacePoint& point : what_if.opens) {
      found.push_back(point.id);
      EXPECT_EQ(point.weight, after.points[point.id].weight);
    }
    EXPECT_EQ(found, expected);
    opened += expected.size();
    AccessibilityField loaded = copyOf(field, folder);
    expectSame(field.snapshot(), loaded.snapshot());
    for (int n = 0; n < 12; ++n) {
      lookThrough({&field, &loaded});
      if (n % 4 != 3) continue;
      field.update();
      loaded.update();
      expectExact(field);
      expectSame(field.snapshot(), loaded.snapshot());
    }
  }
  EXPECT_GT(opened, 20u);
  EXPECT_GT(changed, 50u);
}

}  // namespace
}  // namespace accessvdb::test

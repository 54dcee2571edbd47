// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Capsules against a walk over all voxels of their box, one look-up each, with distances in double; and the view that
/// kernels get, on the host.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "accessvdb/batch_query.h"
#include "accessvdb/device_view.h"
#include "accessvdb/error.h"
#include "accessvdb/tsdf_volume.h"
#include "support/query_world.h"

namespace accessvdb::test {
namespace {

constexpr double kVoxel_m = QueryWorld::kVoxel_m;
/// In voxels: the library works in float32 here, on an axis of a few metres.
constexpr double kTolerance = 1e-3;
const double kHalfDiagonal = std::sqrt(3.0) / 2;

struct Expected {
  double nearest = INFINITY, first_t = INFINITY, first_touch_t = INFINITY;  ///< voxels; the last by the mirror's rule
  bool unknown = false, collision = false, touches_colliding = false;
};

double distanceToAxis(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& x) {
  const double length2 = (b - a).squaredNorm();
  const double t = length2 > 0 ? std::clamp((x - a).dot(b - a) / length2, 0.0, 1.0) : 0.0;
  return (a + t * (b - a) - x).norm();
}

/// Smallest t with |a + t (b - a) - x| <= reach, by bisection: the distance decreases up to the nearest point.
double firstWithin(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& x, double reach) {
  if ((a - x).norm() <= reach) return 0;
  double low = 0, high = std::clamp((x - a).dot(b - a) / (b - a).squaredNorm(), 0.0, 1.0);
  for (int n = 0; n < 60; ++n) {
    const double middle = (low + high) / 2;
    ((a + middle * (b - a) - x).norm() <= reach ? high : low) = middle;
  }
  return high;
}

/// @param slack  added to the capsule's reach, voxels
Expected lookAtEverything(const QueryWorld& world, const CapsuleQuery& query, double slack) {
  Expected expected;
  const Eigen::Vector3d a = (query.a_W - world.origin()) / kVoxel_m, b = (query.b_W - world.origin()) / kVoxel_m;
  const double radius = query.radius_m / kVoxel_m, reach = radius + kHalfDiagonal + slack;
  const double r_c = world.field.params().scoring.collision_distance_m / kVoxel_m;
  const Eigen::Array3d low = a.cwiseMin(b).array() - reach, high = a.cwiseMax(b).array() + reach;
  for (int x = int(std::floor(low.x())); x <= high.x(); ++x) {
    for (int y = int(std::floor(low.y())); y <= high.y(); ++y) {
      for (int z = int(std::floor(low.z())); z <= high.z(); ++z) {
        const Eigen::Vector3d centre(x, y, z);
        const double to_axis = distanceToAxis(a, b, centre);
        if (to_axis > reach) continue;
        const VoxelState voxel = world.field.volume().at({x, y, z});
        if (voxel.weight == 0) {
          expected.unknown |= !voxel.cleared;
          continue;
        }
        const double to_surface = voxel.distance_m / kVoxel_m;
        expected.nearest = std::min(expected.nearest, to_axis + to_surface);
        if (to_surface < r_c) {
          expected.touches_colliding = true;
          expected.first_touch_t = std::min(expected.first_touch_t, firstWithin(a, b, centre, reach));
        }
        if (to_surface < r_c || to_axis + to_surface < radius + slack) {
          expected.collision = true;
          const double within = to_surface < r_c ? reach : radius + slack - to_surface;
          expected.first_t = std::min(expected.first_t, firstWithin(a, b, centre, within));
        }
      }
    }
  }
  return expected;
}

std::vector<CapsuleQuery> randomCapsules(const FieldSnapshot& snapshot, int count) {
  const auto starts_W = QueryWorld::nearSurface(snapshot, count, 0.4, 11);
  samples::RandomStream random(12);
  std::vector<CapsuleQuery> capsules;
  for (const Eigen::Vector3d& a_W : starts_W) {
    const Eigen::Vector3d along(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
    const double length_m = capsules.size() % 7 == 0 ? 0.0 : random.uniform(0.0, 0.8);
    capsules.push_back({a_W, a_W + length_m * along, capsules.size() % 5 == 0 ? 0.0 : random.uniform(0.0, 0.3)});
    if (capsules.size() % 9 == 0) capsules.back().b_W = a_W + Eigen::Vector3d(0, 0, length_m);  // along an axis
  }
  return capsules;
}

/// The parameter is the collision distance in metres; 0 = rule.
class CapsuleQueryAtDistance : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(CollisionDistances, CapsuleQueryAtDistance, testing::Values(0.0, 1e-4));

TEST_P(CapsuleQueryAtDistance, EqualsLookingAtEveryVoxel) {
  const QueryWorld world(0, BackendKind::Cpu, GetParam());
  const auto capsules = randomCapsules(world.field.snapshot(), 400);
  const auto answers = world.field.batchQuery().along(capsules);
  const DeviceView view = world.field.hostView();
  int collisions = 0, unknown = 0, free = 0;
  for (std::size_t n = 0; n < capsules.size(); ++n) {
    SCOPED_TRACE(n);
    const CapsuleAnswer& answer = answers[n];
    const Expected least = lookAtEverything(world, capsules[n], -kTolerance);
    const Expected most = lookAtEverything(world, capsules[n], kTolerance);
    ASSERT_TRUE(answer.valid);
    EXPECT_LE(least.unknown, answer.unknown);
    EXPECT_GE(most.unknown, answer.unknown);
    EXPECT_LE(least.collision, answer.collision);
    EXPECT_GE(most.collision, answer.collision);
    EXPECT_EQ(answer.free(), !answer.unknown && !answer.collision);
    if (std::isnan(answer.min_distance_m)) {
      EXPECT_EQ(least.nearest, INFINITY);
    } else {
      EXPECT_LE(answer.min_distance_m / kVoxel_m, least.nearest + kTolerance);
      EXPECT_GE(answer.min_distance_m / kVoxel_m, most.nearest - kTolerance);
    }
    // Near grazing contact, t depends on the root of the remaining reach, so bounds are used instead of a tolerance.
    if (answer.collision) {
      EXPECT_GE(answer.first_hit_t, most.first_t - 1e-4);
      EXPECT_LE(answer.first_hit_t, least.first_t + 1e-4);
    } else {
      EXPECT_TRUE(std::isnan(answer.first_hit_t));
    }
    const PathOccupancy path = view.along(capsules[n].a_W.data(), capsules[n].b_W.data(), capsules[n].radius_m);
    EXPECT_TRUE(path.valid);
    EXPECT_EQ(path.unknown, answer.unknown);
    EXPECT_LE(least.touches_colliding, path.collision);
    EXPECT_GE(most.touches_colliding, path.collision);
    EXPECT_LE(path.collision, answer.collision);  // distances can only add collisions
    if (path.collision) {
      EXPECT_GE(path.first_hit_t, most.first_touch_t - 1e-4);
      EXPECT_LE(path.first_hit_t, least.first_touch_t + 1e-4);
      EXPECT_LE(answer.first_hit_t, path.first_hit_t);
    } else {
      EXPECT_EQ(path.first_hit_t, -1);
    }
    if (HasFailure()) return;
    collisions += answer.collision;
    unknown += answer.unknown;
    free += answer.free();
  }
  EXPECT_GT(collisions, 50);
  EXPECT_GT(unknown, 50);
  EXPECT_GT(free, 5);
  EXPECT_GT(int(capsules.size()) - collisions, 20);
}

/// A wall at x = 2 m, seen by a static sensor at the origin.
struct Wall {
  Wall() : field(ToolGeometry::builtin("builtin:pencil"), QueryWorld::paramsOf(0, BackendKind::Cpu)) {
    std::vector<Eigen::Vector3d> points_W, origin = {Eigen::Vector3d::Zero()};
    for (double y = -0.6; y <= 0.6; y += 0.0125) {
      for (double z = -0.6; z <= 0.6; z += 0.0125) points_W.emplace_back(2, y, z);
    }
    for (int scan = 0; scan < 3; ++scan) field.integrateRays(points_W, origin);
    field.update();
  }
  CapsuleAnswer along(const CapsuleQuery& query) const { return field.batchQuery().along({&query, 1})[0]; }
  AccessibilityField field;
};

TEST(CapsuleQueryAlong, StopsInFrontOfAWall) {
  const Wall wall;
  for (const double radius_m : {0.0, 0.03, 0.08, 0.2, 0.35}) {  // the largest are wider than tau = 0.2 m
    SCOPED_TRACE(radius_m);
    const CapsuleAnswer answer = wall.along({{1, 0, 0}, {3, 0, 0}, radius_m});
    EXPECT_TRUE(answer.collision);
    EXPECT_TRUE(answer.unknown);  // behind the wall
    // The axis enters at 2 m less the radius; voxels and the clamped distance add an uncertainty of one and a half.
    EXPECT_NEAR(1 + 2 * answer.first_hit_t, 2 - radius_m, 1.5 * kVoxel_m);
  }
  const CapsuleAnswer before = wall.along({{1.68, -0.05, 0}, {1.68, 0.05, 0}, 0});
  EXPECT_TRUE(before.free());                      // cleared
  EXPECT_TRUE(std::isnan(before.min_distance_m));  // but farther from the wall than tau
  const CapsuleAnswer close = wall.along({{1.85, -0.05, 0}, {1.85, 0.05, 0}, 0.02});
  EXPECT_TRUE(close.free());
  EXPECT_NEAR(close.min_distance_m, 0.15, kVoxel_m);
}

TEST(CapsuleQueryAlong, AThinLineThroughAWallIsNotFree) {
  const Wall wall;
  const Eigen::Vector3d b_W(2.4, 0.17, -0.13);
  const CapsuleQuery line{{1.6, 0.11, 0.07}, b_W, 0};
  EXPECT_TRUE(wall.along(line).collision);
  EXPECT_TRUE(wall.field.hostView().along(line.a_W.data(), line.b_W.data(), 0).collision);
}

/// A thin sheet seen from both sides has no voxel at distance 0: each is in front for one side. With almost no
/// collision distance none of them collides, but all are nearer than the radius.
TEST(CapsuleQueryAlong, DistancesBelowTheRadiusCollideToo) {
  AccessibilityField field(ToolGeometry::builtin("builtin:pencil"), QueryWorld::paramsOf(0, BackendKind::Cpu, 1e-4));
  std::vector<Eigen::Vector3d> points_W;
  for (double y = -0.6; y <= 0.6; y += 0.0125) {
    for (double z = -0.6; z <= 0.6; z += 0.0125) points_W.emplace_back(2.0225, y, z);
  }
  for (const double sensor_x : {0.0, 4.0, 0.0, 4.0}) {
    const std::vector<Eigen::Vector3d> origin = {Eigen::Vector3d(sensor_x, 0, 0)};
    field.integrateRays(points_W, origin);
  }
  const CapsuleQuery across{{1.8, 0, 0}, {2.2, 0, 0}, 0.08};
  ASSERT_FALSE(field.hostView().along(across.a_W.data(), across.b_W.data(), across.radius_m).collision);
  const CapsuleAnswer answer = field.batchQuery().along({&across, 1})[0];
  EXPECT_TRUE(answer.collision);
  EXPECT_LT(answer.min_distance_m, across.radius_m);
  EXPECT_NEAR(1.8 + 0.4 * answer.first_hit_t, 2.0225 - 0.08, 1.5 * kVoxel_m);
  const CapsuleQuery beside{{1.9, 0, -0.1}, {1.9, 0, 0.1}, 0.02};
  const CapsuleAnswer free = field.batchQuery().along({&beside, 1})[0];
  EXPECT_TRUE(free.free());
  EXPECT_GT(free.min_distance_m, beside.radius_m);
}

TEST(CapsuleQueryAlong, BadCapsulesAreNotFree) {
  const Wall wall;
  const Eigen::Vector3d a(1.8, 0, 0), b(1.8, 0.1, 0);
  const double inf = std::numeric_limits<double>::infinity();
  const std::vector<CapsuleQuery> bad = {{{kNan, 0, 0}, b, 0.01},
                                         {a, {1.8, inf, 0}, 0.01},
                                         {a, b, kNan},
                                         {a, b, -0.01},
                                         {a, b, inf},
                                         {a, {1.8, 1e7, 0}, 0.01},   // beyond the map's coordinates
                                         {a, {1.8, 1900, 0}, 0.01},  // too long
                                         {a, b, 60}};                // too thick
  const DeviceView view = wall.field.hostView();
  for (std::size_t n = 0; n < bad.size(); ++n) {
    SCOPED_TRACE(n);
    const CapsuleAnswer answer = wall.along(bad[n]);
    EXPECT_FALSE(answer.valid);
    EXPECT_TRUE(answer.unknown);
    EXPECT_FALSE(answer.free());
    const PathOccupancy path = view.along(bad[n].a_W.data(), bad[n].b_W.data(), bad[n].radius_m);
    EXPECT_FALSE(path.valid);
    EXPECT_TRUE(path.unknown);
    EXPECT_FALSE(path.free());
  }
  EXPECT_TRUE(wall.along({a, b, 0.01}).free());
  EXPECT_TRUE(view.along(a.data(), b.data(), 0.01).free());
}

TEST(HostView, ShowsTheMapAndThePoints) {
  const QueryWorld world;
  const DeviceView view = world.field.hostView();
  const FieldSnapshot snapshot = world.field.snapshot();
  EXPECT_FALSE(view.on_gpu);
  EXPECT_FALSE(view.distance_available);
  EXPECT_EQ(view.revision, world.field.revision());
  ASSERT_EQ(view.points.count, snapshot.points.size());
  for (const SurfacePoint& point : snapshot.points) {
    double p_W[3];
    float direction_W[3];
    const bool has_position = view.positionOf(point.id, p_W);
    ASSERT_TRUE(has_position || point.reason == PointReason::Confidence);
    for (int axis = 0; axis < 3 && has_position; ++axis) ASSERT_EQ(p_W[axis], point.position_W[axis]);
    ASSERT_EQ(view.points.label[point.id], point.label);
    ASSERT_EQ(view.points.reason[point.id], point.reason);
    ASSERT_EQ(view.points.score[point.id], point.score);
    ASSERT_EQ(view.directionOf(point.id, direction_W), point.direction != kNoDirection);
    // cos and sin of one angle, once through the exact quarter turns of the scoring tables.
    for (int axis = 0; axis < 3; ++axis) ASSERT_NEAR(direction_W[axis], point.direction_W[axis], 1e-6);
  }
  const double r_c = world.field.params().scoring.collision_distance_m;
  std::array<int, 3> seen = {};
  for (const Eigen::Vector3d& p_W : QueryWorld::nearSurface(snapshot, 5000, 0.3, 21)) {
    const Eigen::Vector3i ijk = world.voxelOf(p_W);
    const VoxelState voxel = world.field.volume().at({ijk.x(), ijk.y(), ijk.z()});
    Occupancy expected = voxel.cleared ? Occupancy::Free : Occupancy::Unknown;
    if (voxel.weight > 0) expected = voxel.distance_m < static_cast<float>(r_c) ? Occupancy::Collides : Occupancy::Free;
    ASSERT_EQ(view.occupancyAt(p_W.data()), expected);
    EXPECT_EQ(view.collides(p_W.data()), expected == Occupancy::Collides);
    EXPECT_EQ(view.armFree(p_W.data()), expected == Occupancy::Free);
    ++seen[static_cast<std::size_t>(expected)];
  }
  for (const int count : seen) EXPECT_GT(count, 100);
  const double bad[3] = {kNan, 0, 0};
  EXPECT_EQ(view.occupancyAt(bad), Occupancy::Unknown);
}

TEST(HostView, DeviceViewOfTheCpuIsRefused) {
  const AccessibilityField field(ToolGeometry::builtin("builtin:pencil"), QueryWorld::paramsOf(1, BackendKind::Cpu));
  try {
    (void)field.deviceView();
    FAIL() << "no error";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.id(), "device.none");
    EXPECT_NE(std::string(error.what()).find("hostView()"), std::string::npos);
  }
  EXPECT_EQ(field.hostView().points.count, 0u);
}

}  // namespace
}  // namespace accessvdb::test

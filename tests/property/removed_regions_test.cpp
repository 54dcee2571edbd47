// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Parts of a map that a person takes out: what the map holds afterwards, voxel by voxel, and labels against a full
/// evaluation.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/device_view.h"
#include "accessvdb/error.h"
#include "accessvdb/tsdf_volume.h"
#include "accessvdb/what_if.h"
#include "support/determinism_support.h"
#include "support/region_worlds.h"
#include "support/same_map.h"
#include "support/scratch_folder.h"

namespace accessvdb::test {
namespace {

Eigen::Vector3d centreOf(const AccessibilityField& field, const openvdb::Coord& ijk) {
  return field.origin_W() + field.params().tsdf.voxel_size_m * Eigen::Vector3d(ijk.x(), ijk.y(), ijk.z());
}

/// Whether a voxel's centre is in a region, from its definition; of a ball, not within rounding of its surface.
bool inRegion(const Region& region, const Eigen::Vector3d& p_W) {
  if (region.kind() == Region::Kind::Box) {
    return (p_W.array() >= region.min_W().array()).all() && (p_W.array() <= region.max_W().array()).all();
  }
  // Sum of the solid angles of all triangles: 4 pi inside, 0 outside (van Oosterom and Strackee).
  double angle = 0;
  for (const auto& t : region.triangles()) {
    const Eigen::Vector3d a = region.vertices_W()[t[0]] - p_W, b = region.vertices_W()[t[1]] - p_W,
                          c = region.vertices_W()[t[2]] - p_W;
    const double la = a.norm(), lb = b.norm(), lc = c.norm();
    angle += 2 * std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
  }
  return std::abs(angle) > 2 * M_PI;
}

/// The map compares in float32.
float collisionDistance_m(const AccessibilityField& field) {
  return static_cast<float>(field.params().scoring.collision_distance_m);
}

/// Voxels of all points, by id. Positions on the face between two voxels belong to the one whose centre finds them.
std::vector<Eigen::Vector3d> voxelsOfPoints(const AccessibilityField& field, const FieldSnapshot& snapshot) {
  const double v = field.params().tsdf.voxel_size_m;
  std::vector<Eigen::Vector3d> voxels;
  for (const SurfacePoint& point : snapshot.points) {
    const Eigen::Vector3d exact = (point.position_W - field.origin_W()) / v;
    for (int corner = 0; corner < 8; ++corner) {
      const Eigen::Vector3d shift(corner & 1, corner >> 1 & 1, corner >> 2);
      const Eigen::Vector3d voxel = exact.array().floor().matrix() + shift;
      const auto here = field.pointAt(field.origin_W() + v * voxel);
      if (!here || here->id != point.id) continue;
      voxels.push_back(voxel);
      break;
    }
  }
  return voxels;
}

/// Of a set of points: brute force over all points. @param points  their voxels
bool belongsToPoints(const AccessibilityField& field, const std::vector<Eigen::Vector3d>& points, const Region& region,
                     const openvdb::Coord& ijk) {
  const double v = field.params().tsdf.voxel_size_m;
  const double reach = std::ceil(field.params().tsdf.truncation_distance_m / v - 1e-9) + 1;
  const VoxelState state = field.volume().at(ijk);
  const bool collides = state.weight > 0 && (state.blocked || !(state.distance_m >= collisionDistance_m(field)));
  const Eigen::Vector3d here(ijk.x(), ijk.y(), ijk.z());
  const auto isNear = [&](std::uint32_t id) { return (points[id] - here).squaredNorm() <= reach * reach; };
  if (std::none_of(region.ids().begin(), region.ids().end(), isNear)) return false;
  double least = std::numeric_limits<double>::infinity();
  std::uint32_t nearest = 0;
  for (std::uint32_t id = 0; id < points.size(); ++id) {
    const double squared = (points[id] - here).squaredNorm();
    if (squared < least) least = squared, nearest = id;  // ids ascend: the first of several stays
  }
  const bool is_ours = std::binary_search(region.ids().begin(), region.ids().end(), nearest);
  return is_ours && (least == 0 || (collides && least <= reach * reach));
}

std::map<openvdb::Coord, VoxelState> voxelsOf(const AccessibilityField& field) {
  std::map<openvdb::Coord, VoxelState> voxels;
  const auto weights = field.volume().weight();
  for (auto voxel = weights->cbeginValueOn(); voxel; ++voxel) {
    voxels[voxel.getCoord()] = field.volume().at(voxel.getCoord());
  }
  return voxels;
}

/// Every voxel of the map, against the region's definition.
TEST(RemovedRegions, TakeOutExactlyTheirObservedVoxels) {
  std::uint64_t removed_voxels = 0, changed_points = 0;
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    AccessibilityField field = wallField(seed);
    const FieldSnapshot points = field.snapshot();
    const std::vector<Eigen::Vector3d> voxels_of_points = voxelsOfPoints(field, points);
    ASSERT_EQ(voxels_of_points.size(), points.points.size());
    const Region region = randomRegion(seed, points);
    const RemovedAs as = seed % 4 < 2 ? RemovedAs::Free : RemovedAs::Unknown;
    const auto before = voxelsOf(field);
    std::map<openvdb::Coord, bool> expected;
    for (const auto& [ijk, state] : before) {
      expected[ijk] = region.kind() == Region::Kind::Points ? belongsToPoints(field, voxels_of_points, region, ijk)
                                                            : inRegion(region, centreOf(field, ijk));
    }
    Removal removal;
    try {
      removal = field.removeRegion(region, as);
    } catch (const UnusableInput& error) {
      ASSERT_EQ(error.id(), "region.outside");
      for (const auto& [ijk, inside] : expected) ASSERT_FALSE(inside);
      continue;
    }
    std::uint64_t inside_voxels = 0, colliding = 0;
    for (const auto& [ijk, inside] : expected) {
      const VoxelState &was = before.at(ijk), now = field.volume().at(ijk);
      inside_voxels += inside ? 1 : 0;
      const bool collided = was.blocked || !(was.distance_m >= collisionDistance_m(field));
      colliding += inside && collided ? 1 : 0;
      if (!inside) {
        ASSERT_EQ(was.weight, now.weight) << "seed " << seed;
        ASSERT_EQ(was.distance_m, now.distance_m);
        ASSERT_EQ(was.blocked, now.blocked);
        ASSERT_EQ(was.cleared, now.cleared);
      } else if (as == RemovedAs::Free) {
        ASSERT_EQ(now.weight, 0u) << "seed " << seed;
        ASSERT_TRUE(now.cleared);
        ASSERT_FALSE(now.blocked);
      } else {
        ASSERT_EQ(now.weight, 1u) << "seed " << seed << " " << region.inWords();
        ASSERT_EQ(now.distance_m, was.distance_m);
        ASSERT_EQ(now.blocked, was.blocked);
      }
    }
    EXPECT_EQ(removal.voxels, inside_voxels);
    EXPECT_EQ(removal.colliding_voxels, colliding);
    EXPECT_EQ(voxelsOf(field).size(), before.size() - (as == RemovedAs::Free ? inside_voxels : 0));
    EXPECT_EQ(field.volume().activeVoxelCount(), voxelsOf(field).size());
    if (as == RemovedAs::Unknown) {
      EXPECT_EQ(removal.flipped_voxels, 0u);
    }
    removed_voxels += inside_voxels;

    // Until the next update, nothing is known of any point.
    const FieldSnapshot unscored = field.snapshot();
    EXPECT_EQ(unscored.count(PointLabel::Unscored), unscored.points.size());
    while (field.update().backlog > 0) {
    }
    expectExact(field);
    for (const SurfacePoint& point : field.snapshot().points) {
      const Eigen::Vector3d& ijk = voxels_of_points[point.id];
      const bool gone = field.volume().at(openvdb::Coord(int(ijk.x()), int(ijk.y()), int(ijk.z()))).weight == 0;
      ASSERT_EQ(point.reason == PointReason::Changed, gone) << "seed " << seed << " point " << point.id;
      if (gone) {
        ASSERT_EQ(point.label, PointLabel::Unscored);
      }
      changed_points += gone ? 1 : 0;
    }
  }
  EXPECT_GT(removed_voxels, 2000u);
  EXPECT_GT(changed_points, 100u);
}

/// Scans go on after a removal, with updates that stay exact; a saved state goes on with the same bits.
TEST(RemovedRegions, ScansGoOnExactly) {
  const ScratchFolder folder;
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const std::vector<Scan> scans = wallScans(seed, 8, 1000);
    AccessibilityField field(armTool(), paramsFor(seed));
    for (std::size_t n = 0; n < scans.size(); ++n) {
      field.integrateScan(scans[n].points_S, scans[n].T_W_S);
      if (n == 3) {
        field.update();
        field.removeRegion(Region::box({1.4, 0.3, 0.2}, {1.7, 0.7, 1.8}),
                           seed % 2 == 0 ? RemovedAs::Free : RemovedAs::Unknown);
        AccessibilityField loaded = copyOf(field, folder);
        expectSameMap(field.volume(), loaded.volume());
      }
      if (n % 2 == 1) {
        field.update();
        expectExact(field);
      }
    }
    expectVaried(field.snapshot());
  }
}

/// "Still collides; the first scan that sees through it opens it": also where votes block, after one denial.
TEST(RemovedRegions, UnknownOpensWithTheFirstScanThatSeesThroughIt) {
  FieldParams params = paramsFor(2);
  params.tsdf.range_noise_m = 0.005;
  const double v = params.tsdf.voxel_size_m;
  const auto scan = [&](double post_m) {  // wall at 2 m; in its middle a post
    std::vector<Eigen::Vector3f> points;
    for (double y = -0.6; y < 0.6; y += v / 3) {
      for (double z = -0.4; z < 0.4; z += v / 3) {
        const double x = std::abs(y) < 0.1 && post_m > 0 ? post_m : 2.0;
        points.emplace_back(float(x), float(y * x / 2), float(z * x / 2));
      }
    }
    return points;
  };
  for (const bool removed : {false, true}) {
    AccessibilityField field(armTool(), params);
    const auto blocked = [&] {
      std::uint64_t voxels = 0;
      for (const auto& [ijk, state] : voxelsOf(field)) {
        const Eigen::Vector3d p_W = centreOf(field, ijk);
        if (p_W.x() > 1.7 && p_W.x() < 1.88 && std::abs(p_W.y()) < 0.06 && std::abs(p_W.z()) < 0.2) {
          voxels += state.blocked || !(state.distance_m >= collisionDistance_m(field)) ? 1 : 0;
        }
      }
      return voxels;
    };
    for (int n = 0; n < 60; ++n) field.integrateScan(scan(0), Eigen::Isometry3d::Identity());
    for (int n = 0; n < 8; ++n) field.integrateScan(scan(2 - 3 * v), Eigen::Isometry3d::Identity());
    const std::uint64_t with_post = blocked();
    ASSERT_GT(with_post, 15u);
    if (removed) field.removeRegion(Region::box({1.5, -0.3, -0.5}, {1.95, 0.3, 0.5}));
    EXPECT_EQ(blocked(), with_post) << "a removal as unknown opens nothing by itself";
    field.integrateScan(scan(0), Eigen::Isometry3d::Identity());
    if (removed) {
      EXPECT_LT(blocked(), with_post / 20);
    } else {
      EXPECT_GT(blocked(), with_post / 2) << "otherwise it takes five scans";
    }
  }
}

std::string idOf(const std::function<void()>& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.id();
  }
  return "";
}

TEST(RemovedRegions, RefuseWhatIsNoRegion) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(idOf([&] { static_cast<void>(Region::box({0, 0, kNaN}, {1, 1, 1})); }), "region.box");
  EXPECT_EQ(idOf([] { static_cast<void>(Region::box({0, 0, 2}, {1, 1, 1})); }), "region.box");
  EXPECT_EQ(idOf([] { static_cast<void>(Region::points({})); }), "region.empty");
  EXPECT_EQ(idOf([] {
              static_cast<void>(Region::mesh({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}));
            }),
            "region.mesh");  // not closed
  EXPECT_EQ(idOf([] {
              static_cast<void>(Region::mesh({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 3}}));
            }),
            "region.mesh");
  EXPECT_EQ(idOf([] { static_cast<void>(Region::mesh({}, {})); }), "region.mesh");
  EXPECT_EQ(idOf([&] {
              static_cast<void>(Region::mesh({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, kNaN}}, {{0, 1, 2}, {0, 2, 1}}));
            }),
            "region.mesh");
  AccessibilityField field = wallField(1);
  const FieldSnapshot before = field.snapshot();
  EXPECT_EQ(idOf([&] { field.removeRegion(Region::box({50, 50, 50}, {60, 60, 60})); }), "region.outside");
  EXPECT_EQ(idOf([&] { field.removeRegion(Region::box({-1e300, 50, 50}, {1e300, 60, 1e300})); }), "region.outside");
  EXPECT_EQ(idOf([&] { field.removeRegion(Region::points({0, 4'000'000'000u})); }), "region.ids");
  const std::vector<Region> far = {Region::box({50, 50, 50}, {60, 60, 60})};
  EXPECT_EQ(idOf([&] { static_cast<void>(field.whatIf(far)); }), "region.outside");
  expectSame(before, field.snapshot());  // refused calls change nothing

  const std::vector<Region> all = {Region::box({-100, -100, -100}, {100, 100, 100})};
  EXPECT_TRUE(field.whatIf(all).opens.empty());  // every point would be gone
  EXPECT_EQ(field.whatIf(all).points_gone, before.points.size());
  field.integrateScan(wallScans(3, 1, 50)[0].points_S, Eigen::Isometry3d::Identity());
  EXPECT_EQ(idOf([&] { static_cast<void>(field.whatIf(all)); }), "region.stale");

  FieldParams tile = paramsFor(1);
  tile.origin_W = {{0, 0, 0}};
  tile.window = FieldWindow{{0, 0}, {128, 128}};
  AccessibilityField in_tile(armTool(), tile);
  EXPECT_EQ(idOf([&] { in_tile.removeRegion(all[0]); }), "region.unsupported");
}

/// What is stored of points that a budget left over is old: a what-if would say that they open.
TEST(RemovedRegions, WhatIfWaitsForTheBacklog) {
  const std::vector<Region> part = {Region::box({1.4, 0.3, 0.2}, {1.7, 0.7, 1.8})};
  for (const bool async : {false, true}) {
    FieldParams params = paramsFor(1);
    params.update.budget_points = 300;
    AccessibilityField field(toolFor(1), params);
    for (const Scan& scan : wallScans(1, 6, 1200)) field.integrateScan(scan.points_S, scan.T_W_S);
    const auto update = [&] { return async ? field.updateAsync().wait() : field.update(); };
    int left = 0;
    for (; update().backlog > 0; ++left) {
      ASSERT_EQ(idOf([&] { static_cast<void>(field.whatIf(part)); }), "region.stale");
    }
    EXPECT_GT(left, 1);
    const AccessibilityField whole = wallField(1);
    EXPECT_EQ(field.whatIf(part).opens.size(), whole.whatIf(part).opens.size());
  }
}

/// The mirror of distances, which no label depends on, follows a removal.
TEST(RemovedRegions, TheMirrorOfDistancesFollows) {
  for (const RemovedAs as : {RemovedAs::Free, RemovedAs::Unknown}) {
    FieldParams params = paramsFor(1);
    params.backend = BackendKind::Cpu;  // read on the host
    params.mirror_distance = true;
    AccessibilityField field(armTool(), params);
    for (const Scan& scan : wallScans(1, 4, 1200)) field.integrateScan(scan.points_S, scan.T_W_S);
    field.update();
    const auto before = voxelsOf(field);
    field.removeRegion(Region::box({1.3, 0.2, 0.2}, {1.7, 0.8, 1.8}), as);
    const DeviceView view = field.hostView();
    std::uint64_t unobserved = 0;
    for (const auto& [ijk, was] : before) {
      const VoxelState now = field.volume().at(ijk);
      const Eigen::Vector3d p_W = centreOf(field, ijk);
      const float mirrored = view.distanceAt(p_W.data());
      if (now.weight == 0) {
        ASSERT_TRUE(std::isnan(mirrored));
        ++unobserved;
      } else {
        ASSERT_EQ(mirrored, now.distance_m);
      }
    }
    EXPECT_EQ(unobserved > 100, as == RemovedAs::Free);
  }
}

}  // namespace
}  // namespace accessvdb::test

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// The mirror of distances in a view of a live field, against the OpenVDB grid from the map: equal after every scan,
// voxel for voxel; and interpolation between voxels.
#include <gtest/gtest.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/Interpolation.h>

#include <cmath>

#include "accessvdb/device_view.h"
#include "accessvdb/tsdf_volume.h"
#include "field/field_access.h"
#include "points/point_store.h"
#include "support/query_world.h"

namespace accessvdb::test {
namespace {

/// Every voxel of every leaf of the map, and around the leaves: value and active state.
void expectEqual(const AccessibilityField& field) {
  const DeviceView view = field.hostView();
  ASSERT_TRUE(view.distance_available);
  const openvdb::FloatGrid::Ptr map = field.volume().distance();
  const auto mirror = view.distance.grid->getAccessor();
  const auto reads = map->getConstAccessor();
  ASSERT_EQ(view.distance.grid->tree().background(), map->background());
  ASSERT_EQ(view.distance.grid->tree().nodeCount(0), map->tree().leafCount());
  std::uint64_t observed = 0, differ = 0;
  for (auto leaf = map->tree().cbeginLeaf(); leaf; ++leaf) {
    openvdb::CoordBBox box = leaf->getNodeBoundingBox();
    box.expand(1);
    for (auto ijk = box.begin(); ijk; ++ijk) {
      const nanovdb::Coord at((*ijk).x(), (*ijk).y(), (*ijk).z());
      float probed = -1;
      const bool active = mirror.probeValue(at, probed);
      differ += active != reads.isValueOn(*ijk) || probed != reads.getValue(*ijk) || mirror.getValue(at) != probed;
      observed += active;
    }
  }
  EXPECT_EQ(differ, 0u);
  EXPECT_GT(observed, 50u);
}

FieldParams paramsOf(double voxel_size_m) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_size_m;
  params.backend = BackendKind::Cpu;
  params.mirror_distance = true;
  return params;
}

/// A walk of both signs about its first pose, with any parameters.
void follow(const FieldParams& params) {
  const samples::WalkGenerator walk(
      {.frames = 6, .rays_per_frame = 3000, .range_noise_m = 0.01, .seed = 3, .max_range_m = 8});
  AccessibilityField field(ToolGeometry::builtin("builtin:pencil"), params);
  std::uint64_t leaves = 0;
  for (int n = 0; n < 6; ++n) {
    SCOPED_TRACE(n);
    const samples::WalkFrame frame = walk.frame(n);
    const FrameStats stats = field.integrateScan(frame.points_S, frame.T_W_S);
    expectEqual(field);
    EXPECT_GT(stats.distance_leaves, 0u);
    EXPECT_LE(stats.distance_leaves, stats.touched_leaves);
    EXPECT_GT(stats.distance_mirror_bytes, 66 * stats.distance_leaves);
    leaves = field.hostView().distance.grid->tree().nodeCount(0);
  }
  EXPECT_GT(field.memoryUse().distance_mirror_bytes, 2144 * leaves);
  EXPECT_GT(field.memoryUse().point_host_bytes, internal::FieldAccess::points(field).bytes());
}

TEST(DistanceView, EqualsTheMapAfterEveryScan) { follow(paramsOf(0.05)); }
TEST(DistanceView, EqualsTheMapWithWholeCubesAndNegativeDistances) {
  FieldParams params = paramsOf(0.08);
  params.tsdf.region = UpdateRegion::FullCube;
  params.tsdf.clamp_min_m = -0.2;
  follow(params);
}
TEST(DistanceView, EqualsTheMapOfTheProjectiveBaseline) {
  for (const bool cleared_band : {false, true}) {
    FieldParams params = paramsOf(0.08);
    params.tsdf.region = UpdateRegion::Projective;
    params.tsdf.projective.cleared_band = cleared_band;
    follow(params);
  }
}

/// More returns in one leaf than its narrow sums can hold: they are folded differently.
TEST(DistanceView, EqualsTheMapWhereThousandsOfReturnsReachALeaf) {
  AccessibilityField field(ToolGeometry::builtin("builtin:pencil"), paramsOf(0.5));
  std::vector<Eigen::Vector3f> points_S;
  for (int n = 0; n < 40000; ++n) {
    points_S.emplace_back(5, 1e-3f * static_cast<float>(n % 200), 1e-3f * static_cast<float>(n / 200));
  }
  field.integrateScan(points_S, Eigen::Isometry3d::Identity());
  expectEqual(field);
}

TEST(DistanceView, ScansInTwoHalvesOfTheWorldCrossRootTiles) {
  // 4096 voxels are 2048 m at 0.5 m: a step of the sensor from one root tile into the next, both ways.
  AccessibilityField field(ToolGeometry::builtin("builtin:pencil"), paramsOf(0.5));
  const samples::WalkGenerator walk({.frames = 1, .rays_per_frame = 3000, .seed = 4, .max_range_m = 20});
  const samples::WalkFrame frame = walk.frame(0);
  for (const double x : {0.0, 2048.0, -2048.0, 4095.0}) {
    Eigen::Isometry3d T_W_S = frame.T_W_S;
    T_W_S.pretranslate(Eigen::Vector3d(x, -x / 2, 0));
    field.integrateScan(frame.points_S, T_W_S);
    expectEqual(field);
  }
  EXPECT_GT(field.hostView().distance.grid->tree().root().tileCount(), 4u);
}

TEST(DistanceView, WithoutTheMirrorNothingIsKnown) {
  const QueryWorld world;
  const DeviceView view = world.field.hostView();
  EXPECT_FALSE(view.distance_available);
  EXPECT_EQ(view.distance.grid, nullptr);
  const Eigen::Vector3d p_W = world.field.snapshot().points.front().position_W;
  EXPECT_TRUE(std::isnan(view.distanceAt(p_W.data())));
  EXPECT_TRUE(std::isnan(view.distanceInterpolatedAt(p_W.data())));
  EXPECT_EQ(world.field.memoryUse().distance_mirror_bytes, 0u);
}

/// Labels and everything else equal those of a field without it.
TEST(DistanceView, ChangesNoResult) {
  const QueryWorld without, with(0, BackendKind::Cpu, 0, true);
  const FieldSnapshot a = without.field.snapshot(), b = with.field.snapshot();
  ASSERT_EQ(a.points.size(), b.points.size());
  for (std::size_t n = 0; n < a.points.size(); ++n) {
    ASSERT_EQ(a.points[n].label, b.points[n].label);
    ASSERT_EQ(a.points[n].score, b.points[n].score);
  }
  EXPECT_EQ(without.field.params().describe(), with.field.params().describe());
}

TEST(DistanceView, NearestAndInterpolated) {
  const QueryWorld world(0, BackendKind::Cpu, 0, true);
  const DeviceView view = world.field.hostView();
  const openvdb::FloatGrid::Ptr map = world.field.volume().distance();
  const auto reads = map->getConstAccessor();
  int known = 0, unknown = 0, interpolated = 0, edge = 0;
  for (const Eigen::Vector3d& p_W : QueryWorld::nearSurface(world.field.snapshot(), 20000, 0.3, 5)) {
    const Eigen::Vector3i ijk = world.voxelOf(p_W);
    const openvdb::Coord voxel(ijk.x(), ijk.y(), ijk.z());
    const float nearest = view.distanceAt(p_W.data()), between = view.distanceInterpolatedAt(p_W.data());
    if (reads.isValueOn(voxel)) {
      ASSERT_EQ(nearest, reads.getValue(voxel));
      ++known;
    } else {
      ASSERT_TRUE(std::isnan(nearest));
      ++unknown;
    }
    const Eigen::Vector3d x = (p_W - world.origin()) / QueryWorld::kVoxel_m;
    bool all = true;
    for (int corner = 0; corner < 8; ++corner) {
      all = all && reads.isValueOn(openvdb::Coord(int(std::floor(x.x())) + (corner & 1),
                                                  int(std::floor(x.y())) + (corner >> 1 & 1),
                                                  int(std::floor(x.z())) + (corner >> 2)));
    }
    if (all) {
      const float expected = openvdb::tools::BoxSampler::sample(map->tree(), openvdb::Vec3d(x.x(), x.y(), x.z()));
      ASSERT_NEAR(between, expected, 1e-5);
      ++interpolated;
    } else {
      ASSERT_TRUE(std::isnan(between));
      edge += std::isnan(nearest) ? 0 : 1;
    }
  }
  EXPECT_GT(known, 1000);
  EXPECT_GT(unknown, 1000);
  EXPECT_GT(interpolated, 1000);
  EXPECT_GT(edge, 100);  // the voxel is known and one beside it is not
}

/// Invalid positions get no answer, and never read as free.
TEST(DistanceView, BadPositionsHaveNoDistance) {
  const QueryWorld world(0, BackendKind::Cpu, 0, true);
  const DeviceView view = world.field.hostView();
  const double far_m = 1e9, inf = std::numeric_limits<double>::infinity();
  const Eigen::Vector3d o = world.origin();
  for (const Eigen::Vector3d& p_W : {Eigen::Vector3d(kNan, 0, 0), Eigen::Vector3d(o.x(), inf, o.z()),
                                     Eigen::Vector3d(o.x(), o.y(), -inf), Eigen::Vector3d(o.x() + far_m, o.y(), 0)}) {
    EXPECT_FALSE(view.distanceAt(p_W.data()) >= 0);
    EXPECT_FALSE(view.distanceInterpolatedAt(p_W.data()) >= 0);
    EXPECT_TRUE(std::isnan(view.distanceAt(p_W.data())));
  }
}

TEST(DistanceView, AnEmptyFieldKnowsNothing) {
  const AccessibilityField field(ToolGeometry::builtin("builtin:pencil"), paramsOf(0.05));
  const DeviceView view = field.hostView();
  EXPECT_TRUE(view.distance_available);
  const double p_W[3] = {0, 0, 0};
  EXPECT_TRUE(std::isnan(view.distanceAt(p_W)));
  EXPECT_TRUE(std::isnan(view.distanceInterpolatedAt(p_W)));
}

}  // namespace
}  // namespace accessvdb::test

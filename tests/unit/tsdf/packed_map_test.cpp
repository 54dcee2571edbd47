// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Weights at their cap, the collision threshold, memory, and the returned grids.
#include <gtest/gtest.h>
#if defined(__GLIBC__)
#include <malloc.h>
#endif

#include <cmath>
#include <memory>
#include <vector>

#include "accessvdb/tsdf_volume.h"
#include "tsdf/scan_integrator.h"
#include "unit/tsdf/loop_tsdf.h"

namespace accessvdb::internal {
namespace {

TsdfParams fourVoxels() {
  TsdfParams params;
  params.voxel_size_m = 0.01;
  params.truncation_distance_m = 0.04;
  return params;
}

TEST(PackedMap, WeightIsCappedAndTheMeanKept) {
  TsdfParams params = fourVoxels();
  params.max_weight = 10;
  PackedMap map(params);
  ScanIntegrator integrator(map);
  const Eigen::Vector3f p(0, 0, 0), q(0, 0, 3);
  const std::vector<Eigen::Vector3f> eight(8, p);
  const openvdb::Coord ahead(0, 0, 2);
  for (int scan = 0; scan < 3; ++scan) integrator.integrate(eight, {&q, 1});
  EXPECT_EQ(map.at(ahead).weight, 10u);
  EXPECT_NEAR(map.at(ahead).distance_m, 0.02, 0.04 / kSampleSteps);
  // Two returns one voxel further weigh 2 of 10 + 2: the cap forgets the rest.
  const std::vector<Eigen::Vector3f> two(2, Eigen::Vector3f(0, 0, -0.01f));
  integrator.integrate(two, {&q, 1});
  EXPECT_EQ(map.at(ahead).weight, 10u);
  EXPECT_NEAR(map.at(ahead).distance_m, (10 * 0.02 + 2 * 0.03) / 12, 0.04 / kSampleSteps);
}

TEST(PackedMap, CollisionThresholdAgreesWithTheDistance) {
  PackedMap map(fourVoxels());
  for (const float r_c : {0.0f, 1e-9f, 0.0005f, 0.005f, 0.01f, 0.0399999f, 0.04f, 0.05f, -0.01f}) {
    map.setCollisionDistance(r_c);
    for (std::uint32_t mean = 0; mean <= kMeanSteps; ++mean) {
      ASSERT_EQ(mean < map.collisionMean(), !(map.distanceOf(mean) >= r_c)) << r_c << ' ' << mean;
    }
  }
}

TEST(PackedMap, LeavesCostWhatTheyAreSaidToCost) {
#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  const auto leaf = std::make_unique<PackedLeaf>(openvdb::PartialCreate(), openvdb::Coord(0, 0, 0));
  EXPECT_TRUE(leaf->buffer().empty());
  EXPECT_EQ(malloc_usable_size(leaf.get()) + sizeof(std::size_t), kClearedLeafBytes);
  // Buffers are contiguous, except at the end of a chunk.
  std::vector<std::unique_ptr<PackedLeaf>> leaves;
  std::size_t gapless = 0;
  for (int n = 0; n < 100; ++n) {
    leaves.push_back(std::make_unique<PackedLeaf>(openvdb::PartialCreate(), openvdb::Coord(8 * n, 0, 0)));
    leaves.back()->buffer().allocate();
    if (n == 0) continue;
    const auto* before = reinterpret_cast<const std::byte*>(plainValues(*leaves[static_cast<std::size_t>(n) - 1]));
    const auto* here = reinterpret_cast<const std::byte*>(plainValues(*leaves[static_cast<std::size_t>(n)]));
    gapless += here - before == static_cast<std::ptrdiff_t>(kObservedLeafBytes - kClearedLeafBytes) ? 1u : 0u;
  }
  EXPECT_GE(gapless, 98u);
#else
  GTEST_SKIP() << "needs glibc's malloc_usable_size, without sanitizers";
#endif
}

TEST(PackedMap, LookingForALeafAllocatesNothing) {
  PackedMap map(fourVoxels());
  ScanIntegrator integrator(map);
  const auto points = test::wavySheet(2000, 0.05, 1);
  const Eigen::Vector3f q(0.1f, 0.2f, 5.0f);
  for (int scan = 0; scan < 3; ++scan) integrator.integrate(points, {&q, 1});
  std::uint64_t buffers = 0, leaves = 0, observed = 0;
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
    ++leaves;
    LeafValues::Room room;
    const std::uint32_t* packed = LeafValues(*leaf).all(room);
    buffers += packed != nullptr ? 1u : 0u;
    for (std::size_t n = 0; packed != nullptr && n < 512; ++n) observed += weightOf(packed[n]) > 0 ? 1u : 0u;
  }
  EXPECT_EQ(leaves, map.leaf_count);
  EXPECT_EQ(buffers, map.allocated_leaf_count);
  EXPECT_EQ(observed, map.observed_voxels);
  EXPECT_LT(buffers, leaves) << "some leaves are only passed through";
  EXPECT_GE(map.memoryBytes(), buffers * kObservedLeafBytes + (leaves - buffers) * kClearedLeafBytes);
}

TEST(PackedMap, BuffersSurviveTheThreadThatMadeThemAndOtherMaps) {
  const auto points = test::wavySheet(2000, 0.05, 1);
  const Eigen::Vector3f q(0.1f, 0.2f, 5.0f);
  auto kept = std::make_unique<PackedMap>(fourVoxels());
  ScanIntegrator(*kept).integrate(points, {&q, 1});
  const VoxelState before = kept->at(openvdb::Coord(0, 0, 0));
  for (int n = 0; n < 5; ++n) {  // freed memory is reused dirty: a map must not read it
    PackedMap other(fourVoxels());
    ScanIntegrator integrator(other);
    for (int scan = 0; scan < 2; ++scan) integrator.integrate(points, {&q, 1});
    EXPECT_EQ(other.observed_voxels, kept->observed_voxels);
  }
  EXPECT_EQ(kept->at(openvdb::Coord(0, 0, 0)).weight, before.weight);
}

TEST(TsdfVolumeGrids, EqualTheMapVoxelByVoxel) {
  TsdfVolume volume(fourVoxels());
  ScanIntegrator integrator(volume.packed());
  const auto points = test::wavySheet(400, 0.01, 3);
  const Eigen::Vector3f q(0.1f, 0.2f, 2.0f);
  integrator.integrate(points, {&q, 1});
  const auto distance = volume.distance();
  const auto weight = volume.weight();
  const auto cleared = volume.cleared();
  EXPECT_EQ(distance->getName(), "distance");
  EXPECT_EQ(weight->getName(), "weight");
  EXPECT_EQ(cleared->getName(), "cleared");
  EXPECT_FLOAT_EQ(distance->background(), 0.04f);
  EXPECT_EQ(distance->activeVoxelCount(), volume.activeVoxelCount());
  EXPECT_EQ(weight->activeVoxelCount(), volume.activeVoxelCount());
  EXPECT_DOUBLE_EQ(distance->voxelSize()[0], 0.01);
  EXPECT_EQ(distance->indexToWorld(openvdb::Coord(3, -2, 5)), openvdb::Vec3d(0.03, -0.02, 0.05));
  const openvdb::CoordBBox bounds = volume.leafBounds();
  std::uint64_t observed = 0, seen_cleared = 0;
  openvdb::CoordBBox wider = bounds;
  wider.expand(3);
  for (auto ijk = wider.begin(); ijk; ++ijk) {
    const VoxelState state = volume.at(*ijk);
    ASSERT_EQ(distance->tree().getValue(*ijk), state.distance_m);
    ASSERT_EQ(distance->tree().isValueOn(*ijk), state.weight > 0);
    ASSERT_EQ(weight->tree().getValue(*ijk), static_cast<float>(state.weight));
    ASSERT_EQ(weight->tree().isValueOn(*ijk), state.weight > 0);
    ASSERT_EQ(cleared->tree().getValue(*ijk), state.cleared);
    ASSERT_EQ(cleared->tree().isValueOn(*ijk), state.cleared);
    if (state.weight > 0 || state.cleared) {
      ASSERT_TRUE(bounds.isInside(*ijk));
    }
    observed += state.weight > 0 ? 1u : 0u;
    seen_cleared += state.cleared ? 1u : 0u;
  }
  EXPECT_EQ(observed, volume.activeVoxelCount());
  EXPECT_EQ(seen_cleared, cleared->activeVoxelCount());
  EXPECT_LT(bounds.min().x(), 0);
  EXPECT_GT(bounds.max().x(), 0);
}

TEST(TsdfVolumeGrids, OfAnEmptyMap) {
  const TsdfVolume volume(fourVoxels());
  EXPECT_EQ(volume.distance()->activeVoxelCount(), 0u);
  EXPECT_TRUE(volume.leafBounds().empty());
  EXPECT_EQ(volume.leafCount(), 0u);
  EXPECT_FLOAT_EQ(volume.at(openvdb::Coord(1, 2, 3)).distance_m, 0.04f);
}

}  // namespace
}  // namespace accessvdb::internal

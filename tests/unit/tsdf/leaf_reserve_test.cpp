// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Prepared memory is as good as fresh memory, and none of it is leaked.
#include "tsdf/leaf_reserve.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <vector>

#include "tsdf/packed_map.h"

namespace accessvdb::internal {
namespace {

using Leaves = std::vector<std::unique_ptr<PackedLeaf>>;

/// Takes `chunks` chunks of 2 MiB, at 2 KiB per leaf, and counts voxels that are not zero.
std::size_t addLeaves(Leaves& leaves, std::size_t chunks) {
  std::size_t not_zero = 0;
  for (std::size_t n = 0; n < chunks * 1024; ++n) {
    leaves.push_back(std::make_unique<PackedLeaf>(openvdb::PartialCreate(), openvdb::Coord(0)));
    allocateZeroed(*leaves.back());
    std::uint32_t* values = packedValues(*leaves.back());
    not_zero += static_cast<std::size_t>(std::count_if(values, values + 512, [](std::uint32_t v) { return v != 0; }));
    std::fill(values, values + 512, 0xdeadbeefu);
  }
  return not_zero;
}

TEST(LeafReserve, MakesReadyWhatTwoScansTook) {
  {
    Leaves leaves;
    addLeaves(leaves, 1);
    if (!newPackedVoxelsAreZero()) GTEST_SKIP() << "no pool in this build";
  }
  Leaves leaves;
  {
    LeafReserve reserve;
    EXPECT_EQ(addLeaves(leaves, 8), 0u);
    reserve.refill();
    reserve.wait();
    EXPECT_EQ(LeafReserve::readyChunks(), 0u) << "one scan says nothing about the next";
    EXPECT_EQ(addLeaves(leaves, 5), 0u);
    reserve.refill();
    reserve.wait();
    EXPECT_NEAR(static_cast<double>(LeafReserve::readyChunks()), 5, 1);  // part of the current chunk was left
    const std::size_t ready = LeafReserve::readyChunks();
    EXPECT_EQ(addLeaves(leaves, 3), 0u);
    EXPECT_LT(LeafReserve::readyChunks(), ready) << "ready chunks are taken first";
    EXPECT_EQ(addLeaves(leaves, 8), 0u);
    EXPECT_EQ(LeafReserve::readyChunks(), 0u);
    reserve.refill();
  }
  EXPECT_EQ(LeafReserve::readyChunks(), 0u) << "the last reserve gives all back";
}

TEST(LeafReserve, BelongsToNoMapAlone) {
  if (!newPackedVoxelsAreZero()) GTEST_SKIP() << "no pool in this build";
  Leaves leaves;
  auto first = std::make_unique<LeafReserve>();
  LeafReserve second;
  for (int scan = 0; scan < 2; ++scan) {
    EXPECT_EQ(addLeaves(leaves, 4), 0u);
    first->refill();
  }
  first->wait();
  const std::size_t ready = LeafReserve::readyChunks();
  EXPECT_GT(ready, 0u);
  first.reset();
  EXPECT_EQ(LeafReserve::readyChunks(), ready);
}

}  // namespace
}  // namespace accessvdb::internal

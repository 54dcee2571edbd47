// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Prepared memory is as good as fresh memory, and none of it is leaked.
#include "tsdf/leaf_reserve.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <set>
#include <vector>

#include "tsdf/packed_map.h"

namespace accessvdb::internal {
namespace {

using Leaves = std::vector<std::unique_ptr<PackedLeaf>>;

/// Of leaves, at 2 KiB each.
constexpr std::size_t kChunk = 1024;

/// @return voxels that are not zero
std::size_t addLeaves(Leaves& leaves, std::size_t count) {
  std::size_t not_zero = 0;
  for (std::size_t n = 0; n < count; ++n) {
    leaves.push_back(std::make_unique<PackedLeaf>(openvdb::PartialCreate(), openvdb::Coord(0)));
    allocateZeroed(*leaves.back());
    std::uint32_t* values = plainValues(*leaves.back());
    not_zero += static_cast<std::size_t>(std::count_if(values, values + 512, [](std::uint32_t v) { return v != 0; }));
    std::fill(values, values + 512, 0xdeadbeefu);
  }
  return not_zero;
}

TEST(LeafReserve, MakesReadyWhatTwoScansTook) {
  {
    Leaves leaves;
    addLeaves(leaves, kChunk);
    if (!newPackedVoxelsAreZero()) GTEST_SKIP() << "no pool in this build";
  }
  Leaves leaves;
  {
    LeafReserve reserve;
    reserve.begin();
    EXPECT_EQ(addLeaves(leaves, 8 * kChunk), 0u);
    reserve.refill();
    reserve.wait();
    EXPECT_EQ(LeafReserve::readyChunks(), 0u) << "one scan says nothing about the next";
    reserve.begin();
    EXPECT_EQ(addLeaves(leaves, 5 * kChunk), 0u);
    reserve.refill();
    reserve.wait();
    EXPECT_NEAR(static_cast<double>(LeafReserve::readyChunks()), 5, 1);  // part of the current chunk was left
    const std::size_t ready = LeafReserve::readyChunks();
    EXPECT_EQ(addLeaves(leaves, 3 * kChunk), 0u);
    EXPECT_LT(LeafReserve::readyChunks(), ready) << "ready chunks are taken first";
    EXPECT_EQ(addLeaves(leaves, 8 * kChunk), 0u);
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
    first->begin();
    EXPECT_EQ(addLeaves(leaves, 4 * kChunk), 0u);
    first->refill();
  }
  first->wait();
  const std::size_t ready = LeafReserve::readyChunks();
  EXPECT_GT(ready, 0u);
  first.reset();
  EXPECT_EQ(LeafReserve::readyChunks(), ready);
}

TEST(LeafReserve, PreparesOnlyForWhatScansTook) {
  if (!newPackedVoxelsAreZero()) GTEST_SKIP() << "no pool in this build";
  Leaves leaves;
  LeafReserve reserve;
  for (int scan = 0; scan < 3; ++scan) {
    EXPECT_EQ(addLeaves(leaves, 6 * kChunk), 0u);  // another map is read from its file
    reserve.begin();
    reserve.refill();
    reserve.wait();
  }
  EXPECT_EQ(LeafReserve::readyChunks(), 0u);
}

std::set<std::uintptr_t> pagesOf(const Leaves& leaves, std::uintptr_t page_bytes) {
  std::set<std::uintptr_t> pages;
  for (const auto& leaf : leaves) pages.insert(reinterpret_cast<std::uintptr_t>(plainValues(*leaf)) / page_bytes);
  return pages;
}

/// How many of them are in memory, by the kernel's own table.
std::size_t residentAmong(const std::set<std::uintptr_t>& pages) {
  const int table = ::open("/proc/self/pagemap", O_RDONLY | O_CLOEXEC);
  const auto isResident = [table](std::uintptr_t page) {
    std::uint64_t entry = 0;
    const auto got = ::pread(table, &entry, sizeof entry, static_cast<off_t>(page * sizeof entry));
    return got == static_cast<ssize_t>(sizeof entry) && (entry >> 63) != 0;
  };
  const auto count = static_cast<std::size_t>(std::count_if(pages.begin(), pages.end(), isResident));
  ::close(table);
  return count;
}

// Tiles of a rolling field: scan by scan their leaves lie in the same chunks.
TEST(LeafReserve, WhatOneOfSeveralMapsFreesIsTheSystemsAgain) {
  if (!newPackedVoxelsAreZero()) GTEST_SKIP() << "no pool in this build";
  const LeafReserve one, other;
  Leaves leaving, staying;
  for (int turn = 0; turn < 40; ++turn) {
    addLeaves(leaving, 100);
    addLeaves(staying, 100);
  }
  const auto page_bytes = static_cast<std::uintptr_t>(::sysconf(_SC_PAGESIZE));
  const std::set<std::uintptr_t> gone = pagesOf(leaving, page_bytes), kept = pagesOf(staying, page_bytes);
  ASSERT_EQ(residentAmong(gone), gone.size());
  leaving.clear();
  // What is left are pieces at both ends of a hundred leaves, which hold leaves of the other map, too.
  EXPECT_LT(residentAmong(gone), gone.size() / 8);
  EXPECT_EQ(residentAmong(kept), kept.size());
  for (const auto& leaf : staying) {
    const std::uint32_t* values = plainValues(*leaf);
    ASSERT_TRUE(std::all_of(values, values + 512, [](std::uint32_t v) { return v == 0xdeadbeefu; }));
  }
  EXPECT_EQ(addLeaves(leaving, 5000), 0u);
}

}  // namespace
}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/fresh_points.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <atomic>
#include <numeric>

namespace accessvdb::internal {
namespace {

constexpr std::size_t kPointsPerTask = 512, kLeavesPerTask = 256;

/// Several threads may work on the leaves and points of one leaf group.
bool setBit(LeafBits& bits, std::size_t n) {
  const std::uint64_t bit = std::uint64_t{1} << (n & 63);
  return (std::atomic_ref(bits[n >> 6]).fetch_or(bit, std::memory_order_relaxed) & bit) == 0;
}
void clearBit(LeafBits& bits, std::size_t n) {
  std::atomic_ref(bits[n >> 6]).fetch_and(~(std::uint64_t{1} << (n & 63)), std::memory_order_seq_cst);
}
bool testBit(LeafBits& bits, std::size_t n) {
  return (std::atomic_ref(bits[n >> 6]).load(std::memory_order_relaxed) >> (n & 63) & 1u) != 0;
}
bool noneOf(LeafBits& bits) {
  std::uint64_t any = 0;
  for (std::uint64_t& word : bits) any |= std::atomic_ref(word).load(std::memory_order_seq_cst);
  return any == 0;
}

}  // namespace

void FreshPoints::add(std::span<const std::uint32_t> ids) {
  const SurfaceIndex& index = points_.index();
  leaf_groups_.grow(index.leafGroups());
  of_blocks_.grow(index.blocks().size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, ids.size(), kPointsPerTask), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      const std::uint32_t block = points_.blockOf(ids[n]);
      setBit(of_blocks_[block], bitInParent(points_.voxelOf(points_.first_L(ids[n]))));
      const PointBlock& place = index.blocks()[block];
      setBit(leaf_groups_[place.leaf_group].fresh, bitInParent(place.leaf));
    }
  });
}

void FreshPoints::noteReached(std::span<const Index3> leaves) {
  if (all_reached_) return;
  std::vector<LeafCode>& reached = reached_.local();
  Index3 leaf_group = {};
  std::uint32_t number = kNone;
  bool any = false;
  for (const Index3& leaf : leaves) {
    const Index3 here = parentOf(leaf);
    if (!any || here != leaf_group) {  // a return's leaves are consecutive
      any = true;
      leaf_group = here;
      number = points_.index().leafGroupAt(leaf_group);
    }
    if (number >= leaf_groups_.size()) continue;  // no points, or none admitted yet
    const std::size_t bit = bitInParent(leaf);
    FreshLeafGroup& of = leaf_groups_[number];
    if (!testBit(of.fresh, bit) || testBit(of.reached, bit) || !setBit(of.reached, bit)) continue;
    reached.push_back(LeafCode{number} << 9 | bit);
  }
}

void FreshPoints::takeReached(FreshPlaces& places) {
  std::vector<LeafCode> leaves;
  for (std::vector<LeafCode>& of_thread : reached_) {
    leaves.insert(leaves.end(), of_thread.begin(), of_thread.end());
    of_thread.clear();
  }
  if (all_reached_) {
    leaves.clear();
    for (std::size_t leaf_group = 0; leaf_group < leaf_groups_.size(); ++leaf_group) {
      for (std::size_t bit = 0; bit < 512; ++bit) {
        if (testBit(leaf_groups_[leaf_group].fresh, bit)) leaves.push_back(LeafCode{leaf_group} << 9 | bit);
      }
    }
  }
  all_reached_ = false;
  // Sorted by position, which is the fastest order for reading the map.
  tbb::parallel_sort(leaves);

  const std::size_t tasks = (leaves.size() + kLeavesPerTask - 1) / kLeavesPerTask;
  std::vector<FreshPlaces> of_task(tasks);
  tbb::parallel_for(std::size_t{0}, tasks, [&](std::size_t task) {
    FreshPlaces& found = of_task[task];
    const std::size_t end = std::min(leaves.size(), (task + 1) * kLeavesPerTask);
    for (std::size_t n = task * kLeavesPerTask; n < end; ++n) {
      const auto leaf_group = static_cast<std::uint32_t>(leaves[n] >> 9);
      const std::size_t bit = leaves[n] & 511;
      clearBit(leaf_groups_[leaf_group].reached, bit);
      const std::uint32_t block = points_.index().blockIn(leaf_group, bit);
      const Index3 leaf = points_.index().blocks()[block].leaf;
      for (std::size_t x = 0; x < 8; ++x) {
        for (std::uint64_t bits = of_blocks_[block][x]; bits != 0; bits &= bits - 1) {
          const int at = std::countr_zero(bits);
          found.voxels.push_back(
              {leaf[0] * 8 + static_cast<std::int32_t>(x), leaf[1] * 8 + (at >> 3), leaf[2] * 8 + (at & 7)});
          found.blocks.push_back(block);
        }
      }
    }
  });
  std::vector<std::size_t> begin(tasks + 1, 0);
  for (std::size_t task = 0; task < tasks; ++task) begin[task + 1] = begin[task] + of_task[task].voxels.size();
  places.voxels.resize(begin[tasks]);
  places.blocks.resize(begin[tasks]);
  tbb::parallel_for(std::size_t{0}, tasks, [&](std::size_t task) {
    const auto at = static_cast<std::ptrdiff_t>(begin[task]);
    std::ranges::copy(of_task[task].voxels, places.voxels.begin() + at);
    std::ranges::copy(of_task[task].blocks, places.blocks.begin() + at);
  });
}

void FreshPoints::remove(const FreshPlaces& places, std::span<const std::uint32_t> entries) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, entries.size(), kPointsPerTask), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      const std::uint32_t block = places.blocks[entries[n]];
      clearBit(of_blocks_[block], bitInParent(places.voxels[entries[n]]));
      // Whichever thread removes the last one sees that nothing is left.
      if (!noneOf(of_blocks_[block])) continue;
      const PointBlock& place = points_.index().blocks()[block];
      clearBit(leaf_groups_[place.leaf_group].fresh, bitInParent(place.leaf));
    }
  });
}

std::uint64_t FreshPoints::bytes() const {
  std::uint64_t bytes = leaf_groups_.bytes() + of_blocks_.bytes();
  for (const std::vector<LeafCode>& of_thread : reached_) bytes += of_thread.capacity() * sizeof(LeafCode);
  return bytes;
}

}  // namespace accessvdb::internal

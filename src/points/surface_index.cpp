// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/surface_index.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>

#include "processor/prefetch.h"

namespace accessvdb::internal {
namespace {

constexpr std::size_t kAdditionsPerTask = 64;
constexpr std::size_t kLocatedTogether = 32;
/// Blocks are scattered in memory: each is prefetched this many additions ahead of its use, and its ids after it.
constexpr std::size_t kAdditionsAhead = 8, kIdsAhead = 4;

bool testBit(const LeafBits& bits, std::size_t n) { return (bits[n >> 6] >> (n & 63) & 1u) != 0; }

/// Number of set bits below bit n.
std::size_t rankOf(const LeafBits& bits, std::size_t n) {
  std::size_t rank = 0;
  for (std::size_t word = 0; word < n >> 6; ++word) rank += static_cast<std::size_t>(std::popcount(bits[word]));
  return rank + static_cast<std::size_t>(std::popcount(bits[n >> 6] & ((std::uint64_t{1} << (n & 63)) - 1)));
}

}  // namespace

std::uint32_t SurfaceIndex::blockAt(const Index3& leaf) const {
  const std::uint32_t leaf_group = leaf_group_of_.find(parentOf(leaf));
  return leaf_group == kNone ? kNone : leaf_groups_[leaf_group].block[bitInParent(leaf)];
}

std::uint32_t SurfaceIndex::find(const Index3& voxel) const {
  const std::uint32_t block = blockAt(parentOf(voxel));
  return block == kNone ? kNone : findIn(block, voxel);
}

std::uint32_t SurfaceIndex::findIn(std::uint32_t block, const Index3& voxel) const {
  const PointBlock& points = blocks_[block];
  const std::size_t bit = bitInParent(voxel);
  return testBit(points.occupied, bit) ? points.ids[rankOf(points.occupied, bit)] : kNone;
}

void SurfaceIndex::locate(std::span<const Index3> voxels, std::span<Located> found) const {
  for (std::size_t n = 0; n < voxels.size(); n += kLocatedTogether) {
    const std::size_t count = std::min(kLocatedTogether, voxels.size() - n);
    locateFew(voxels.subspan(n, count), found.subspan(n, count));
  }
}

/// Each loop prefetches what the next one reads.
void SurfaceIndex::locateFew(std::span<const Index3> voxels, std::span<Located> found) const {
  std::array<const std::uint32_t*, kLocatedTogether> entries;
  for (std::size_t n = 0; n < voxels.size(); ++n) {
    const Index3 leaf = parentOf(voxels[n]);
    const std::uint32_t leaf_group = leaf_group_of_.find(parentOf(leaf));
    entries[n] = leaf_group == kNone ? nullptr : &leaf_groups_[leaf_group].block[bitInParent(leaf)];
    if (entries[n] != nullptr) prefetchRead(entries[n]);
  }
  for (std::size_t n = 0; n < voxels.size(); ++n) {
    found[n].block = entries[n] == nullptr ? kNone : *entries[n];
    if (found[n].block == kNone) continue;
    const PointBlock& block = blocks_[found[n].block];
    prefetchRead(&block.ids);
    prefetchRead(&block.occupied[bitInParent(voxels[n]) >> 6]);
  }
  for (std::size_t n = 0; n < voxels.size(); ++n) {
    found[n].id = found[n].block == kNone ? kNone : findIn(found[n].block, voxels[n]);
  }
}

void SurfaceIndex::listAdditions(std::span<const NewVoxel> points) {
  const auto sameLeaf = [](const Index3& a, const Index3& b) {
    return (((a[0] ^ b[0]) | (a[1] ^ b[1]) | (a[2] ^ b[2])) & ~7) == 0;
  };
  additions_.clear();
  const auto count = static_cast<std::uint32_t>(points.size());
  for (std::uint32_t n = 0; n < count;) {
    const std::uint32_t begin = n;
    do ++n;
    while (n < count && sameLeaf(points[n].voxel, points[begin].voxel));
    additions_.push_back({begin, n});
  }
}

void SurfaceIndex::findBlock(Addition& addition, std::span<const NewVoxel> points) const {
  const NewVoxel& first = points[addition.begin];
  addition.block = first.block;
  if (addition.block == kNone) {
    const Index3 leaf = parentOf(first.voxel);
    addition.leaf_group = leaf_group_of_.find(parentOf(leaf));
    if (addition.leaf_group != kNone) addition.block = leaf_groups_[addition.leaf_group].block[bitInParent(leaf)];
  }
  if (addition.block != kNone) addition.ids_before = static_cast<std::uint32_t>(blocks_[addition.block].ids.size());
}

/// Assigns blocks to the additions without one. Blocks and leaf groups are numbered in the order of the additions.
void SurfaceIndex::makeBlocks(std::span<Addition> additions, std::span<const NewVoxel> points) {
  const std::size_t blocks_before = blocks_.size(), leaf_groups_before = leaf_groups_.size();
  std::size_t num_blocks = blocks_before, num_leaf_groups = leaf_groups_before;
  const auto leafOf = [&](const Addition& addition) { return parentOf(points[addition.begin].voxel); };
  for (Addition& addition : additions) {
    if (addition.block != kNone) continue;
    addition.block = static_cast<std::uint32_t>(num_blocks++);
    if (addition.leaf_group != kNone) continue;
    const auto [number, is_new] =
        leaf_group_of_.insert(parentOf(leafOf(addition)), static_cast<std::uint32_t>(num_leaf_groups));
    addition.leaf_group = number;
    num_leaf_groups += is_new ? 1 : 0;
  }
  blocks_.growRaw(num_blocks);
  leaf_groups_.growRaw(num_leaf_groups);
  tbb::parallel_for(leaf_groups_before, num_leaf_groups,
                    [&](std::size_t leaf_group) { leaf_groups_[leaf_group].block.fill(kNone); });
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, additions.size(), kAdditionsPerTask), [&](const auto& range) {
    for (std::size_t g = range.begin(); g != range.end(); ++g) {
      Addition& addition = additions[g];
      if (addition.block < blocks_before) continue;
      PointBlock& block = blocks_[addition.block];
      block.leaf = leafOf(addition);
      block.leaf_group = addition.leaf_group;
      LeafGroup& leaf_group = leaf_groups_[addition.leaf_group];
      const std::size_t bit = bitInParent(block.leaf);
      leaf_group.block[bit] = addition.block;
      // Other threads may be working on other blocks of the leaf group.
      std::atomic_ref(leaf_group.present[bit >> 6]).fetch_or(std::uint64_t{1} << (bit & 63), std::memory_order_relaxed);
    }
  });
}

/// Allocates runs for blocks that outgrow theirs.
void SurfaceIndex::takeRuns(std::span<Addition> additions) {
  for (Addition& addition : additions) {
    const std::size_t capacity = IdRuns::capacityFor(addition.ids_before + (addition.end - addition.begin));
    if (capacity > IdRuns::capacityFor(addition.ids_before)) addition.larger_run = runs_.take(capacity);
  }
}

void SurfaceIndex::addTo(const Addition& addition, std::span<NewVoxel> points) {
  PointBlock& to = blocks_[addition.block];
  LeafBits added = {};
  for (std::uint32_t n = addition.begin; n < addition.end; ++n) {
    const std::size_t bit = bitInParent(points[n].voxel);
    added[bit >> 6] |= std::uint64_t{1} << (bit & 63);
    points[n].block = addition.block;
  }
  // From the back: each id moves up by the number of new points before it.
  std::size_t from = to.ids.size(), left = addition.end - addition.begin;
  const std::uint32_t* const ids = to.ids.data();
  std::uint32_t* const run = addition.larger_run != nullptr ? addition.larger_run : to.ids.data();
  to.ids = {run, from + left};
  for (std::size_t word = to.occupied.size(); word-- > 0 && left > 0;) {
    for (std::uint64_t bits = to.occupied[word] | added[word]; bits != 0 && left > 0;) {
      const std::uint64_t last = std::bit_floor(bits);
      bits &= ~last;
      const bool is_new = (added[word] & last) != 0;
      run[from + left - 1] = is_new ? points[addition.begin + left - 1].id : ids[from - 1];
      --(is_new ? left : from);
    }
  }
  if (run != ids) std::copy_n(ids, from, run);  // ids before all new ones
  for (std::size_t word = 0; word < added.size(); ++word) to.occupied[word] |= added[word];
}

std::uint32_t SurfaceIndex::insert(const Index3& voxel, std::uint32_t id) {
  NewVoxel point = {voxel, id, kNone};
  insertAll({&point, 1});
  return point.block;
}

void SurfaceIndex::insertAll(std::span<NewVoxel> points) {
  listAdditions(points);
  const std::span<Addition> additions = additions_;
  const tbb::blocked_range<std::size_t> all(0, additions.size(), kAdditionsPerTask);
  tbb::parallel_for(all, [&](const auto& range) {
    for (std::size_t g = range.begin(); g != range.end(); ++g) {
      findBlock(additions[g], points);
    }
  });
  makeBlocks(additions, points);
  takeRuns(additions);
  outgrown_.assign(additions.size(), nullptr);
  tbb::parallel_for(all, [&](const auto& range) {
    for (std::size_t g = range.begin(); g != range.end(); ++g) {
      if (g + kAdditionsAhead < range.end())
        prefetchRead(&blocks_[additions[g + kAdditionsAhead].block], sizeof(PointBlock));
      if (g + kIdsAhead < range.end()) prefetchRead(blocks_[additions[g + kIdsAhead].block].ids.data());
      if (additions[g].larger_run != nullptr) outgrown_[g] = blocks_[additions[g].block].ids.data();
      addTo(additions[g], points);
    }
  });
  for (std::size_t g = 0; g < additions.size(); ++g) {
    if (outgrown_[g] != nullptr) runs_.giveBack(outgrown_[g], IdRuns::capacityFor(additions[g].ids_before));
  }
}

void SurfaceIndex::blocksOfLastInsert(std::vector<std::uint32_t>& blocks) const {
  blocks.resize(additions_.size());
  for (std::size_t g = 0; g < additions_.size(); ++g) blocks[g] = additions_[g].block;
}

std::uint64_t SurfaceIndex::bytes() const {
  return leaf_group_of_.bytes() + leaf_groups_.bytes() + blocks_.bytes() + runs_.bytes() +
         additions_.capacity() * sizeof(Addition) + outgrown_.capacity() * sizeof(outgrown_[0]);
}

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/surface_index.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>

#include "points/prefetch.h"

namespace accessvdb::internal {
namespace {

constexpr std::size_t kGroupsPerTask = 64;
constexpr std::size_t kLocatedTogether = 32;
/// Blocks are scattered in memory: each is prefetched this many groups ahead of its use, and its ids after it.
constexpr std::size_t kGroupsAhead = 8, kIdsAhead = 4;

bool testBit(const LeafBits& bits, std::size_t n) { return (bits[n >> 6] >> (n & 63) & 1u) != 0; }

/// Number of set bits below bit n.
std::size_t rankOf(const LeafBits& bits, std::size_t n) {
  std::size_t rank = 0;
  for (std::size_t word = 0; word < n >> 6; ++word) rank += static_cast<std::size_t>(std::popcount(bits[word]));
  return rank + static_cast<std::size_t>(std::popcount(bits[n >> 6] & ((std::uint64_t{1} << (n & 63)) - 1)));
}

}  // namespace

std::uint32_t SurfaceIndex::blockAt(const Index3& leaf) const {
  const std::uint32_t cell = cell_of_.find(parentOf(leaf));
  return cell == kNone ? kNone : cells_[cell].block[bitInParent(leaf)];
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
    const std::uint32_t cell = cell_of_.find(parentOf(leaf));
    entries[n] = cell == kNone ? nullptr : &cells_[cell].block[bitInParent(leaf)];
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

void SurfaceIndex::groupByLeaf(std::span<const NewVoxel> points) {
  const auto sameLeaf = [](const Index3& a, const Index3& b) {
    return (((a[0] ^ b[0]) | (a[1] ^ b[1]) | (a[2] ^ b[2])) & ~7) == 0;
  };
  groups_.clear();
  const auto count = static_cast<std::uint32_t>(points.size());
  for (std::uint32_t n = 0; n < count;) {
    const std::uint32_t begin = n;
    do ++n;
    while (n < count && sameLeaf(points[n].voxel, points[begin].voxel));
    groups_.push_back({begin, n});
  }
}

void SurfaceIndex::findBlock(Group& group, std::span<const NewVoxel> points) const {
  const NewVoxel& first = points[group.begin];
  group.block = first.block;
  if (group.block == kNone) {
    const Index3 leaf = parentOf(first.voxel);
    group.cell = cell_of_.find(parentOf(leaf));
    if (group.cell != kNone) group.block = cells_[group.cell].block[bitInParent(leaf)];
  }
  if (group.block != kNone) group.ids_before = static_cast<std::uint32_t>(blocks_[group.block].ids.size());
}

/// Assigns blocks to the groups without one. Blocks and cells are numbered in the order of the groups.
void SurfaceIndex::makeBlocks(std::span<Group> groups, std::span<const NewVoxel> points) {
  const std::size_t blocks_before = blocks_.size(), cells_before = cells_.size();
  std::size_t num_blocks = blocks_before, num_cells = cells_before;
  const auto leafOf = [&](const Group& group) { return parentOf(points[group.begin].voxel); };
  for (Group& group : groups) {
    if (group.block != kNone) continue;
    group.block = static_cast<std::uint32_t>(num_blocks++);
    if (group.cell != kNone) continue;
    const auto [number, is_new] = cell_of_.insert(parentOf(leafOf(group)), static_cast<std::uint32_t>(num_cells));
    group.cell = number;
    num_cells += is_new ? 1 : 0;
  }
  blocks_.growRaw(num_blocks);
  cells_.growRaw(num_cells);
  tbb::parallel_for(cells_before, num_cells, [&](std::size_t cell) { cells_[cell].block.fill(kNone); });
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, groups.size(), kGroupsPerTask), [&](const auto& range) {
    for (std::size_t g = range.begin(); g != range.end(); ++g) {
      Group& group = groups[g];
      if (group.block < blocks_before) continue;
      PointBlock& block = blocks_[group.block];
      block.leaf = leafOf(group);
      block.cell = group.cell;
      Cell& cell = cells_[group.cell];
      const std::size_t bit = bitInParent(block.leaf);
      cell.block[bit] = group.block;
      // Other threads may be working on other blocks of the cell.
      std::atomic_ref(cell.present[bit >> 6]).fetch_or(std::uint64_t{1} << (bit & 63), std::memory_order_relaxed);
    }
  });
}

/// Allocates runs for blocks that outgrow theirs.
void SurfaceIndex::takeRuns(std::span<Group> groups) {
  for (Group& group : groups) {
    const std::size_t capacity = IdRuns::capacityFor(group.ids_before + (group.end - group.begin));
    if (capacity > IdRuns::capacityFor(group.ids_before)) group.larger_run = runs_.take(capacity);
  }
}

void SurfaceIndex::addTo(const Group& group, std::span<NewVoxel> points) {
  PointBlock& to = blocks_[group.block];
  LeafBits added = {};
  for (std::uint32_t n = group.begin; n < group.end; ++n) {
    const std::size_t bit = bitInParent(points[n].voxel);
    added[bit >> 6] |= std::uint64_t{1} << (bit & 63);
    points[n].block = group.block;
  }
  // From the back: each id moves up by the number of new points before it.
  std::size_t from = to.ids.size(), left = group.end - group.begin;
  const std::uint32_t* const ids = to.ids.data();
  std::uint32_t* const run = group.larger_run != nullptr ? group.larger_run : to.ids.data();
  to.ids = {run, from + left};
  for (std::size_t word = to.occupied.size(); word-- > 0 && left > 0;) {
    for (std::uint64_t bits = to.occupied[word] | added[word]; bits != 0 && left > 0;) {
      const std::uint64_t last = std::bit_floor(bits);
      bits &= ~last;
      const bool is_new = (added[word] & last) != 0;
      run[from + left - 1] = is_new ? points[group.begin + left - 1].id : ids[from - 1];
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
  groupByLeaf(points);
  const std::span<Group> groups = groups_;
  const tbb::blocked_range<std::size_t> all(0, groups.size(), kGroupsPerTask);
  tbb::parallel_for(all, [&](const auto& range) {
    for (std::size_t g = range.begin(); g != range.end(); ++g) {
      findBlock(groups[g], points);
    }
  });
  makeBlocks(groups, points);
  takeRuns(groups);
  outgrown_.assign(groups.size(), nullptr);
  tbb::parallel_for(all, [&](const auto& range) {
    for (std::size_t g = range.begin(); g != range.end(); ++g) {
      if (g + kGroupsAhead < range.end()) prefetchRead(&blocks_[groups[g + kGroupsAhead].block], sizeof(PointBlock));
      if (g + kIdsAhead < range.end()) prefetchRead(blocks_[groups[g + kIdsAhead].block].ids.data());
      if (groups[g].larger_run != nullptr) outgrown_[g] = blocks_[groups[g].block].ids.data();
      addTo(groups[g], points);
    }
  });
  for (std::size_t g = 0; g < groups.size(); ++g) {
    if (outgrown_[g] != nullptr) runs_.giveBack(outgrown_[g], IdRuns::capacityFor(groups[g].ids_before));
  }
}

void SurfaceIndex::blocksOfLastInsert(std::vector<std::uint32_t>& blocks) const {
  blocks.resize(groups_.size());
  for (std::size_t g = 0; g < groups_.size(); ++g) blocks[g] = groups_[g].block;
}

std::uint64_t SurfaceIndex::bytes() const {
  return cell_of_.bytes() + cells_.bytes() + blocks_.bytes() + runs_.bytes() + groups_.capacity() * sizeof(Group) +
         outgrown_.capacity() * sizeof(outgrown_[0]);
}

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/surface_index.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>

namespace accessvdb::internal {
namespace {

constexpr std::size_t kPointsPerTask = 256;

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
  return cell == kNone ? kNone : cells_[cell]->block[bitInParent(leaf)];
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

std::uint32_t SurfaceIndex::makeBlock(const Index3& leaf) {
  const auto [number, is_new] = cell_of_.insert(parentOf(leaf), static_cast<std::uint32_t>(cells_.size()));
  if (is_new) {
    cells_.push_back(std::make_unique<Cell>());
    cells_.back()->block.fill(kNone);
  }
  Cell& cell = *cells_[number];
  const std::size_t bit = bitInParent(leaf);
  if (cell.block[bit] == kNone) {
    cell.block[bit] = static_cast<std::uint32_t>(blocks_.size());
    cell.present[bit >> 6] |= std::uint64_t{1} << (bit & 63);
    blocks_.push_back({leaf, number, {}, {}});
  }
  return cell.block[bit];
}

void SurfaceIndex::addTo(std::uint32_t block, std::span<const NewVoxel* const> points) {
  PointBlock& to = blocks_[block];
  LeafBits added = {};
  for (const NewVoxel* point : points) {
    const std::size_t bit = bitInParent(point->voxel);
    added[bit >> 6] |= std::uint64_t{1} << (bit & 63);
  }
  // From the back: each id moves up by the number of points that come before it.
  std::size_t from = to.ids.size(), left = points.size();
  to.ids.resize(from + left);
  for (std::size_t word = to.occupied.size(); word-- > 0 && left > 0;) {
    for (std::uint64_t bits = to.occupied[word] | added[word]; bits != 0 && left > 0;) {
      const std::uint64_t last = std::bit_floor(bits);
      bits &= ~last;
      to.ids[from + left - 1] = (added[word] & last) != 0 ? points[left - 1]->id : to.ids[from - 1];
      --((added[word] & last) != 0 ? left : from);
    }
  }
  for (std::size_t word = 0; word < added.size(); ++word) to.occupied[word] |= added[word];
}

std::uint32_t SurfaceIndex::insert(const Index3& voxel, std::uint32_t id) {
  const NewVoxel point = {voxel, id, makeBlock(parentOf(voxel))};
  const NewVoxel* const points[] = {&point};
  addTo(point.block, points);
  return point.block;
}

void SurfaceIndex::insertAll(std::span<NewVoxel> points) {
  const tbb::blocked_range<std::size_t> all(0, points.size(), kPointsPerTask);
  tbb::parallel_for(all, [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) points[n].block = blockAt(parentOf(points[n].voxel));
  });
  for (NewVoxel& point : points) {
    if (point.block == kNone) point.block = makeBlock(parentOf(point.voxel));
  }
  // By block and voxel; a block belongs to whom its first point belongs.
  std::vector<const NewVoxel*> order(points.size());
  for (std::size_t n = 0; n < points.size(); ++n) order[n] = &points[n];
  tbb::parallel_sort(order.begin(), order.end(), [](const NewVoxel* a, const NewVoxel* b) {
    return a->block != b->block ? a->block < b->block : bitInParent(a->voxel) < bitInParent(b->voxel);
  });
  tbb::parallel_for(all, [&](const auto& range) {
    for (std::size_t n = range.begin(); n < range.end(); ++n) {
      if (n > 0 && order[n - 1]->block == order[n]->block) continue;
      std::size_t end = n + 1;
      while (end < order.size() && order[end]->block == order[n]->block) ++end;
      addTo(order[n]->block, std::span(order).subspan(n, end - n));
    }
  });
}

std::uint64_t SurfaceIndex::bytes() const {
  std::uint64_t bytes =
      cell_of_.bytes() + cells_.size() * (sizeof(Cell) + 16) + blocks_.capacity() * sizeof(PointBlock);
  for (const PointBlock& block : blocks_) bytes += block.ids.capacity() * sizeof(std::uint32_t) + 16;
  return bytes;
}

}  // namespace accessvdb::internal

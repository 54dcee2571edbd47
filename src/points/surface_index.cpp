// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/surface_index.h"

#include <algorithm>

namespace accessvdb::internal {
namespace {

bool testBit(const LeafBits& bits, std::size_t n) { return (bits[n >> 6] >> (n & 63) & 1u) != 0; }

/// Number of set bits below bit n.
std::size_t rankOf(const LeafBits& bits, std::size_t n) {
  std::size_t rank = 0;
  for (std::size_t word = 0; word < n >> 6; ++word) rank += static_cast<std::size_t>(std::popcount(bits[word]));
  return rank + static_cast<std::size_t>(std::popcount(bits[n >> 6] & ((std::uint64_t{1} << (n & 63)) - 1)));
}

}  // namespace

std::uint64_t SurfaceIndex::cellKey(const Index3& cell) {
  constexpr std::int64_t kBias = 1 << 20;
  return static_cast<std::uint64_t>(cell[0] + kBias) << 42 | static_cast<std::uint64_t>(cell[1] + kBias) << 21 |
         static_cast<std::uint64_t>(cell[2] + kBias);
}

std::uint32_t SurfaceIndex::blockAt(const Index3& leaf) const {
  const auto found = cell_of_.find(cellKey(parentOf(leaf)));
  return found == cell_of_.end() ? kNone : cells_[found->second]->block[bitInParent(leaf)];
}

std::uint32_t SurfaceIndex::find(const Index3& voxel) const {
  const std::uint32_t block = blockAt(parentOf(voxel));
  if (block == kNone) return kNone;
  const std::size_t bit = bitInParent(voxel);
  return testBit(blocks_[block].occupied, bit) ? blocks_[block].ids[rankOf(blocks_[block].occupied, bit)] : kNone;
}

std::uint32_t SurfaceIndex::insert(const Index3& voxel, std::uint32_t id) {
  const Index3 leaf = parentOf(voxel);
  const auto [entry, is_new] = cell_of_.try_emplace(cellKey(parentOf(leaf)), static_cast<std::uint32_t>(cells_.size()));
  if (is_new) {
    cells_.push_back(std::make_unique<Cell>());
    cells_.back()->block.fill(kNone);
  }
  Cell& cell = *cells_[entry->second];
  const std::size_t block_bit = bitInParent(leaf);
  if (cell.block[block_bit] == kNone) {
    cell.block[block_bit] = static_cast<std::uint32_t>(blocks_.size());
    cell.present[block_bit >> 6] |= std::uint64_t{1} << (block_bit & 63);
    blocks_.push_back({leaf, {}, {}});
  }
  PointBlock& block = blocks_[cell.block[block_bit]];
  const std::size_t bit = bitInParent(voxel);
  block.ids.insert(block.ids.begin() + static_cast<std::ptrdiff_t>(rankOf(block.occupied, bit)), id);
  block.occupied[bit >> 6] |= std::uint64_t{1} << (bit & 63);
  return cell.block[block_bit];
}

std::uint64_t SurfaceIndex::bytes() const {
  std::uint64_t bytes = cells_.size() * (sizeof(Cell) + 64) + blocks_.capacity() * sizeof(PointBlock);
  for (const PointBlock& block : blocks_) bytes += block.ids.capacity() * sizeof(std::uint32_t) + 16;
  return bytes;
}

}  // namespace accessvdb::internal

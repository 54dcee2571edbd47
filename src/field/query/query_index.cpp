// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/query/query_index.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>

namespace accessvdb::internal {

void QueryIndex::place(const Slot& slot) {
  std::size_t n = slotOf(slot.key);
  while (slots_[n].leaf_group != nullptr) n = (n + 1) & (slots_.size() - 1);
  slots_[n] = slot;
}

QueryIndex::LeafGroup& QueryIndex::leafGroupFor(const Index3& leaf_group) {
  if (const LeafGroup* found = leafGroupAt(leaf_group)) return const_cast<LeafGroup&>(*found);
  if (2 * (leaf_groups_.size() + 1) > slots_.size()) {
    std::vector<Slot> before(std::max<std::size_t>(64, 2 * slots_.size()));
    before.swap(slots_);
    for (const Slot& slot : before) {
      if (slot.leaf_group != nullptr) place(slot);
    }
  }
  leaf_groups_.push_back(std::make_unique<LeafGroup>());
  place({kernels::placeKey(leaf_group[0], leaf_group[1], leaf_group[2]), leaf_groups_.back().get()});
  return *leaf_groups_.back();
}

void QueryIndex::extend(const PointStore& points) {
  const ChunkedArray<PointBlock>& sources = points.index().blocks();
  for (std::size_t n = blocks_.size(); n < sources.size(); ++n) {
    const Index3& leaf = sources[n].leaf;
    const std::size_t bit = bitInParent(leaf);
    LeafGroup& leaf_group = leafGroupFor(parentOf(leaf));
    leaf_group.present[bit >> 6] |= std::uint64_t{1} << (bit & 63);
    leaf_group.block[bit] = static_cast<std::uint32_t>(n);
  }
  blocks_.resize(sources.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, sources.size(), 256), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      const PointBlock& source = sources[n];
      Block& block = blocks_[n];
      if (block.entries.size() == source.ids.size()) continue;  // points are only ever added
      block.leaf = source.leaf;
      block.occupied = source.occupied;
      std::uint16_t below = 0;
      for (std::size_t word = 0; word < block.below.size(); ++word) {
        block.below[word] = below;
        below = static_cast<std::uint16_t>(below + std::popcount(block.occupied[word]));
      }
      block.entries.clear();
      block.entries.reserve(source.ids.size());
      for (const std::uint32_t id : source.ids) {
        const Eigen::Vector3f& p_L = points.first_L(id);
        block.entries.push_back({{p_L.x(), p_L.y(), p_L.z()}, id});
      }
    }
  });
}

std::uint64_t QueryIndex::bytes() const {
  std::uint64_t bytes =
      leaf_groups_.size() * sizeof(LeafGroup) + slots_.capacity() * sizeof(Slot) + blocks_.capacity() * sizeof(Block);
  for (const Block& block : blocks_) bytes += block.entries.capacity() * sizeof(Entry);
  return bytes;
}

}  // namespace accessvdb::internal

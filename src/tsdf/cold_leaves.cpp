// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/cold_leaves.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstring>
#include <new>

namespace accessvdb::internal {
namespace {

constexpr std::size_t kLeavesAtOnce = 64;
/// How many leaves ahead of its use data is asked for.
constexpr std::size_t kColdLeafAhead = 8, kColdValuesAhead = 3;

std::uint32_t placeOf(const PackedLeaf& leaf) { return PackedLowerNode::coordToOffset(leaf.origin()); }

}  // namespace

ColdLeaves::Node& ColdLeaves::nodeOf(std::size_t bucket, const PackedLowerNode* node) {
  std::unique_ptr<Node>& found = buckets_[bucket].nodes[node];
  if (!found) found = std::make_unique<Node>();
  return *found;
}

void ColdLeaves::notePlain(std::size_t bucket, Node& node, PackedLeaf& leaf) noexcept {
  Bucket& of = buckets_[bucket];
  const std::uint32_t place = placeOf(leaf);
  node.touched[place / 64] &= ~(std::uint64_t{1} << place % 64);
  try {
    of.plain[of.turn].push_back({&leaf, &node});
  } catch (const std::bad_alloc&) {  // whoever needs the memory reports it
  }
}

void ColdLeaves::look(std::size_t bucket, std::mutex& leaves) {
  Bucket& of = buckets_[bucket];
  of.turn = (of.turn + 1) % kPatience;
  std::vector<Plain>& due = of.plain[of.turn];
  const auto cold = std::partition(due.begin(), due.end(), [](const Plain& plain) {
    const std::uint32_t place = placeOf(*plain.leaf);
    std::uint64_t& word = plain.node->touched[place / 64];
    const std::uint64_t bit = std::uint64_t{1} << place % 64;
    const bool is_touched = (word & bit) != 0;
    word &= ~bit;
    return is_touched;
  });
  makeCompactFrom(due, static_cast<std::size_t>(cold - due.begin()), leaves);
}

/// @param first  of the leaves that are cold; they are no longer listed
void ColdLeaves::makeCompactFrom(std::vector<Plain>& plain, std::size_t first, std::mutex& leaves) {
  std::array<const CompactLeaf*, kLeavesAtOnce> blocks;
  std::array<void*, kLeavesAtOnce> buffers;
  std::size_t done = first;
  bool has_memory = true;
  while (has_memory && done < plain.size()) {
    const std::size_t begin = done;
    std::size_t count = 0;
    for (; done < plain.size() && done - begin < kLeavesAtOnce; ++done) {
      if (done + kColdLeafAhead < plain.size()) prefetchRead(plain[done + kColdLeafAhead].leaf, sizeof(PackedLeaf));
      if (done + kColdValuesAhead < plain.size()) {
        prefetchRead(plainValues(*plain[done + kColdValuesAhead].leaf), PackedLeaf::SIZE * sizeof(PackedVoxel));
      }
      try {
        blocks[done - begin] = makeCompact(plainValues(*plain[done].leaf));
      } catch (const std::bad_alloc&) {  // the others stay; whoever needs memory reports it
        has_memory = false;
        break;
      }
    }
    std::uint64_t bytes = 0;
    {
      const std::lock_guard lock(leaves);
      for (std::size_t n = begin; n < done; ++n) {
        const CompactLeaf* const block = blocks[n - begin];
        if (block == nullptr) continue;  // not worth it
        bytes += block->bytes;
        buffers[count++] = putCompact(*plain[n].leaf, block);
      }
    }
    PackedVoxel::recycle({buffers.data(), count});
    leaves_ += count;
    bytes_ += bytes;
  }
  plain.erase(plain.begin() + static_cast<std::ptrdiff_t>(first), plain.begin() + static_cast<std::ptrdiff_t>(done));
}

bool ColdLeaves::rest() {
  const bool any = std::ranges::any_of(buckets_, [](const Bucket& bucket) {
    return std::ranges::any_of(bucket.plain, [](const auto& plain) { return !plain.empty(); });
  });
  if (!any) return false;
  const std::uint64_t compact_before = leaves_;
  tbb::parallel_for(std::size_t{0}, kBuckets, [this](std::size_t bucket) {
    std::mutex nobodys;
    look(bucket, nobodys);
  });
  return leaves_ != compact_before;
}

void ColdLeaves::forget() noexcept {
  for (Bucket& bucket : buckets_) {
    for (std::vector<Plain>& plain : bucket.plain) plain.clear();
    bucket.nodes.clear();
  }
}

void ColdLeaves::makeAllCompact() {
  std::mutex nobodys;
  for (Bucket& bucket : buckets_) {
    for (std::vector<Plain>& plain : bucket.plain) makeCompactFrom(plain, 0, nobodys);
  }
}

void ColdLeaves::makePlain(PackedLeaf& leaf) {
  bytes_ -= internal::makePlain(leaf);
  --leaves_;
}

void ColdLeaves::put(PackedLeaf& leaf, const std::uint32_t* values) {
  if (const CompactLeaf* block = makeCompact(values)) {
    bytes_ += block->bytes;
    ++leaves_;
    static_cast<void>(putCompact(leaf, block));
  } else {
    leaf.buffer().allocate();
    std::memcpy(plainValues(leaf), values, PackedLeaf::SIZE * sizeof(PackedVoxel));
  }
}

}  // namespace accessvdb::internal

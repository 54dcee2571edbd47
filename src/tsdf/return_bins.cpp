// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/return_bins.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <optional>

namespace accessvdb::internal {
namespace {

using kernels::RegionSlices;

/// Small enough that many threads get equal shares of one scan.
constexpr std::size_t kReturnsPerChunk = 256;

std::uint64_t mix(std::uint64_t key) {
  key ^= key >> 31;
  key *= 0x9e3779b97f4a7c15ull;
  return key ^ key >> 29;
}

constexpr std::uint64_t kInNode = std::uint64_t{kNodeEdge - 1} * (1 | 1ull << 21 | 1ull << 42);
static_assert(kLeafKeyBias % kNodeEdge == 0, "the key of a node's lowest leaf has zeros for its place");

LeafKey nodeOf(LeafKey key) { return key & ~kInNode; }

/// OpenVDB's order: x slowest.
std::uint32_t placeInNode(LeafKey key) {
  const auto axis = [&](int shift) { return static_cast<std::uint32_t>(key >> shift) & (kNodeEdge - 1); };
  return (axis(42) * kNodeEdge + axis(21)) * kNodeEdge + axis(0);
}

}  // namespace

/// Buckets hold whole nodes.
std::size_t ReturnBins::bucketOf(LeafKey key) { return mix(nodeOf(key)) >> 56; }
static_assert(ReturnBins::kBuckets == 256, "bucketOf() takes eight bits");

std::array<std::int32_t, 3> originOf(LeafKey key) {
  constexpr std::uint64_t kAxis = (1ull << 21) - 1;
  const auto axis = [&](int shift) {
    return static_cast<std::int32_t>(static_cast<std::int64_t>(key >> shift & kAxis) - kLeafKeyBias) * 8;
  };
  return {axis(42), axis(21), axis(0)};
}

namespace {

/// Calls visit(LeafKey, LeafEntry) for every leaf that the return's region may reach. Conservative.
template <typename Visit>
void forEachEntry(const RegionShape& shape, const RegionSlices& slices, const ReturnRay& ray, std::uint32_t index,
                  const Visit& visit) {
  kernels::forEachLeafOfReturn(shape, slices, ray, [&](const std::int32_t* leaf, std::uint32_t part) {
    visit(leafKeyOf(leaf[0], leaf[1], leaf[2]), LeafEntry{index << 2 | part});
  });
}

/// What is known to be clear.
class ClearSpace {
 public:
  explicit ClearSpace(const PackedMap& map) : accessor_(map.tree()) {}
  [[nodiscard]] bool has(const std::int32_t* leaf, const std::uint64_t* bits) {
    const openvdb::Coord ijk(leaf[0] * 8, leaf[1] * 8, leaf[2] * 8);
    const auto* node = accessor_.probeConstNode<PackedLowerNode>(ijk);
    if (node == nullptr) return false;
    const openvdb::Index n = PackedLowerNode::coordToOffset(ijk);
    if (!node->isChildMaskOn(n)) return false;
    const auto& clear = node->getTable()[n].getChild()->getValueMask();
    std::uint64_t missing = 0;
    for (openvdb::Index x = 0; x < 8; ++x) missing |= bits[x] & ~clear.getWord<std::uint64_t>(x);
    return missing == 0;
  }

 private:
  ConstPackedAccessor accessor_;
};

/// Calls visit(LeafKey, LeafEntry) for every leaf in which the return's line clears something.
template <typename Visit>
void forEachLineEntry(const RegionShape& shape, const ReturnRay& ray, std::uint32_t index, ClearSpace* clear,
                      const Visit& visit) {
  kernels::forEachLeafOfLine(shape, ray, [&](const std::int32_t* leaf, const std::uint64_t* bits) {
    if (clear == nullptr || !clear->has(leaf, bits))
      visit(leafKeyOf(leaf[0], leaf[1], leaf[2]), LeafEntry{index << 2 | LeafEntry::kLine});
  });
}

}  // namespace

void ReturnBins::bin(const RegionShape& shape, std::span<ReturnRay> rays, std::size_t balls, const PackedMap* map) {
  chunk_count_ = (rays.size() + kReturnsPerChunk - 1) / kReturnsPerChunk;
  if (chunks_.size() < chunk_count_) chunks_.resize(chunk_count_);
  tbb::parallel_for(std::size_t{0}, chunk_count_, [&](std::size_t n) {
    Chunk& chunk = chunks_[n];
    for (auto& bucket : chunk) bucket.clear();
    const auto add = [&chunk](LeafKey key, LeafEntry entry) { chunk[bucketOf(key)].push_back({key, entry}); };
    std::optional<ClearSpace> clear;
    if (shape.hasLines() && map != nullptr) clear.emplace(*map);
    const std::size_t end = std::min(rays.size(), (n + 1) * kReturnsPerChunk);
    for (std::size_t i = n * kReturnsPerChunk; i < end; ++i) {
      const auto index = static_cast<std::uint32_t>(i);
      if (i >= rays.size() - balls) {
        kernels::forEachLeafAround(rays[i], shape.ball_radius, [&](const std::int32_t* leaf) {
          add(leafKeyOf(leaf[0], leaf[1], leaf[2]), LeafEntry{index << 2 | LeafEntry::kBall});
        });
        continue;
      }
      const RegionSlices slices(shape, rays[i]);
      rays[i].cone_x = slices.coneX();
      rays[i].band_x = slices.bandX();
      forEachEntry(shape, slices, rays[i], index, add);
      if (shape.hasLines()) forEachLineEntry(shape, rays[i], index, clear ? &*clear : nullptr, add);
    }
  });
  pair_counts_.fill(0);
  for (std::size_t n = 0; n < chunk_count_; ++n) {
    for (std::size_t b = 0; b < kBuckets; ++b) pair_counts_[b] += chunks_[n][b].size();
  }
}

/// Visits pairs in the order of the returns.
template <typename Visit>
void ReturnBins::forEachPair(std::size_t bucket, const Visit& visit) const {
  // Each chunk has a few pairs for a bucket, in separate memory: prefetched, or each would stall.
  constexpr std::size_t kDataAhead = 4, kVectorAhead = 8;
  for (std::size_t n = 0; n < chunk_count_; ++n) {
    if (n + kVectorAhead < chunk_count_) prefetchWrite(&chunks_[n + kVectorAhead][bucket], sizeof(std::vector<Pair>));
    if (n + kDataAhead < chunk_count_) {
      const std::vector<Pair>& ahead = chunks_[n + kDataAhead][bucket];
      if (!ahead.empty()) prefetchWrite(ahead.data(), std::min<std::size_t>(ahead.size() * sizeof(Pair), 1024));
    }
    for (const Pair& pair : chunks_[n][bucket]) visit(pair);
  }
}

namespace {

/// Which leaves of a node are reached, and the number of the bucket's leaves before each word of them.
struct NodeLeaves {
  std::array<std::uint64_t, kLeavesPerNode / 64> reached = {};
  std::array<std::uint32_t, kLeavesPerNode / 64> before = {};
  [[nodiscard]] std::uint32_t rankOf(std::uint32_t place) const {
    const std::uint64_t below = reached[place / 64] & ((std::uint64_t{1} << place % 64) - 1);
    return before[place / 64] + static_cast<std::uint32_t>(std::popcount(below));
  }
};

/// Numbers the nodes of a bucket as they appear.
class NodeNumbers {
 public:
  /// @param most  upper bound on the number of nodes
  void start(std::size_t most) {
    table_.assign(std::bit_ceil(2 * most), kEmpty);
    last_ = ~LeafKey{0};
  }
  std::uint32_t of(LeafKey node, std::vector<LeafKey>& nodes, std::vector<NodeLeaves>& leaves) {
    if (node == last_) return last_number_;  // a return's leaves are consecutive
    std::size_t slot = mix(node) & (table_.size() - 1);
    while (table_[slot] != kEmpty && nodes[table_[slot]] != node) slot = (slot + 1) & (table_.size() - 1);
    if (table_[slot] == kEmpty) {
      table_[slot] = static_cast<std::uint32_t>(nodes.size());
      nodes.push_back(node);
      leaves.emplace_back();
    }
    last_ = node;
    last_number_ = table_[slot];
    return last_number_;
  }

 private:
  static constexpr std::uint32_t kEmpty = ~std::uint32_t{0};
  std::vector<std::uint32_t> table_;
  LeafKey last_ = ~LeafKey{0};
  std::uint32_t last_number_ = 0;
};

}  // namespace

void ReturnBins::group(std::size_t bucket, BucketLeaves& groups) const {
  groups.nodes.clear();
  groups.places.clear();
  groups.begin.clear();
  groups.entries.clear();
  const std::size_t pairs = pairCount(bucket);
  if (pairs == 0) return;

  thread_local NodeNumbers numbers;
  thread_local std::vector<NodeLeaves> leaves;
  thread_local std::vector<LeafPlace> place_of_pair;
  thread_local std::vector<std::uint32_t> next;
  numbers.start(pairs);
  leaves.clear();
  place_of_pair.clear();
  place_of_pair.reserve(pairs);
  forEachPair(bucket, [&](const Pair& pair) {
    const std::uint32_t node = numbers.of(nodeOf(pair.key), groups.nodes, leaves), place = placeInNode(pair.key);
    leaves[node].reached[place / 64] |= std::uint64_t{1} << place % 64;
    place_of_pair.push_back({node * kLeavesPerNode + place});
  });
  for (std::uint32_t node = 0; node < leaves.size(); ++node) {
    for (std::uint32_t word = 0; word < kLeavesPerNode / 64; ++word) {
      leaves[node].before[word] = static_cast<std::uint32_t>(groups.places.size());
      for (std::uint64_t left = leaves[node].reached[word]; left != 0; left &= left - 1) {
        const auto place = word * 64 + static_cast<std::uint32_t>(std::countr_zero(left));
        groups.places.push_back({node * kLeavesPerNode + place});
      }
    }
  }
  groups.begin.assign(groups.places.size() + 1, 0);
  next.clear();
  next.reserve(pairs);
  for (const LeafPlace place : place_of_pair) {
    next.push_back(leaves[place.node()].rankOf(place.inNode()));
    ++groups.begin[next.back() + 1];
  }
  for (std::size_t g = 1; g < groups.begin.size(); ++g) groups.begin[g] += groups.begin[g - 1];
  groups.entries.resize(pairs + LeafFusion::kLookAhead);
  std::fill(groups.entries.end() - LeafFusion::kLookAhead, groups.entries.end(), LeafEntry{});
  // Moves begin[g] to its own end, which is the next one's begin; shifting by one restores it.
  std::size_t pair_number = 0;
  forEachPair(bucket, [&](const Pair& pair) { groups.entries[groups.begin[next[pair_number++]]++] = pair.entry; });
  std::copy_backward(groups.begin.begin(), groups.begin.end() - 1, groups.begin.end());
  groups.begin[0] = 0;
}

}  // namespace accessvdb::internal

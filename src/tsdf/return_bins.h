// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which leaves each return of a scan reaches, grouped by leaf.
///
/// Two passes, both parallel and lock-free: chunks of returns write (leaf, entry) pairs into buckets by the tree node
/// above the leaf; then each bucket is grouped by node and leaf. So all leaves of a node are in one bucket, and the
/// thread that works on a bucket may link new leaves into the tree without regard to those that fuse others.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "tsdf/leaf_fusion.h"
#include "tsdf/return_region.h"

namespace accessvdb::internal {

/// A leaf's coordinates divided by 8, packed into 63 bits.
using LeafKey = std::uint64_t;
inline constexpr std::int64_t kLeafKeyBias = 1 << 20;
inline LeafKey leafKeyOf(std::int32_t leaf_x, std::int32_t leaf_y, std::int32_t leaf_z) {
  return static_cast<LeafKey>(leaf_x + kLeafKeyBias) << 42 | static_cast<LeafKey>(leaf_y + kLeafKeyBias) << 21 |
         static_cast<LeafKey>(leaf_z + kLeafKeyBias);
}
std::array<std::int32_t, 3> originOf(LeafKey key);

/// Leaves along each edge of the tree node above them, and in the whole node.
inline constexpr std::uint32_t kNodeEdge = 16;
inline constexpr std::uint32_t kLeavesPerNode = kNodeEdge * kNodeEdge * kNodeEdge;

/// A leaf of a bucket: which of its nodes, and where in the node's table.
struct LeafPlace {
  std::uint32_t code;  ///< node * kLeavesPerNode + place
  [[nodiscard]] std::uint32_t node() const { return code / kLeavesPerNode; }
  [[nodiscard]] std::uint32_t inNode() const { return code % kLeavesPerNode; }
};

/// The leaves of one bucket with their entries, grouped by node and within a node ordered by place: neighbours in a
/// node's table are neighbours here.
struct BucketLeaves {
  std::vector<LeafKey> nodes;        ///< [nodes] key of each node's lowest leaf
  std::vector<LeafPlace> places;     ///< [leaves]
  std::vector<std::uint32_t> begin;  ///< [leaves + 1] into entries
  std::vector<LeafEntry> entries;    ///< plus kLookAhead dummies, so that prefetching needs no bounds check
  /// Lowest voxel of a leaf.
  [[nodiscard]] std::array<std::int32_t, 3> originOf(std::size_t leaf) const {
    std::array<std::int32_t, 3> origin = internal::originOf(nodes[places[leaf].node()]);
    const std::uint32_t place = places[leaf].inNode();
    origin[0] += static_cast<std::int32_t>(place / (kNodeEdge * kNodeEdge)) * 8;
    origin[1] += static_cast<std::int32_t>(place / kNodeEdge % kNodeEdge) * 8;
    origin[2] += static_cast<std::int32_t>(place % kNodeEdge) * 8;
    return origin;
  }
};

class ReturnBins {
 public:
  static constexpr std::size_t kBuckets = 256;
  /// The bucket of a leaf.
  [[nodiscard]] static std::size_t bucketOf(LeafKey key);

  /// Fills the pairs of all returns, and the boxes of their regions.
  /// @param balls  so many of the rays, the last ones, are ballAround()
  /// @param map    nullptr, or whose leaves lines pass over where they would clear nothing that is not clear already
  void bin(const RegionShape& shape, std::span<ReturnRay> rays, std::size_t balls = 0, const PackedMap* map = nullptr);

  /// Number of pairs in a bucket, a measure of its work.
  [[nodiscard]] std::size_t pairCount(std::size_t bucket) const { return pair_counts_[bucket]; }

  /// Groups one bucket; safe to call for different buckets at the same time.
  void group(std::size_t bucket, BucketLeaves& groups) const;

 private:
  struct Pair {
    LeafKey key;
    LeafEntry entry;
  };
  using Chunk = std::array<std::vector<Pair>, kBuckets>;
  std::vector<Chunk> chunks_;  ///< kept between scans so that memory is reused
  std::size_t chunk_count_ = 0;
  std::array<std::size_t, kBuckets> pair_counts_ = {};
  template <typename Visit>
  void forEachPair(std::size_t bucket, const Visit& visit) const;
};

}  // namespace accessvdb::internal

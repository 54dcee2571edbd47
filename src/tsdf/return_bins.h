// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which leaves each return of a scan reaches, grouped by leaf.
///
/// Two passes, both parallel and free of locks: chunks of returns write (leaf, entry) pairs into buckets by the leaf's
/// neighbourhood; then each bucket is grouped by leaf through a small hash table. Leaves of a bucket lie close together
/// in the tree, which keeps look-ups and linking cheap.
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
LeafKey leafKeyOf(std::int32_t leaf_x, std::int32_t leaf_y, std::int32_t leaf_z);
std::array<std::int32_t, 3> originOf(LeafKey key);

/// The leaves of one bucket with their entries.
struct LeafGroups {
  std::vector<LeafKey> keys;
  std::vector<std::uint32_t> begin;  ///< [keys + 1] into entries
  std::vector<LeafEntry> entries;    ///< with kLookAhead more, of no meaning, so that prefetching needs no end
};

class ReturnBins {
 public:
  static constexpr std::size_t kBuckets = 256;

  /// Fills the pairs of all returns, and the boxes of their regions.
  void bin(const RegionShape& shape, std::span<ReturnRay> rays);

  /// Groups one bucket; safe to call for different buckets at the same time.
  void group(std::size_t bucket, LeafGroups& groups) const;

 private:
  struct Pair {
    LeafKey key;
    LeafEntry entry;
  };
  using Chunk = std::array<std::vector<Pair>, kBuckets>;
  std::vector<Chunk> chunks_;  ///< kept between scans, so that their memory is reused
  std::size_t chunk_count_ = 0;
};

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Makes the values of leaves compact (leaf_values.h) to which no scan has added anything for a while.
///
/// Each bucket of the map (return_bins.h) has lists of its own, for the thread that has the bucket. A leaf is looked at
/// once in kPatience scans, and is cold if none added to it since. So which leaves are compact after a scan, and the
/// memory that is counted, depend on the scans alone. Leaves to come take the buffers of those that became compact.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <unordered_map>
#include <vector>

#include "tsdf/leaf_values.h"

namespace accessvdb::internal {

class ColdLeaves {
 public:
  static constexpr std::size_t kPatience = 10;  ///< scans between two looks
  static constexpr std::size_t kBuckets = 256;  ///< ReturnBins::kBuckets

  /// Which leaves of a node of the tree, of 128^3 voxels, a scan added to since they were looked at.
  struct Node {
    std::array<std::uint64_t, PackedLowerNode::NUM_VALUES / 64> touched = {};
    void touch(std::uint32_t place) { touched[place / 64] |= std::uint64_t{1} << place % 64; }
  };

  ColdLeaves() = default;
  ColdLeaves(const ColdLeaves&) = delete;
  ColdLeaves& operator=(const ColdLeaves&) = delete;

  // From one thread at a time for each bucket.
  /// What is known of a node of the bucket; stays where it is. @throws std::bad_alloc
  [[nodiscard]] Node& nodeOf(std::size_t bucket, const PackedLowerNode* node);
  /// A leaf got values, or is plain again. Without memory it stays so.
  void notePlain(std::size_t bucket, Node& node, PackedLeaf& leaf) noexcept;
  /// After each scan, wherever it was: makes the bucket's cold leaves compact. Without memory they stay plain.
  /// @param leaves  held while they get other buffers
  void look(std::size_t bucket, std::mutex& leaves);

  /// look() at all buckets, after a scan elsewhere. @return whether leaves became compact
  bool rest();
  /// After a scan that failed, whose new leaves are gone: all that are plain stay so.
  void forget() noexcept;
  /// For tests: makes all leaves compact that are worth it.
  void makeAllCompact();

  /// From several threads, of different leaves. @throws std::bad_alloc
  void makePlain(PackedLeaf& leaf);
  /// Gives a leaf without values those, compact if that is worth it. From one thread. @throws std::bad_alloc
  void put(PackedLeaf& leaf, const std::uint32_t* values);

  [[nodiscard]] std::uint64_t leaves() const { return leaves_; }
  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }

 private:
  struct Plain {
    PackedLeaf* leaf;
    Node* node;
  };
  struct alignas(64) Bucket {
    std::unordered_map<const PackedLowerNode*, std::unique_ptr<Node>> nodes;
    std::array<std::vector<Plain>, kPatience> plain;  ///< by when they are looked at
    std::size_t turn = 0;                             ///< latest look, of `plain`
  };
  void makeCompactFrom(std::vector<Plain>& plain, std::size_t first, std::mutex& leaves);

  std::array<Bucket, kBuckets> buckets_;
  std::atomic<std::uint64_t> leaves_ = 0, bytes_ = 0;  ///< compact
};

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Makes the values of leaves compact (leaf_values.h) that no scan comes near any more.
///
/// Leaves are looked at by nodes of the tree, of 128^3 voxels: what a scan touches beside a leaf tells that the next
/// ones may touch it. Where leaves that became compact are written to again, as on laps, the node's wait longer the
/// next time. All this is done beside the field's other work, which may read the map meanwhile; the compact values take
/// the places of the plain ones before a scan changes anything, and leaves to come take the buffers that those had.
/// So which leaves are compact after a scan, and the memory that is counted, depends on the scans alone.
#pragma once

#include <tbb/task_arena.h>
#include <tbb/task_group.h>

#include <atomic>
#include <cstdint>
#include <deque>
#include <span>
#include <unordered_map>
#include <vector>

#include "tsdf/leaf_values.h"

namespace accessvdb::internal {

class ColdLeaves {
 public:
  /// Scans that come near nothing of a node before its leaves are cold; so many times as many after each time that this
  /// was too soon, up to a bound.
  static constexpr std::uint64_t kPatience = 20, kLonger = 4, kMostPatience = 64 * kPatience;

  ColdLeaves();
  ~ColdLeaves();  ///< before the tree
  ColdLeaves(const ColdLeaves&) = delete;
  ColdLeaves& operator=(const ColdLeaves&) = delete;

  /// A leaf with plain values, and the node above it.
  struct PlainLeaf {
    const PackedLowerNode* node;
    PackedLeaf* leaf;
  };
  /// Before values change, while nobody else reads the map: waits for what is done beside, which takes its place.
  void settle();
  /// After a scan. @param touched  nodes that it came near  @param plain  leaves that it gave values, or made plain
  void noteScan(std::vector<const PackedLowerNode*> touched, std::vector<PlainLeaf> plain);
  /// The same after settle(), for a scan elsewhere. @return whether leaves may become compact
  bool rest();
  /// After settle(), between scans: a leaf is plain now.
  void notePlain(const PlainLeaf& plain);
  // For tests.
  /// Waits for the end of what is done beside, which takes no place yet.
  void wait();
  /// Makes all leaves compact that are worth it.
  void makeAllCompact();

  /// After settle(), from several threads, of different leaves. @throws std::bad_alloc
  void makePlain(PackedLeaf& leaf);
  /// Gives a leaf without values those, compact if that is worth it. From one thread. @throws std::bad_alloc
  void put(PackedLeaf& leaf, const std::uint32_t* values);

  [[nodiscard]] std::uint64_t leaves() const { return leaves_; }
  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }

 private:
  struct Node {
    std::uint64_t touched = 0, patience = kPatience;  ///< scans
    bool is_warm = false, was_cold = false;
    std::vector<PackedLeaf*> plain;
    [[nodiscard]] bool isColdAt(std::uint64_t scan) const { return touched + patience <= scan; }
  };
  struct Candidate {
    PlainLeaf leaf;
    const CompactLeaf* block = nullptr;  ///< from when it is made to settle()
    void* buffer = nullptr;              ///< plain one, from settle() to the next work()
    bool seen = false;                   ///< compact, or not worth it
  };
  struct Scan {
    std::vector<const PackedLowerNode*> touched;
    std::vector<PlainLeaf> plain;
  };
  void begin();
  void work();
  void recycleBuffers() noexcept;
  Node& warm(const PackedLowerNode* node);
  void fileNoted();
  void file(const Scan& scan);
  void findCold();
  void chooseCandidates();
  void makeBlocks();

  std::vector<Scan> noted_;  ///< not filed yet
  std::uint64_t scan_ = 0;   ///< of those that were
  std::unordered_map<const PackedLowerNode*, Node> nodes_;
  std::deque<std::vector<const PackedLowerNode*>> touched_;  ///< by each of the last scans, up to kPatience
  std::deque<const PackedLowerNode*> cold_;                  ///< unless they were touched since
  std::size_t warm_ = 0;                                     ///< nodes that may become cold
  std::vector<Candidate> candidates_;
  std::atomic<bool> stops_ = false;
  std::atomic<std::uint64_t> leaves_ = 0, bytes_ = 0;  ///< compact
  tbb::task_arena arena_;
  tbb::task_group group_;
};

}  // namespace accessvdb::internal

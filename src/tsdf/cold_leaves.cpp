// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/cold_leaves.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <new>
#include <thread>
#include <utility>

namespace accessvdb::internal {
namespace {

constexpr std::size_t kMostCandidates = std::size_t{1} << 16;  ///< between two scans
constexpr std::size_t kLeavesAtOnce = 64;

/// A core in four; workers come to it from other work, else a busy program would never do this.
tbb::task_arena makeArena() {
  const int threads = std::max(1, static_cast<int>(std::thread::hardware_concurrency()) / 4);
  return tbb::task_arena(threads, 0, tbb::task_arena::priority::high);
}

}  // namespace

ColdLeaves::ColdLeaves() : arena_(makeArena()) {}

ColdLeaves::~ColdLeaves() {
  stops_ = true;
  wait();
  for (const Candidate& candidate : candidates_)
    if (candidate.block != nullptr) CompactLeaf::free(candidate.block);
  recycleBuffers();
}

void ColdLeaves::wait() {
  arena_.execute([this] { group_.wait(); });
}

void ColdLeaves::settle() {
  wait();
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, candidates_.size(), 1024), [&](const auto& range) {
    std::uint64_t leaves = 0, bytes = 0;
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      Candidate& candidate = candidates_[n];
      if (candidate.block == nullptr) continue;
      ++leaves;
      bytes += candidate.block->bytes;
      candidate.buffer = putCompact(*candidate.leaf.leaf, std::exchange(candidate.block, nullptr));
    }
    leaves_ += leaves;
    bytes_ += bytes;
  });
}

void ColdLeaves::noteScan(std::vector<const PackedLowerNode*> touched, std::vector<PlainLeaf> plain) {
  noted_.push_back({std::move(touched), std::move(plain)});
  begin();
}

bool ColdLeaves::rest() {
  if (warm_ == 0 && noted_.empty() && candidates_.empty()) return false;
  noted_.emplace_back();
  begin();
  return true;
}

void ColdLeaves::notePlain(const PlainLeaf& plain) {
  if (noted_.empty()) noted_.emplace_back();
  noted_.back().touched.push_back(plain.node);
  noted_.back().plain.push_back(plain);
}

void ColdLeaves::makeAllCompact() {
  settle();
  while (warm_ > 0 || !noted_.empty() || !candidates_.empty()) {
    noted_.emplace_back();
    work();
    settle();
  }
}

/// Small maps need no thread: workers that come and go cost more.
void ColdLeaves::begin() {
  constexpr std::size_t kFiledAtOnce = 8192;
  std::size_t entries = 0;
  for (const Scan& scan : noted_) entries += scan.touched.size() + scan.plain.size();
  if (entries <= kFiledAtOnce) {
    try {
      fileNoted();
    } catch (const std::bad_alloc&) {  // as in work()
    }
  }
  if (noted_.empty() && cold_.empty() && candidates_.empty()) return;
  arena_.enqueue(group_.defer([this] { work(); }));
}

void ColdLeaves::work() {
  try {
    recycleBuffers();
    fileNoted();
    chooseCandidates();
    makeBlocks();
  } catch (const std::bad_alloc&) {  // they stay plain; whoever needs memory reports it
  }
}

void ColdLeaves::recycleBuffers() noexcept {
  std::array<void*, 256> buffers;
  std::size_t count = 0;
  for (Candidate& candidate : candidates_) {
    if (candidate.buffer == nullptr) continue;
    buffers[count++] = std::exchange(candidate.buffer, nullptr);
    if (count == buffers.size()) PackedVoxel::recycle({buffers.data(), std::exchange(count, 0)});
  }
  PackedVoxel::recycle({buffers.data(), count});
}

ColdLeaves::Node& ColdLeaves::warm(const PackedLowerNode* node) {
  Node& found = nodes_[node];
  if (!std::exchange(found.is_warm, true)) ++warm_;
  return found;
}

void ColdLeaves::fileNoted() {
  for (const Scan& scan : std::exchange(noted_, {})) file(scan);
}

void ColdLeaves::file(const Scan& scan) {
  ++scan_;
  for (const PackedLowerNode* node : scan.touched) warm(node).touched = scan_;
  const PackedLowerNode* last = nullptr;
  Node* node = nullptr;
  for (const PlainLeaf& plain : scan.plain) {
    if (plain.node != last) {
      node = &warm(last = plain.node);
      if (std::exchange(node->was_cold, false)) node->patience = std::min(kLonger * node->patience, kMostPatience);
    }
    node->plain.push_back(plain.leaf);
  }
  touched_.push_back(scan.touched);
  if (touched_.size() > kPatience) findCold();
}

/// Among those that were touched kPatience scans ago.
void ColdLeaves::findCold() {
  for (const PackedLowerNode* node : touched_.front()) {
    const Node& found = nodes_.at(node);
    if (!found.is_warm || found.touched + kPatience > scan_) continue;
    if (found.isColdAt(scan_)) {
      cold_.push_back(node);
    } else {
      touched_.back().push_back(node);  // to be looked at again
    }
  }
  touched_.pop_front();
}

void ColdLeaves::chooseCandidates() {
  // Of those that were not come to, a scan may have touched some.
  const PackedLowerNode* last = nullptr;
  for (const auto& candidate : std::exchange(candidates_, {})) {
    if (candidate.seen) continue;
    Node& node = warm(candidate.leaf.node);
    node.plain.push_back(candidate.leaf.leaf);
    if (candidate.leaf.node != std::exchange(last, candidate.leaf.node) && node.isColdAt(scan_))
      cold_.push_back(candidate.leaf.node);
  }
  while (!cold_.empty() && candidates_.size() < kMostCandidates) {
    const PackedLowerNode* const node = cold_.front();
    cold_.pop_front();
    Node& found = nodes_.at(node);
    if (!found.is_warm || !found.isColdAt(scan_)) continue;
    candidates_.reserve(candidates_.size() + found.plain.size());  // all or none: no leaf may be listed twice
    for (PackedLeaf* leaf : found.plain) candidates_.push_back({{node, leaf}});
    found.plain = {};
    found.is_warm = false;
    found.was_cold = true;
    --warm_;
  }
}

void ColdLeaves::makeBlocks() {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, candidates_.size(), kLeavesAtOnce), [this](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end() && !stops_; ++n) {
      candidates_[n].block = makeCompact(plainValues(*candidates_[n].leaf.leaf));
      candidates_[n].seen = true;
    }
  });
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

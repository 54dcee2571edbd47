// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/scan_changes.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <utility>

#include "hostdev/cell_counts.h"

namespace accessvdb::internal {
namespace {

constexpr std::size_t kChangesPerTask = 256;

template <typename Visit>
void forEachInParallel(std::size_t count, const Visit& visit) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, kChangesPerTask), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) visit(n);
  });
}

}  // namespace

void ScanChanges::noteScored() {
  known_points_ = scorer_.points().size();
  std::vector<std::uint32_t> known;
  for (std::uint32_t id = 0; id < known_points_; ++id)
    (scorer_.record(id).has_neighbourhood ? known : fresh_).push_back(id);
  moved_points_.refreshed(known);
  scorer_.upload(known);
  anything_scored_ = !known.empty();
}

void ScanChanges::noteFlips(std::span<const std::span<const LeafChange>> facts) {
  if (!anything_scored_) return;  // nothing to invalidate yet
  for (const auto& part : facts) flips_.add(part);
}

void ScanChanges::refresh() {
  if (reading_ > 0) return;
  reading_ = readers_;
  const PointStore& points = scorer_.points();
  scorer_.grow();
  index_of_.grow(points.size(), kNone);
  in_block_.grow(points.index().blocks().size(), 0);
  // Points that crossed the bound have no neighbourhood yet, so they are none of those that moved.
  const std::vector<std::uint32_t> moved = moved_points_.find(findCrossed());
  changed_ = scorer_.refreshNeighbourhoods(moved, std::move(changed_));
  moved_points_.refreshed(moved);
  scorer_.upload(changed_.ids);  // includes those that crossed: they had no neighbourhood yet
  moved_count_ = moved.size();
  anything_scored_ = anything_scored_ || !moved.empty();
  const std::vector<LeafChange>& flipped = flips_.changes();
  freed_.resize(flipped.size());
  forEachInParallel(flipped.size(),
                    [&](std::size_t n) { freed_[n] = kernels::countCells(flipped[n].collides_off.data()); });
  forEachInParallel(changed_.ids.size(), [&](std::size_t n) {
    index_of_[changed_.ids[n]] = static_cast<std::uint32_t>(n);
    std::atomic_ref(in_block_[points.blockOf(changed_.ids[n])]).store(1, std::memory_order_relaxed);
  });
}

void ScanChanges::finish() {
  if (--reading_ > 0) return;
  const PointStore& points = scorer_.points();
  forEachInParallel(changed_.ids.size(), [&](std::size_t n) {
    index_of_[changed_.ids[n]] = kNone;
    std::atomic_ref(in_block_[points.blockOf(changed_.ids[n])]).store(0, std::memory_order_relaxed);
  });
  if (scorer_.keepsMemoryFor(changed_.ids.size())) {
    changed_.ids.clear();
    changed_.before.clear();
  } else {
    changed_ = {};
  }
  touched_.clear();
  flips_.clear();
  moved_points_.clear();
}

/// Cause (e): points whose confidence crossed the bound. Weights only grow, so only points below it are checked.
std::vector<std::uint32_t> ScanChanges::findCrossed() {
  for (std::uint32_t id = known_points_; id < scorer_.points().size(); ++id) fresh_.push_back(id);
  known_points_ = scorer_.points().size();
  std::vector<std::uint32_t> crossed = scorer_.takeConfident(fresh_);
  touched_ = moved_points_.touched();
  scorer_.refreshTouched(touched_);  // cheap compared with the rest
  return crossed;
}

std::uint64_t ScanChanges::bytes() const {
  const auto bytesOf = [](const auto& list) { return list.capacity() * sizeof(list[0]); };
  return flips_.bytes() + moved_points_.bytes() + index_of_.bytes() + in_block_.bytes() + bytesOf(fresh_) +
         bytesOf(freed_) + bytesOf(touched_) + bytesOf(changed_.ids) + bytesOf(changed_.before);
}

}  // namespace accessvdb::internal

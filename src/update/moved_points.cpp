// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/moved_points.h"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <iterator>
#include <utility>

#include "hostdev/box_in_leaf.h"
#include "processor/prefetch.h"

namespace accessvdb::internal {
namespace {

/// Touched points are merged once this many wait, so that a long period without updates takes bounded memory.
constexpr std::size_t kMostWaiting = std::size_t{1} << 20;
/// How far means may lie outside their voxel, far from the origin, where float32 has 8 steps per voxel.
constexpr float kRoundingVoxels = 0.25f;
/// A reach is rounded to float32 before it is squared.
constexpr float kReachSlack = 1 + 4 * kFloatSlack;

/// Points, listed block by block.
class PointsByBlock {
 public:
  PointsByBlock(const PointStore& points, std::span<const std::uint32_t> ids) : keys_(ids.size()) {
    for (std::size_t n = 0; n < keys_.size(); ++n) keys_[n] = std::uint64_t{points.blockOf(ids[n])} << 32 | ids[n];
    tbb::parallel_sort(keys_);
  }

  /// The blocks that have any of the points, ascending.
  [[nodiscard]] std::vector<std::uint32_t> blocks() const {
    std::vector<std::uint32_t> blocks;
    for (const std::uint64_t key : keys_) {
      const auto block = static_cast<std::uint32_t>(key >> 32);
      if (blocks.empty() || blocks.back() != block) blocks.push_back(block);
    }
    return blocks;
  }

  void appendOf(std::uint32_t block, std::vector<std::uint32_t>& ids) const {
    const std::uint64_t first = std::uint64_t{block} << 32;
    for (auto key = std::ranges::lower_bound(keys_, first); key != keys_.end() && *key >> 32 == block; ++key) {
      ids.push_back(static_cast<std::uint32_t>(*key));
    }
  }

 private:
  std::vector<std::uint64_t> keys_;  ///< block << 32 | id, ascending
};

}  // namespace

void MovedPoints::note(const TouchedPoints& touched) {
  if (!any_known_) return;
  for (std::size_t n = 0; n < touched.all.size(); ++n) {
    touched_.push_back({touched.all[n], touched.views_changed[n], touched.before_L[n]});
  }
  if (touched_.size() > 2 * joined_ + kMostWaiting) joinTouched();
}

/// Sorts by id and merges what several scans did to a point.
void MovedPoints::joinTouched() {
  if (joined_ == touched_.size()) return;
  // The order of the scans decides which position is the older one.
  std::stable_sort(touched_.begin(), touched_.end(), [](const Touched& a, const Touched& b) { return a.id < b.id; });
  std::size_t out = 0;
  for (const Touched& touched : touched_) {
    if (out > 0 && touched_[out - 1].id == touched.id) {
      touched_[out - 1].views_changed |= touched.views_changed;
    } else {
      touched_[out++] = touched;
    }
  }
  touched_.resize(out);
  joined_ = out;
}

const std::vector<std::uint32_t>& MovedPoints::touched() {
  joinTouched();
  ids_.resize(touched_.size());
  std::transform(touched_.begin(), touched_.end(), ids_.begin(), [](const Touched& touched) { return touched.id; });
  return ids_;
}

void MovedPoints::groupByBlock() {
  const PointStore& points = scorer_.points();
  keys_.resize(touched_.size());
  for (std::size_t n = 0; n < keys_.size(); ++n) keys_[n] = std::uint64_t{points.blockOf(touched_[n].id)} << 32 | n;
  tbb::parallel_sort(keys_.begin(), keys_.end());
  by_block_.resize(keys_.size());
  touched_blocks_.clear();
  for (std::uint32_t n = 0; n < keys_.size(); ++n) {
    by_block_[n] = static_cast<std::uint32_t>(keys_[n]);
    const auto block = static_cast<std::uint32_t>(keys_[n] >> 32);
    if (touched_blocks_.empty() || touched_blocks_.back().block != block)
      touched_blocks_.push_back({block, n, n, 0, {}});
    touched_blocks_.back().end = n + 1;
  }
  places_.resize(2 * touched_.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, touched_blocks_.size(), 64), [&](const auto& range) {
    for (std::size_t g = range.begin(); g != range.end(); ++g) listPlaces(touched_blocks_[g]);
  });
}

/// Where touched points are and were, of those that matter to others.
void MovedPoints::listPlaces(TouchedBlock& touched_block) {
  Eigen::Vector3f* place = places_.data() + 2 * std::size_t{touched_block.begin};
  for (std::uint32_t n = touched_block.begin; n < touched_block.end; ++n) {
    const Touched& touched = touched_[by_block_[n]];
    if (scorer_.choice().isMade()) {
      const PointStore& points = scorer_.points();
      const std::size_t bit = bitInParent(points.voxelOf(points.first_L(touched.id)));
      touched_block.voxels[bit >> 6] |= std::uint64_t{1} << (bit & 63);
    }
    const Eigen::Vector3f& now_L = scorer_.points().pca_L(touched.id);
    const bool is_new = std::isnan(touched.before_L.x());
    const bool mean_moved = is_new || touched.before_L != now_L;
    if (!mean_moved && touched.views_changed == 0) continue;
    *place++ = now_L;
    if (mean_moved && !is_new) *place++ = touched.before_L;
  }
  touched_block.places = static_cast<std::uint32_t>(place - (places_.data() + 2 * std::size_t{touched_block.begin}));
}

/// Between voxels of two points of which one may matter to the other. @param reach_m  of a neighbourhood
float MovedPoints::reachVoxels(float reach_m) const {
  const auto voxel_size_m = static_cast<float>(scorer_.params().tsdf.voxel_size_m);
  return std::max(reach_m / voxel_size_m * kReachSlack + 2 * kRoundingVoxels, competitors_voxels_);
}

/// Visits blocks whose boxes lie within reach of the leaf's box. @param reach_m  see reachVoxels()
template <typename Visit>
void MovedPoints::forEachNear(const Index3& leaf, float reach_m, const Visit& visit) const {
  const SurfaceIndex& index = scorer_.points().index();
  const auto rings = static_cast<std::int32_t>(reachVoxels(reach_m) / 8) + 1;
  index.forEachBlock({leaf[0] - rings, leaf[1] - rings, leaf[2] - rings},
                     {leaf[0] + rings, leaf[1] + rings, leaf[2] + rings},
                     [&](std::uint32_t b, const Index3& at) { visit(b, static_cast<float>(gapSquared(at, leaf))); });
}

/// Blocks with a point that some touched point may affect, ascending.
std::vector<std::uint32_t> MovedPoints::reachedBlocks() {
  const auto& blocks = scorer_.points().index().blocks();
  reached_.grow(blocks.size());
  float most_m = -1;
  for (std::size_t b = 0; b < block_reach_m_.size(); ++b) most_m = std::max(most_m, block_reach_m_[b]);
  tbb::enumerable_thread_specific<std::vector<std::uint32_t>> found;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, touched_blocks_.size()), [&](const auto& range) {
    std::vector<std::uint32_t>& mine = found.local();
    for (std::size_t g = range.begin(); g != range.end(); ++g) {
      forEachNear(blocks[touched_blocks_[g].block].leaf, most_m, [&](std::uint32_t b, float squared_gap) {
        if (!anyIn(b)) return;
        const float reach_voxels = reachVoxels(block_reach_m_[b]);
        if (squared_gap > reach_voxels * reach_voxels) return;
        std::atomic_ref<std::uint8_t> flag(reached_[b]);
        if (flag.load(std::memory_order_relaxed) != 0) return;
        if (flag.exchange(1, std::memory_order_relaxed) == 0) mine.push_back(b);
      });
    }
  });
  std::vector<std::uint32_t> reached;
  for (const auto& part : found) reached.insert(reached.end(), part.begin(), part.end());
  for (const std::uint32_t b : reached) reached_[b] = 0;
  tbb::parallel_sort(reached);
  return reached;
}

/// Lists touched voxels near a leaf whose points may compete with its own.
void MovedPoints::listTouchedLeaves(const Index3& leaf, std::vector<TouchedLeaf>& leaves) const {
  leaves.clear();
  const kernels::SurfaceChoice& choice = scorer_.choice();
  if (!choice.isMade()) return;
  const std::int32_t rings = (std::max(choice.windowVoxels(), choice.edge - 1) + 7) / 8;
  scorer_.points().index().forEachBlock({leaf[0] - rings, leaf[1] - rings, leaf[2] - rings},
                                        {leaf[0] + rings, leaf[1] + rings, leaf[2] + rings},
                                        [&](std::uint32_t b, const Index3& at) {
                                          if (touched_block_of_[b] == kNone) return;
                                          leaves.push_back({at, &touched_blocks_[touched_block_of_[b]].voxels});
                                        });
}

bool MovedPoints::competesWithAny(std::uint32_t id, const std::vector<TouchedLeaf>& leaves) const {
  if (leaves.empty()) return false;
  const int axis_of_cell = kernels::competingAxis(scorer_.record(id).normal_L.data());
  if (axis_of_cell < 0) return false;
  const Index3 voxel = scorer_.points().voxelOf(scorer_.points().first_L(id));
  const kernels::CompetingVoxels box(scorer_.choice(), voxel.data(), axis_of_cell);
  return std::ranges::any_of(leaves, [&](const TouchedLeaf& touched) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (touched.leaf[axis] < box.low[axis] >> 3 || touched.leaf[axis] > box.high[axis] >> 3) return false;
    }
    return kernels::BoxInLeaf(touched.leaf.data(), box.low, box.high).hasAnyOf(touched.voxels->data());
  });
}

void MovedPoints::findInBlock(std::uint32_t block, NearTouched& near, std::vector<std::uint32_t>& moved) const {
  const PointStore& points = scorer_.points();
  const PointBlock& own = points.index().blocks()[block];
  const float reach_voxels = reachVoxels(block_reach_m_[block]);
  NearPositions& places = near.places;
  listTouchedLeaves(own.leaf, near.leaves);
  constexpr std::size_t kAhead = 8;  // points are scattered in memory
  const auto prefetch = [&](std::size_t n) {
    if (n >= own.ids.size()) return;
    prefetchRead(&scorer_.record(own.ids[n]));
    prefetchRead(&points.pca_L(own.ids[n]));
  };
  for (std::size_t n = 0; n < kAhead; ++n) prefetch(n);
  places.clear();
  forEachNear(own.leaf, block_reach_m_[block], [&](std::uint32_t b, float squared_gap) {
    if (touched_block_of_[b] == kNone || squared_gap > reach_voxels * reach_voxels) return;
    const TouchedBlock& touched_block = touched_blocks_[touched_block_of_[b]];
    const Eigen::Vector3f* const first = places_.data() + 2 * std::size_t{touched_block.begin};
    for (const Eigen::Vector3f* place = first; place != first + touched_block.places; ++place) {
      places.add(place->x(), place->y(), place->z());
    }
  });
  const TouchedBlock none = {block, 0, 0, 0, {}};
  const TouchedBlock& touched_block =
      touched_block_of_[block] == kNone ? none : touched_blocks_[touched_block_of_[block]];
  const NearKernels& kernels = nearKernels();
  for (std::size_t n = 0; n < own.ids.size(); ++n) {
    prefetch(n + kAhead);
    const std::uint32_t id = own.ids[n];
    const PointRecord& record = scorer_.record(id);
    if (!record.has_neighbourhood) continue;
    // A touched point itself: its mean, its seen directions or the mean sensor position have changed.
    const auto first = by_block_.begin() + touched_block.begin, last = by_block_.begin() + touched_block.end;
    const auto at = std::lower_bound(first, last, id, [&](std::uint32_t at_place, std::uint32_t value) {
      return touched_[at_place].id < value;  // touched_ is sorted by id, and so is each touched_block
    });
    const bool is_touched = at != last && touched_[*at].id == id;
    if (is_touched ||
        kernels.any_within(places.x(), places.y(), places.z(), places.lanes(), points.pca_L(id).data(),
                           record.reach_m * record.reach_m * kReachSlack) ||
        competesWithAny(id, near.leaves)) {
      moved.push_back(id);
    }
  }
}

std::vector<std::uint32_t> MovedPoints::find(std::span<const std::uint32_t> others) {
  joinTouched();
  touched_blocks_.clear();
  std::vector<std::uint32_t> reached;
  if (!touched_.empty() && any_known_) {
    const std::size_t block_count = scorer_.points().index().blocks().size();
    block_reach_m_.grow(block_count, -1.0f);
    touched_block_of_.grow(block_count, kNone);
    groupByBlock();
    for (std::uint32_t g = 0; g < touched_blocks_.size(); ++g) touched_block_of_[touched_blocks_[g].block] = g;
    reached = reachedBlocks();
  }
  const PointsByBlock waiting(scorer_.points(), others);
  std::vector<std::uint32_t> all;
  std::ranges::set_union(reached, waiting.blocks(), std::back_inserter(all));

  constexpr std::size_t kPerTask = 32;
  std::vector<std::vector<std::uint32_t>> found((all.size() + kPerTask - 1) / kPerTask);
  tbb::enumerable_thread_specific<NearTouched> near;
  tbb::parallel_for(std::size_t{0}, found.size(), [&](std::size_t task) {
    for (std::size_t n = task * kPerTask; n < std::min(all.size(), (task + 1) * kPerTask); ++n) {
      const std::uint32_t b = all[n];
      if (std::ranges::binary_search(reached, b)) findInBlock(b, near.local(), found[task]);
      waiting.appendOf(b, found[task]);
    }
  });
  for (const TouchedBlock& touched_block : touched_blocks_) touched_block_of_[touched_block.block] = kNone;
  std::vector<std::uint32_t> moved;
  for (const std::vector<std::uint32_t>& part : found) moved.insert(moved.end(), part.begin(), part.end());
  return moved;
}

void MovedPoints::refreshed(std::span<const std::uint32_t> ids) {
  const PointStore& points = scorer_.points();
  const auto& blocks = points.index().blocks();
  any_known_ = any_known_ || !ids.empty();
  block_reach_m_.grow(blocks.size(), -1.0f);
  reached_.grow(blocks.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, ids.size(), 1024), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      std::atomic_ref<std::uint8_t> flag(reached_[points.blockOf(ids[n])]);
      if (flag.load(std::memory_order_relaxed) == 0) flag.store(1, std::memory_order_relaxed);
    }
  });
  tbb::parallel_for(tbb::blocked_range<std::uint32_t>(0, static_cast<std::uint32_t>(blocks.size()), 256),
                    [&](const auto& range) {
                      for (std::uint32_t b = range.begin(); b != range.end(); ++b) {
                        if (std::exchange(reached_[b], std::uint8_t{0}) == 0) continue;
                        float most_m = -1;
                        for (const std::uint32_t id : blocks[b].ids) {
                          const PointRecord& record = scorer_.record(id);
                          if (record.has_neighbourhood) most_m = std::max(most_m, record.reach_m);
                        }
                        block_reach_m_[b] = most_m;
                      }
                    });
}

void MovedPoints::clear() {
  if (scorer_.keepsMemoryFor(touched_.size())) {
    touched_.clear();
  } else {
    touched_ = {}, ids_ = {}, keys_ = {}, by_block_ = {}, places_ = {}, touched_blocks_ = {};
  }
  joined_ = 0;
}

std::uint64_t MovedPoints::bytes() const {
  return touched_.capacity() * sizeof(Touched) + touched_blocks_.capacity() * sizeof(TouchedBlock) + reached_.bytes() +
         (ids_.capacity() + by_block_.capacity()) * sizeof(std::uint32_t) + keys_.capacity() * sizeof(std::uint64_t) +
         places_.capacity() * sizeof(Eigen::Vector3f) + touched_block_of_.bytes() + block_reach_m_.bytes();
}

}  // namespace accessvdb::internal

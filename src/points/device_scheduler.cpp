// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The exact policy on a backend that decides by itself what is due (launch/point_updater.h): the host only says which
/// points are new, touched or confident by now, and in which leaves facts flipped. What comes out is what
/// exact_scheduler.cpp brings out.
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <bit>
#include <limits>
#include <numeric>
#include <vector>

#include "points/device_blocks.h"
#include "points/flip_set.h"
#include "points/leaf_footprint.h"
#include "points/neighbourhood.h"
#include "points/offset_directions.h"
#include "points/stopwatch.h"
#include "points/update_scheduler.h"

namespace accessvdb::internal {
namespace {

/// Points and blocks handed over at a time.
constexpr std::size_t kMostNews = 1 << 16, kMostBlocks = 1 << 14;
/// Flipped leaves are joined once this many wait, so that a long stretch without updates takes bounded memory.
constexpr std::size_t kMostFlips = std::size_t{1} << 22;
/// Memory that the table of directions by offset may take; above it, collisions are not remembered.
constexpr std::uint64_t kMostOffsetTableBytes = std::uint64_t{512} << 20;

void copy3(const Eigen::Vector3f& from, float* to) {
  for (Eigen::Index axis = 0; axis < 3; ++axis) to[axis] = from[axis];
}

std::uint32_t kindsOf(const LeafChange& change) {
  std::uint32_t kinds = 0;
  for (const FlipKind kind : {FlipKind::CollidesOn, FlipKind::CollidesOff, FlipKind::ArmFreeOn, FlipKind::ArmFreeOff}) {
    std::uint64_t any = 0;
    for (const std::uint64_t word : bitsOf(change, kind)) any |= word;
    if (any != 0) kinds |= bitOf(kind);
  }
  return kinds;
}

std::size_t countBits(const LeafBits& bits) {
  std::size_t count = 0;
  for (const std::uint64_t word : bits) count += static_cast<std::size_t>(std::popcount(word));
  return count;
}

class DeviceScheduler final : public UpdateScheduler {
 public:
  DeviceScheduler(PointScorer& scorer, std::unique_ptr<kernels::PointUpdater> updater)
      : scorer_(scorer), updater_(std::move(updater)) {}

  void noteScan(const TouchedPoints& touched, std::span<const Eigen::Vector3f>, std::span<const Eigen::Vector3f>,
                std::span<const std::span<const LeafChange>> changes) override {
    for (std::size_t n = 0; n < touched.all.size(); ++n) {
      const std::uint32_t id = touched.all[n];
      if (id >= known_points_ || is_touched_[id] != 0) continue;  // new, or the older position counts
      is_touched_[id] = 1;
      touched_.push_back({id, touched.before_L[n]});
    }
    if (anything_scored_) noteFlips(changes);
  }

  UpdateStats update(const ScoringTables& tables) override {
    UpdateStats stats;
    const Stopwatch updating;
    const PointStore& points = scorer_.points();
    scorer_.growDevice();
    admitBlocks();
    admitPoints();
    const std::vector<kernels::CrossedPoint> crossed = findCrossed();
    const double host_ms = updating.milliseconds();

    kernels::UpdateInput input;
    input.map = tables.map;
    input.tool = tables.tool;
    input.approach = tables.approach;
    input.points = scorer_.device().view();
    input.rule = tables.rule;
    input.crossed = crossed;
    input.flips = flips_;
    input.freed = freed_;
    input.forget = forget_;
    const kernels::UpdateOutcome outcome = updater_->update(input);
    for (const Touched& touched : touched_) is_touched_[touched.id] = 0;
    touched_.clear();
    flips_.clear();
    freed_.clear();
    forget_ = false;
    joined_flips_ = 0;
    known_points_ = points.size();
    is_touched_.resize(known_points_, 0);
    anything_scored_ = anything_scored_ || outcome.evaluated > 0;

    stats.dirty_points = outcome.moved + outcome.evaluated;
    stats.scored_points = outcome.scored;
    stats.direction_tests = outcome.tests;
    stats.label_changes = outcome.label_changes;
    stats.update_ms = host_ms + outcome.select_ms;
    stats.score_ms = outcome.score_ms;
    return stats;
  }

  std::uint64_t bytes() const override {
    return (fresh_.capacity() + ids_.capacity()) * sizeof(std::uint32_t) + touched_.capacity() * sizeof(Touched) +
           is_touched_.capacity() + news_.capacity() * sizeof(kernels::PointNews) + blocks_.bytes() +
           flips_.capacity() * sizeof(kernels::LeafFlips) + freed_.capacity() * sizeof(kernels::VoxelIndex);
  }
  std::uint64_t deviceBytes() const override { return updater_->bytes(); }

 private:
  struct Touched {
    std::uint32_t id;
    Eigen::Vector3f before_L;  ///< at the last update
  };

  void noteFlips(std::span<const std::span<const LeafChange>> changes) {
    std::vector<std::size_t> begin(changes.size() + 1, 0), freed_begin(changes.size() + 1, 0);
    tbb::parallel_for(std::size_t{0}, changes.size(), [&](std::size_t n) {
      begin[n + 1] = changes[n].size();
      for (const LeafChange& change : changes[n]) freed_begin[n + 1] += countBits(change.collides_off);
    });
    begin[0] = flips_.size();
    freed_begin[0] = freed_.size();
    std::partial_sum(begin.begin(), begin.end(), begin.begin());
    std::partial_sum(freed_begin.begin(), freed_begin.end(), freed_begin.begin());
    flips_.resize(begin.back());
    freed_.resize(freed_begin.back());
    tbb::parallel_for(std::size_t{0}, changes.size(), [&](std::size_t n) {
      std::size_t at = begin[n], freed_at = freed_begin[n];
      for (const LeafChange& change : changes[n]) {
        const Index3 leaf = parentOf(change.origin_ijk);
        flips_[at++] = {{leaf[0], leaf[1], leaf[2]}, kindsOf(change)};
        for (std::size_t x = 0; x < 8; ++x) {
          for (std::uint64_t bits = change.collides_off[x]; bits != 0; bits &= bits - 1) {
            const int bit = std::countr_zero(bits);
            freed_[freed_at++] = {{change.origin_ijk[0] + static_cast<std::int32_t>(x),
                                   change.origin_ijk[1] + (bit >> 3), change.origin_ijk[2] + (bit & 7)}};
          }
        }
      }
    });
    if (freed_.size() > kMostFlips) {
      freed_.clear();
      forget_ = true;
    }
    if (flips_.size() > 2 * joined_flips_ + kMostFlips) joinFlips();
  }

  void joinFlips() {
    const auto place = [](const kernels::LeafFlips& f) { return std::array{f.leaf[0], f.leaf[1], f.leaf[2]}; };
    tbb::parallel_sort(flips_.begin(), flips_.end(),
                       [&](const kernels::LeafFlips& a, const kernels::LeafFlips& b) { return place(a) < place(b); });
    std::size_t out = 0;
    for (const kernels::LeafFlips& flip : flips_) {
      if (out > 0 && place(flips_[out - 1]) == place(flip)) {
        flips_[out - 1].kinds |= flip.kinds;
      } else {
        flips_[out++] = flip;
      }
    }
    flips_.resize(out);
    joined_flips_ = out;
  }

  [[nodiscard]] kernels::AdmitInput admission() const {
    kernels::AdmitInput input;
    input.points = scorer_.device().view();
    input.num_points = scorer_.points().size();
    input.num_blocks = static_cast<std::uint32_t>(scorer_.points().index().blocks().size());
    input.num_slots = blocks_.slots();
    return input;
  }

  /// Blocks with new points.
  void admitBlocks() {
    const PointStore& points = scorer_.points();
    std::vector<std::uint32_t> changed;
    for (std::uint32_t id = known_points_; id < points.size(); ++id) changed.push_back(points.blockOf(id));
    tbb::parallel_sort(changed);
    changed.erase(std::unique(changed.begin(), changed.end()), changed.end());
    std::vector<kernels::BlockNews> news;
    std::vector<std::uint32_t> ids;
    for (std::size_t n = 0; n < changed.size(); ++n) {
      news.push_back(blocks_.news(changed[n], points.index().blocks()[changed[n]], ids));
      if (news.size() < kMostBlocks && n + 1 < changed.size()) continue;
      kernels::AdmitInput input = admission();
      input.blocks = news;
      input.block_ids = ids;
      updater_->admit(input);
      news.clear();
      ids.clear();
    }
  }

  /// New points and touched ones.
  void admitPoints() {
    const PointStore& points = scorer_.points();
    const std::size_t new_points = points.size() - known_points_, all = touched_.size() + new_points;
    std::vector<std::uint16_t> weights;
    for (std::size_t first = 0; first < all; first += kMostNews) {
      const std::size_t count = std::min(all - first, kMostNews);
      ids_.resize(count);
      for (std::size_t n = 0; n < count; ++n) {
        ids_[n] = first + n < touched_.size() ? touched_[first + n].id
                                              : known_points_ + static_cast<std::uint32_t>(first + n - touched_.size());
      }
      weights.resize(count);
      scorer_.reads().weights(ids_, weights);
      news_.resize(count);
      tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 1024), [&](const auto& range) {
        for (std::size_t n = range.begin(); n != range.end(); ++n) {
          const std::uint32_t id = ids_[n];
          kernels::PointNews& news = news_[n];
          news.id = id;
          news.block = points.blockOf(id);
          copy3(points.first_L(id), news.position_L);
          copy3(points.pca_L(id), news.mean_L);
          copy3(points.toSensor_L(id), news.to_sensor_L);
          constexpr float kNew = std::numeric_limits<float>::quiet_NaN();
          copy3(first + n < touched_.size() ? touched_[first + n].before_L : Eigen::Vector3f::Constant(kNew),
                news.before_L);
          news.weight = weights[n];
          news.seen = points.seen(id);
        }
      });
      kernels::AdmitInput input = admission();
      input.news = news_;
      updater_->admit(input);
    }
  }

  /// Points whose confidence crossed the bound. Weights only grow, so only points below it are looked at.
  std::vector<kernels::CrossedPoint> findCrossed() {
    for (std::uint32_t id = known_points_; id < scorer_.points().size(); ++id) fresh_.push_back(id);
    std::vector<std::uint16_t> weights(fresh_.size());
    scorer_.reads().weights(fresh_, weights);
    std::vector<kernels::CrossedPoint> crossed;
    std::size_t left = 0;
    for (std::size_t n = 0; n < fresh_.size(); ++n) {
      if (scorer_.isConfident(weights[n])) {
        crossed.push_back({fresh_[n], weights[n]});
      } else {
        fresh_[left++] = fresh_[n];
      }
    }
    fresh_.resize(left);
    return crossed;
  }

  PointScorer& scorer_;
  std::unique_ptr<kernels::PointUpdater> updater_;
  DeviceBlocks blocks_;
  std::uint32_t known_points_ = 0;  ///< admitted; those behind are new
  bool anything_scored_ = false;
  std::vector<Touched> touched_;           ///< known points that scans touched since the last update
  std::vector<std::uint8_t> is_touched_;   ///< [known_points_]
  std::vector<std::uint32_t> fresh_;       ///< below the confidence bound
  std::vector<kernels::LeafFlips> flips_;  ///< since the last update
  std::vector<kernels::VoxelIndex> freed_;
  bool forget_ = false;           ///< freed_ would have become too long
  std::size_t joined_flips_ = 0;  ///< of them, the first: each leaf once
  std::vector<std::uint32_t> ids_;
  std::vector<kernels::PointNews> news_;
};

}  // namespace

std::unique_ptr<UpdateScheduler> makeDeviceScheduler(PointScorer& scorer, const kernels::ToolKernelView& tool,
                                                     const kernels::ApproachView& approach) {
  const FieldParams& params = scorer.params();
  const double voxel_size_m = params.tsdf.voxel_size_m;
  const LeafFootprint footprint(tool, approach, voxel_size_m);
  kernels::UpdaterTables tables;
  tables.tool_columns = footprint.toolColumns();
  tables.arm_columns = footprint.armColumns();
  tables.voxel_size_m = voxel_size_m;
  tables.radius_m = neighbourRadius_m(voxel_size_m);
  tables.neighbours = params.scoring.neighbours;
  tables.view_neighbours = params.scoring.join_neighbour_views ? static_cast<int>(kViewNeighbours) : 0;
  tables.num_directions = approach.num_directions;
  const OffsetDirections offsets(tool, approach.num_directions, kMostOffsetTableBytes);
  tables.offset_directions = offsets.table();
  std::ranges::copy(offsets.low(), tables.offset_low);
  std::ranges::copy(offsets.size(), tables.offset_size);
  auto updater = scorer.backend().makeUpdater(tables);
  if (updater == nullptr) return nullptr;
  return std::make_unique<DeviceScheduler>(scorer, std::move(updater));
}

}  // namespace accessvdb::internal

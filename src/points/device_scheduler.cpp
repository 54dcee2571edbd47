// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The exact policy on a backend that decides by itself what is due (launch/point_updater.h): the host only says which
/// points are new, touched or confident by now, and in which leaves facts flipped. What comes out is what
/// exact_scheduler.cpp brings out.
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <bit>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include "hostdev/cell_counts.h"
#include "points/block_groups.h"
#include "points/cell_directions.h"
#include "points/device_blocks.h"
#include "points/flip_set.h"
#include "points/fresh_points.h"
#include "points/leaf_footprint.h"
#include "points/neighbourhood.h"
#include "points/run_beside.h"
#include "points/update_scheduler.h"

namespace accessvdb::internal {
namespace {

/// Points and blocks handed over at a time.
constexpr std::size_t kMostNews = 1 << 16, kMostBlocks = 1 << 14;
/// Flipped leaves are joined once this many wait, so that a long stretch without updates takes bounded memory.
constexpr std::size_t kMostFlips = std::size_t{1} << 22;
/// Memory that the table of directions by cell may take; above it, collisions are not remembered.
constexpr std::uint64_t kMostCellTableBytes = std::uint64_t{256} << 20;

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

/// Sums of two counts of freed voxels, cell by cell.
std::uint64_t joinedFreed(std::uint64_t a, std::uint64_t b) {
  std::uint64_t sum = 0;
  for (int shift = 0; shift < 64; shift += 8) {
    const std::uint64_t cell = (a >> shift & 0xff) + (b >> shift & 0xff);
    sum |= std::min<std::uint64_t>(cell, kernels::LeafFlips::kManyFreed) << shift;
  }
  return sum;
}

class DeviceScheduler final : public UpdateScheduler {
 public:
  /// @param group_log2  the updater's
  DeviceScheduler(PointScorer& scorer, std::unique_ptr<kernels::PointUpdater> updater, int group_log2)
      : scorer_(scorer), updater_(std::move(updater)), blocks_(group_log2), fresh_(scorer.points()) {
    while (least_weight_ < std::numeric_limits<std::uint16_t>::max() && !scorer_.isConfident(least_weight_)) {
      ++least_weight_;
    }
  }

  void noteReturns(const TouchedPoints& touched, std::span<const Eigen::Vector3f> p_L,
                   std::span<const Eigen::Vector3f> q_L) override {
    for (std::size_t n = 0; n < touched.all.size(); ++n) {
      const std::uint32_t id = touched.all[n];
      if (id >= known_points_ || is_touched_[id] != 0) continue;  // new, or the older position counts
      is_touched_[id] = 1;
      touched_.push_back({id, touched.before_L[n]});
    }
    flips_begun_ = map_read_ = false;
    // While the map takes the scan in, the backend finds neighbours. Should another scan come before the update, that
    // was for nothing, and all are admitted anew.
    if (++scans_ == 1) {
      listNews();
      admit();
      updater_->findNeighbours();
    }
    const auto take = [this](std::span<const Index3> leaves) { fresh_.noteReached(leaves); };
    if (!scorer_.reads().reached(p_L, q_L, take)) fresh_.noteAll();
  }

  bool seesChanges() const override { return true; }
  void noteChange(std::size_t part, const LeafChange& change) override {
    if (!anything_scored_) return;
    const Index3 leaf = parentOf(change.origin_ijk);
    flip_parts_[part].push_back(
        {{leaf[0], leaf[1], leaf[2]}, kindsOf(change), kernels::countCells(change.collides_off.data())});
  }

  void noteChanges(std::span<const Eigen::Vector3f>, std::span<const Eigen::Vector3f>,
                   std::span<const std::span<const LeafChange>>) override {
    std::array<std::size_t, kMostParts + 1> begin = {flips_.size()};
    for (std::size_t n = 0; n < kMostParts; ++n) begin[n + 1] = begin[n] + flip_parts_[n].size();
    flips_.resize(begin.back());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, kMostParts, 16), [&](const auto& range) {
      for (std::size_t n = range.begin(); n != range.end(); ++n) {
        std::ranges::copy(flip_parts_[n], flips_.begin() + static_cast<std::ptrdiff_t>(begin[n]));
        flip_parts_[n].clear();
      }
    });
    if (flips_.size() > 2 * joined_flips_ + kMostFlips) joinFlips();
  }

  // Should another scan come before the update, all flips are handed over again, and weights are read again.
  void prepare(const ScoringTables& tables) override {
    if (scans_ != 1) return;
    updater_->begin(inputOf(tables));
    flips_begun_ = true;
  }
  void readMap() override {
    if (scans_ != 1) return;
    readWeights();
    map_read_ = true;
  }

  UpdateStats update(const ScoringTables& tables) override {
    UpdateStats stats;
    const bool admitted = std::exchange(scans_, 0) == 1, begun = std::exchange(flips_begun_, false),
               read = std::exchange(map_read_, false);
    if (!admitted) listNews();
    scorer_.growDevice();
    const auto to_backend = [&] {
      if (!begun) updater_->begin(inputOf(tables));
      if (!admitted) admit();
    };
    const auto on_host = [&] {
      if (!read) readWeights();
    };
    runBeside(to_backend, on_host);
    kernels::UpdateInput input = inputOf(tables);
    input.weights = weights_;
    takeConfident();
    input.crossed = crossed_;
    kernels::UpdateOutcome outcome;
    runBeside([&] { outcome = updater_->update(input); }, [&] { knowNews(); });
    flips_.clear();
    joined_flips_ = 0;
    crossed_.clear();
    anything_scored_ = anything_scored_ || outcome.evaluated > 0;

    stats.dirty_points = outcome.moved + outcome.evaluated;
    stats.scored_points = outcome.scored;
    stats.direction_tests = outcome.tests;
    stats.label_changes = outcome.label_changes;
    stats.score_ms = outcome.score_ms;
    return stats;
  }

  std::uint64_t bytes() const override {
    const auto bytesOf = [](const auto& list) { return list.capacity() * sizeof(list[0]); };
    std::uint64_t bytes = fresh_.bytes() + bytesOf(ids_) + bytesOf(weights_) + bytesOf(crossed_) +
                          bytesOf(read_weights_) + bytesOf(touched_) + is_touched_.bytes() + bytesOf(news_) +
                          blocks_.bytes() + bytesOf(block_news_) + bytesOf(block_ids_) + bytesOf(flips_) +
                          bytesOf(reached_.voxels) + bytesOf(reached_.blocks);
    for (const std::vector<kernels::LeafFlips>& part : flip_parts_) bytes += bytesOf(part);
    return bytes;
  }
  std::uint64_t deviceBytes() const override { return updater_->bytes(); }

 private:
  struct Touched {
    std::uint32_t id;
    Eigen::Vector3f before_L;  ///< at the last update
  };

  [[nodiscard]] kernels::UpdateInput inputOf(const ScoringTables& tables) const {
    kernels::UpdateInput input;
    input.map = tables.map;
    input.tool = tables.tool;
    input.slabs = tables.slabs;
    input.approach = tables.approach;
    input.points = scorer_.device().view();
    input.rule = tables.rule;
    input.flips = flips_;
    return input;
  }

  void joinFlips() {
    const auto place = [](const kernels::LeafFlips& f) { return std::array{f.leaf[0], f.leaf[1], f.leaf[2]}; };
    tbb::parallel_sort(flips_.begin(), flips_.end(),
                       [&](const kernels::LeafFlips& a, const kernels::LeafFlips& b) { return place(a) < place(b); });
    std::size_t out = 0;
    for (const kernels::LeafFlips& flip : flips_) {
      if (out > 0 && place(flips_[out - 1]) == place(flip)) {
        flips_[out - 1].kinds |= flip.kinds;
        flips_[out - 1].freed = joinedFreed(flips_[out - 1].freed, flip.freed);
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
    input.num_groups = blocks_.groups();
    input.num_slots = blocks_.slots();
    return input;
  }

  /// The points that came since the last update: the touched ones, then the new ones.
  void listNews() {
    scorer_.reserveDevice();
    ids_.resize(touched_.size() + (scorer_.points().size() - known_points_));
    for (std::size_t n = 0; n < touched_.size(); ++n) ids_[n] = touched_[n].id;
    std::iota(ids_.begin() + static_cast<std::ptrdiff_t>(touched_.size()), ids_.end(), known_points_);
  }

  /// Hands them over. Isolated, or this thread might take up work beside it while it waits, and what comes next would
  /// wait for that.
  void admit() {
    tbb::this_task_arena::isolate([this] {
      admitBlocks();
      admitPoints();
    });
  }

  /// Blocks with new points.
  void admitBlocks() {
    const PointStore& points = scorer_.points();
    std::vector<std::uint32_t> changed(points.size() - known_points_);
    for (std::size_t n = 0; n < changed.size(); ++n) {
      changed[n] = points.blockOf(known_points_ + static_cast<std::uint32_t>(n));
    }
    tbb::parallel_sort(changed);
    changed.erase(std::unique(changed.begin(), changed.end()), changed.end());
    for (std::size_t first = 0; first < changed.size(); first += kMostBlocks) {
      const std::size_t count = std::min(changed.size() - first, kMostBlocks);
      blocks_.news(std::span(changed).subspan(first, count), points.index().blocks(), block_news_, block_ids_);
      kernels::AdmitInput input = admission();
      input.blocks = block_news_;
      input.block_ids = block_ids_;
      updater_->admit(input);
    }
  }

  void admitPoints() {
    for (std::size_t first = 0; first < ids_.size(); first += kMostNews) {
      news_.resize(std::min(ids_.size() - first, kMostNews));
      tbb::parallel_for(tbb::blocked_range<std::size_t>(0, news_.size(), 256), [&](const auto& range) {
        for (std::size_t n = range.begin(); n != range.end(); ++n) news_[n] = newsOf(first + n);
      });
      kernels::AdmitInput input = admission();
      input.news = news_;
      updater_->admit(input);
    }
  }

  /// Of the points that came since the last update, and of those that became confident.
  void readWeights() {
    std::vector<std::uint32_t> crossed(crossed_.size());  // an earlier scan brought them above the bound
    std::ranges::transform(crossed_, crossed.begin(), &kernels::PointWeight::id);
    readWeightsOf(crossed, crossed_);
    findCrossed();
    readWeightsOf(ids_, weights_);
  }

  void readWeightsOf(std::span<const std::uint32_t> ids, std::vector<kernels::PointWeight>& points) {
    read_weights_.resize(ids.size());
    scorer_.reads().weights(ids, read_weights_);
    points.resize(ids.size());
    for (std::size_t n = 0; n < ids.size(); ++n) points[n] = {ids[n], read_weights_[n]};
  }

  /// Adds the new points that are confident at once to those that became so.
  void takeConfident() {
    for (std::size_t n = touched_.size(); n < ids_.size(); ++n) {
      if (weights_[n].weight >= least_weight_) crossed_.push_back(weights_[n]);
    }
    tbb::parallel_sort(crossed_.begin(), crossed_.end(), [](const auto& a, const auto& b) { return a.id < b.id; });
  }

  /// @param n  index into ids_
  [[nodiscard]] kernels::PointNews newsOf(std::size_t n) const {
    const PointStore& points = scorer_.points();
    const std::uint32_t id = ids_[n];
    kernels::PointNews news;
    news.id = id;
    news.block = points.blockOf(id);
    copy3(points.first_L(id), news.position_L);
    copy3(points.pca_L(id), news.mean_L);
    copy3(points.toSensor_L(id), news.to_sensor_L);
    constexpr float kNew = std::numeric_limits<float>::quiet_NaN();
    copy3(n < touched_.size() ? touched_[n].before_L : Eigen::Vector3f::Constant(kNew), news.before_L);
    news.seen = points.seen(id);
    return news;
  }

  /// The backend has them: the new ones below the bound wait from now on, and none is touched.
  void knowNews() {
    std::vector<std::uint32_t> fresh;
    for (std::size_t n = touched_.size(); n < ids_.size(); ++n) {
      if (weights_[n].weight < least_weight_) fresh.push_back(ids_[n]);
    }
    fresh_.add(fresh);
    for (const Touched& touched : touched_) is_touched_[touched.id] = 0;
    touched_.clear();
    known_points_ = scorer_.points().size();
    is_touched_.grow(known_points_);
  }

  /// Older points that became confident. Weights only grow, so only fresh ones are looked at, and of them those that
  /// scans reached since the last update.
  void findCrossed() {
    fresh_.takeReached(reached_);
    std::vector<std::uint16_t> weights(reached_.voxels.size());
    scorer_.reads().weights_at(reached_.voxels, weights);
    std::vector<std::uint32_t> entries;
    for (std::size_t n = 0; n < weights.size(); ++n) {
      if (weights[n] >= least_weight_) entries.push_back(static_cast<std::uint32_t>(n));
    }
    const std::size_t before = crossed_.size();
    crossed_.resize(before + entries.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, entries.size(), 512), [&](const auto& range) {
      for (std::size_t n = range.begin(); n != range.end(); ++n) {
        const std::uint32_t entry = entries[n];
        crossed_[before + n] = {scorer_.points().index().findIn(reached_.blocks[entry], reached_.voxels[entry]),
                                weights[entry]};
      }
    });
    fresh_.remove(reached_, entries);
  }

  PointScorer& scorer_;
  std::unique_ptr<kernels::PointUpdater> updater_;
  DeviceBlocks blocks_;
  std::uint32_t known_points_ = 0;  ///< admitted; those behind are new
  bool anything_scored_ = false;
  std::vector<Touched> touched_;               ///< known points that scans touched since the last update
  ChunkedArray<std::uint8_t> is_touched_;      ///< [known_points_]
  FreshPoints fresh_;                          ///< below the confidence bound
  FreshPlaces reached_;                        ///< of one update
  std::uint16_t least_weight_ = 0;             ///< that is confident
  std::vector<kernels::LeafFlips> flips_;      ///< since the last update
  std::size_t joined_flips_ = 0;               ///< of them, the first: each leaf once
  int scans_ = 0;                              ///< since the last update
  bool flips_begun_ = false;                   ///< prepare() came since the last scan
  bool map_read_ = false;                      ///< readMap() came since
  std::vector<std::uint32_t> ids_;             ///< listNews()
  std::vector<kernels::PointWeight> weights_;  ///< of ids_
  std::vector<kernels::PointWeight> crossed_;  ///< points that became confident since the last update
  std::vector<std::uint16_t> read_weights_;    ///< readWeightsOf()
  std::vector<kernels::PointNews> news_;
  std::vector<kernels::BlockNews> block_news_;
  std::vector<std::uint32_t> block_ids_;
  std::array<std::vector<kernels::LeafFlips>, kMostParts> flip_parts_;  ///< of the scan
};

}  // namespace

std::unique_ptr<UpdateScheduler> makeDeviceScheduler(PointScorer& scorer, const kernels::ToolKernelView& tool,
                                                     const kernels::ApproachView& approach) {
  const FieldParams& params = scorer.params();
  const double voxel_size_m = params.tsdf.voxel_size_m;
  const int group_log2 = blockGroupLog2(voxel_size_m);
  const LeafFootprint footprint(tool, approach, voxel_size_m, group_log2);
  kernels::UpdaterTables tables;
  tables.tool_columns = footprint.toolColumns();
  tables.arm_columns = footprint.armColumns();
  tables.voxel_size_m = voxel_size_m;
  tables.radius_m = neighbourRadius_m(voxel_size_m);
  tables.neighbours = params.scoring.neighbours;
  tables.view_neighbours = params.scoring.join_neighbour_views ? static_cast<int>(kViewNeighbours) : 0;
  tables.num_directions = approach.num_directions;
  tables.group_log2 = group_log2;
  const CellDirections cells(tool, approach.num_directions, group_log2, kMostCellTableBytes);
  tables.cell_directions = cells.table();
  std::ranges::copy(cells.low(), tables.cell_low);
  std::ranges::copy(cells.size(), tables.cell_size);
  auto updater = scorer.backend().makeUpdater(tables);
  if (updater == nullptr) return nullptr;
  return std::make_unique<DeviceScheduler>(scorer, std::move(updater), group_log2);
}

}  // namespace accessvdb::internal

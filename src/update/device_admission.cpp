// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/device_admission.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <limits>
#include <numeric>
#include <utility>

#include "accessvdb/error.h"
#include "points/neighbourhood.h"
#include "update/run_beside.h"

namespace accessvdb::internal {
namespace {

/// Most points and blocks handed over at a time.
constexpr std::size_t kMostDeltas = 1 << 16, kMostBlocks = 1 << 15;

}  // namespace

kernels::NeighbourTables neighbourTables(const FieldParams& resolved, int num_directions, int group_log2) {
  kernels::NeighbourTables tables;
  tables.voxel_size_m = resolved.tsdf.voxel_size_m;
  tables.radius_m = neighbourRadius_m(tables.voxel_size_m);
  tables.neighbours = resolved.scoring.neighbours;
  tables.view_neighbours = resolved.scoring.join_neighbour_views ? static_cast<int>(kViewNeighbours) : 0;
  tables.num_directions = num_directions;
  tables.group_log2 = group_log2;
  tables.choice = surfaceChoice(resolved);
  return tables;
}

kernels::ScoringInput ScoringInputs::of(const kernels::OccupancyGrid* mirror, int budget_points) {
  kernels::ScoringInput input;
  inputs_.clear();
  for (const ScheduledTool& tool : tools_) {
    const ScoringTables tables = tool.tables(mirror);
    inputs_.push_back({tables.tool, tables.slabs, tables.approach, tool.scorer.device().view(), tables.rule});
    input.map = tables.map;
  }
  input.tools = inputs_;
  input.budget_points = static_cast<std::uint32_t>(budget_points);
  return input;
}

UpdateStats statsOf(const kernels::UpdateOutcome& outcome) {
  UpdateStats stats;
  stats.dirty_points = outcome.moved + outcome.evaluated;
  stats.moved_points = outcome.moved;
  stats.scored_points = outcome.scored;
  stats.direction_tests = outcome.tests;
  stats.label_changes = outcome.label_changes;
  stats.backlog = outcome.waiting;
  stats.backlog_updates = outcome.waiting_updates;
  stats.withheld_points = outcome.withheld;
  stats.score_ms = outcome.score_ms;
  return stats;
}

DeviceAdmission::DeviceAdmission(std::vector<PointScorer*> scorers, kernels::PointAdmission& updater, int group_log2)
    : scorers_(std::move(scorers)),
      scorer_(*scorers_.front()),
      updater_(updater),
      blocks_(group_log2),
      fresh_(scorer_.points()) {
  while (least_weight_ < std::numeric_limits<std::uint16_t>::max() && !scorer_.isConfident(least_weight_)) {
    ++least_weight_;
  }
}

void DeviceAdmission::describeBlocks(std::span<const std::uint32_t> changed) {
  if (!isNextFirst() || changed.size() > kMostBlocks) return;
  blocks_.deltas(changed, scorer_.points().index().blocks(), block_deltas_, block_ids_);
  blocks_described_ = true;
}

bool DeviceAdmission::handOver(const TouchedPoints& touched) {
  if (++scans_ != 1) return false;
  if (touched.deltas.size() != touched.all.size()) {
    throw InternalError("admission.not_described", "", "A scan came without a description of the points it touched",
                        "Please report this");
  }
  ids_ = touched.all;
  admit([&] {
    admitBlocks(touched.changed_blocks);
    admitPoints(touched.deltas);
  });
  return true;
}

void DeviceAdmission::noteReturns(const TouchedPoints& touched, std::span<const Eigen::Vector3f> p_L,
                                  std::span<const Eigen::Vector3f> q_L, bool is_in_map) {
  const auto note = [&] {
    for (std::size_t n = 0; n < touched.all.size(); ++n) {
      const std::uint32_t id = touched.all[n];
      if (id >= known_points_ || is_touched_[id] != 0) continue;  // new, or its older position is already stored
      is_touched_[id] = 1;
      touched_.push_back({id, touched.before_L[n]});
    }
    const auto take = [this](std::span<const Index3> leaves) { fresh_.noteReached(leaves); };
    if (!scorer_.reads().reached(p_L, q_L, take)) fresh_.noteAll();
  };
  if (is_in_map) {
    runBeside([&] { readWeightsOf(touched.all, weights_); }, note);  // waits for the device
  } else {
    note();
  }
  has_weights_ = is_in_map;
}

void DeviceAdmission::growState() {
  for (PointScorer* scorer : scorers_) scorer->growDevice();
}

void DeviceAdmission::complete() {
  if (std::exchange(scans_, 0) != 1) admitAll();
}

/// The backend has the points now: new ones below the bound wait from here on, and none counts as touched.
void DeviceAdmission::know() {
  std::vector<std::uint32_t> fresh;
  for (std::size_t n = 0; n < ids_.size(); ++n) {
    if (ids_[n] >= known_points_ && weights_[n].weight < least_weight_) fresh.push_back(ids_[n]);
  }
  fresh_.add(fresh);
  for (const Touched& touched : touched_) is_touched_[touched.id] = 0;
  touched_.clear();
  known_points_ = scorer_.points().size();
  is_touched_.grow(known_points_);
}

/// Runs `hand_over` in isolation: otherwise this thread might pick up unrelated work while it waits, and delay what
/// follows.
template <typename HandOver>
void DeviceAdmission::admit(const HandOver& hand_over) {
  for (PointScorer* scorer : scorers_) scorer->reserveDevice();
  tbb::this_task_arena::isolate(hand_over);
}

void DeviceAdmission::admitBlocks(std::span<const std::uint32_t> changed) {
  bool is_described = std::exchange(blocks_described_, false);  // the first part, which is all
  for (std::size_t first = 0; first < changed.size(); first += kMostBlocks) {
    const std::size_t count = std::min(changed.size() - first, kMostBlocks);
    if (!std::exchange(is_described, false)) {
      blocks_.deltas(changed.subspan(first, count), scorer_.points().index().blocks(), block_deltas_, block_ids_);
    }
    kernels::AdmitInput part = input();
    part.blocks = block_deltas_;
    part.block_ids = block_ids_;
    updater_.admit(part);
  }
}

void DeviceAdmission::admitPoints(std::span<const kernels::PointDelta> deltas) {
  for (std::size_t first = 0; first < deltas.size(); first += kMostDeltas) {
    kernels::AdmitInput part = input();
    part.deltas = deltas.subspan(first, std::min(deltas.size() - first, kMostDeltas));
    if (scorer_.choice().isMade()) part.returns = returnsOf(part.deltas);
    updater_.admit(part);
  }
}

/// @return valid until the next call
std::span<const std::uint32_t> DeviceAdmission::returnsOf(std::span<const kernels::PointDelta> deltas) {
  returns_.resize(deltas.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, deltas.size(), 1024), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) returns_[n] = scorer_.points().returns(deltas[n].id);
  });
  return returns_;
}

/// Hands over what several scans, or none, have brought: the points in their current state.
void DeviceAdmission::admitAll() {
  const PointStore& points = scorer_.points();
  const std::size_t added = points.size() - known_points_;
  ids_.resize(touched_.size() + added);
  for (std::size_t n = 0; n < touched_.size(); ++n) ids_[n] = touched_[n].id;
  std::iota(ids_.begin() + static_cast<std::ptrdiff_t>(touched_.size()), ids_.end(), known_points_);
  admit([&] {
    std::vector<std::uint32_t> changed(added);
    for (std::size_t n = 0; n < added; ++n) changed[n] = points.blockOf(ids_[touched_.size() + n]);
    tbb::parallel_sort(changed);
    changed.erase(std::unique(changed.begin(), changed.end()), changed.end());
    admitBlocks(changed);
    for (std::size_t first = 0; first < ids_.size(); first += kMostDeltas) {
      deltas_.resize(std::min(ids_.size() - first, kMostDeltas));
      tbb::parallel_for(tbb::blocked_range<std::size_t>(0, deltas_.size(), 256), [&](const auto& range) {
        const Eigen::Vector3f none = Eigen::Vector3f::Constant(std::numeric_limits<float>::quiet_NaN());
        for (std::size_t n = range.begin(); n != range.end(); ++n) {
          const std::size_t at = first + n;
          deltas_[n] = points.deltaOf(ids_[at], at < touched_.size() ? touched_[at].before_L : none);
        }
      });
      admitPoints(deltas_);
    }
  });
}

void DeviceAdmission::readWeights() {
  crossed_.clear();
  if (std::exchange(has_weights_, false)) {
    findCrossed();
  } else {
    runBeside([&] { findCrossed(); }, [&] { readWeightsOf(ids_, weights_); });
  }
  takeConfident();
}

void DeviceAdmission::readWeightsOf(std::span<const std::uint32_t> ids, std::vector<kernels::PointWeight>& points) {
  read_weights_.resize(ids.size());
  scorer_.reads().weights(ids, read_weights_);
  points.resize(ids.size());
  for (std::size_t n = 0; n < ids.size(); ++n) points[n] = {ids[n], read_weights_[n]};
}

kernels::AdmitInput DeviceAdmission::input() {
  states_.clear();
  for (const PointScorer* scorer : scorers_) states_.push_back(scorer->device().view());
  kernels::AdmitInput all;
  all.states = states_;
  all.num_points = scorer_.points().size();
  all.num_blocks = static_cast<std::uint32_t>(scorer_.points().index().blocks().size());
  all.num_groups = blocks_.groups();
  all.num_slots = blocks_.slots();
  return all;
}

/// Adds new points that are confident immediately to those that became confident, which are older. New ones are in
/// order: ids_ names them so.
void DeviceAdmission::takeConfident() {
  for (std::size_t n = 0; n < ids_.size(); ++n) {
    if (ids_[n] >= known_points_ && weights_[n].weight >= least_weight_) crossed_.push_back(weights_[n]);
  }
}

/// Finds older points that became confident, and orders them. Weights only grow, so it checks only fresh points, and
/// only those that scans reached since the last update.
void DeviceAdmission::findCrossed() {
  fresh_.takeReached(reached_);
  std::vector<std::uint16_t> weights(reached_.voxels.size());
  scorer_.reads().weights_at(reached_.voxels, weights);
  std::vector<std::uint32_t> entries;
  for (std::size_t n = 0; n < weights.size(); ++n) {
    if (weights[n] >= least_weight_) entries.push_back(static_cast<std::uint32_t>(n));
  }
  crossed_.resize(entries.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, entries.size(), 512), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      const std::uint32_t entry = entries[n];
      crossed_[n] = {scorer_.points().index().findIn(reached_.blocks[entry], reached_.voxels[entry]), weights[entry]};
    }
  });
  fresh_.remove(reached_, entries);
  tbb::parallel_sort(crossed_.begin(), crossed_.end(), [](const auto& a, const auto& b) { return a.id < b.id; });
}

void DeviceAdmission::noteWaiting(kernels::UpdateOutcome& outcome) {
  outcome.waiting_ids.resize(scorers_.size());
  for (std::size_t k = 0; k < scorers_.size(); ++k) scorers_[k]->setWaiting(std::move(outcome.waiting_ids[k]));
}

std::uint64_t DeviceAdmission::bytes() const {
  const auto bytesOf = [](const auto& list) { return list.capacity() * sizeof(list[0]); };
  return blocks_.bytes() + fresh_.bytes() + is_touched_.bytes() + bytesOf(touched_) + bytesOf(reached_.voxels) +
         bytesOf(reached_.blocks) + bytesOf(ids_) + bytesOf(weights_) + bytesOf(crossed_) + bytesOf(read_weights_) +
         bytesOf(deltas_) + bytesOf(returns_) + bytesOf(block_deltas_) + bytesOf(block_ids_);
}

}  // namespace accessvdb::internal

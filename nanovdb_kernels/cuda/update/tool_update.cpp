// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cuda/update/tool_update.h"

#include <algorithm>
#include <utility>

#include "cuda/memory/cuda_check.h"
#include "launch/stopwatch.h"

namespace accessvdb::kernels {
namespace {

/// Shared memory that a block gets without asking.
constexpr int kPlainSharedBytes = 44 * 1024;

}  // namespace

ToolUpdate::ToolUpdate(std::shared_ptr<DeviceContext> context, DeviceMemory& memory, const NeighbourTables& neighbours,
                       const ToolTables& tables, DeviceCounters& counters)
    : context_(std::move(context)),
      counters_(counters),
      footprint_(memory, tables, neighbours.group_log2),
      known_(context_, memory, tables, neighbours.num_directions),
      masks_(context_, memory),
      due_(memory, &counters.data()->search),
      queue_(memory) {
  search_.multiprocessors = context_->multiprocessors();
}

void ToolUpdate::grow(const AdmitInput& input) {
  due_.growBlocks(input.num_blocks, stream());
  known_.grow(input.num_points, input.num_groups, stream());
}

void ToolUpdate::takeFlips(const ToolInput& input, const PointsView& points, const FlipsView* flips,
                           float inverse_voxel_size) {
  known_.setLimit(input.tool.collision_limit);
  masks_.clear();
  flips_.reset();
  if (flips == nullptr) return;
  flips_ = *flips;
  const FlipContext context = {points.index,       points.groups, footprint_.view(),
                               known_.cells(),     known_.view(), input.approach.num_directions,
                               known_.corridors(), input.points,  inverse_voxel_size};
  masks_.make(context, points.num_points, *flips, stream());
}

void ToolUpdate::follow(const ToolInput& input, const PointsView& points, float inverse_voxel_size, cudaEvent_t ready) {
  const cudaStream_t beside = context_->besideStream();
  ACCESSVDB_CUDA(cudaStreamWaitEvent(beside, ready));
  masks_.addGroups(points.groups.groups, beside);
  known_.beginUpdate(points.num_points, beside);
  if (flips_ && known_.follows()) {
    PointsView own = points;
    own.points = input.points;
    launchFollowFlips({own, known_.view(), known_.arcs(), *flips_, masks_.masks(), inverse_voxel_size}, beside);
  }
  ACCESSVDB_CUDA(cudaEventRecord(followed_.get(), beside));
}

void ToolUpdate::choose(const ToolInput& input, const Setting& setting) {
  ACCESSVDB_CUDA(cudaStreamWaitEvent(stream(), followed_.get()));
  setting_ = setting;
  setting_.points.points = input.points;
  evaluation_ = {input.approach, input.rule, known_.view()};
  const std::uint32_t num_points = setting_.points.num_points;
  waits_ = setting_.budget_points > 0 || queue_.size() > 0;
  if (waits_) queue_.grow(num_points, stream());
  due_.setWaiting(waits_ ? queue_.flags() : nullptr);
  due_.growItems(num_points);
  items_ = 0;
  search_.map = setting_.map;
  search_.tool = input.tool;
  search_.slabs = input.slabs;
  search_.tool.reach = footprint_.reachOfSearch();
  // More than a block gets without asking would come out of the cache; each node takes two entries.
  search_.window = planWindow(search_.tool, kPlainSharedBytes / BusyMapView::kEntries, false);
  search_.busy = setting_.busy;
}

void ToolUpdate::takeMoved(const PointChunk& part, const FoundNeighbourhood* before) {
  takeRoom(part.count, part.count);
  launchDueAfterMoves(dueContext(), part, before, setting_.changed_bits, stream());
}

void ToolUpdate::takeFlipped() {
  if (masks_.masks().affected == nullptr) return;
  launchPlaceFlipped(dueContext(), setting_.changed_bits, stream());
  const UpdateCounters counters = counters_.read(stream());
  const std::uint32_t points = counters.search.near_flips;
  items_ = counters.search.due;
  for (std::uint32_t first = 0, part = 0; first < points; first += part) {
    // The last block of a part may pass its end.
    part = takeRoom(points - first + kMostInBlock, DueLists::kLeastItems) - kMostInBlock;
    launchDueByFlips(dueContext(), first, part, setting_.changed_bits, stream());
  }
}

void ToolUpdate::takeTurn() {
  if (!waits_) return;
  const std::uint32_t before = queue_.size();
  queue_.addFrom(setting_.points.num_points, {kAsked, kAsked}, stream());
  const std::uint32_t all = queue_.size(),
                      turn = setting_.budget_points > 0 ? std::min(all, setting_.budget_points) : all;
  age_.note(all - before, turn);
  for (std::uint32_t first = 0, part = 0; first < turn; first += part) {
    part = takeRoom(std::min(turn - first, kMovedChunk), kMovedChunk);
    launchDueAfterWaiting(dueContext(), {queue_.ids() + first, part}, stream());
  }
  queue_.drop(turn, stream());
}

/// Reserves room for more items, as many as fit, but at least `at_least` or all. @return how many
std::uint32_t ToolUpdate::takeRoom(std::uint32_t wanted, std::uint32_t at_least) {
  const std::uint32_t least = std::min(wanted, at_least);
  if (items_ + least > due_.capacity()) items_ = counters_.read(stream()).search.due;
  if (items_ + least > due_.capacity()) evaluate();
  const std::uint32_t taken = std::min(wanted, due_.capacity() - items_);
  items_ += taken;
  return taken;
}

void ToolUpdate::evaluate() {
  const std::uint32_t busy = counters_.read(stream()).search.busy;
  const Stopwatch scoring;
  const DueWork work = {setting_.points, evaluation_, due_.ordered(setting_.points.index, busy, stream()),
                        &counters_.data()->outcome};
  launchDueSearch(work, search_, busy, {stream(), context_->priorityStream(), fork_.get(), join_.get()});
  ACCESSVDB_CUDA(cudaStreamSynchronize(stream()));
  score_ms_ += scoring.milliseconds();
  items_ = 0;
}

double ToolUpdate::takeScore_ms() { return std::exchange(score_ms_, 0.0); }

}  // namespace accessvdb::kernels

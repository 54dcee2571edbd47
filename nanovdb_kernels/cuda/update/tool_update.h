// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What each tool has of an exact update for itself: what flips mean for it, what is due at the points, and their
/// evaluation. What it does not own is the same for all tools of an updater.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "cuda/memory/device_context.h"
#include "cuda/memory/owned_event.h"
#include "cuda/update/device_counters.h"
#include "cuda/update/due_lists.h"
#include "cuda/update/footprint_table.h"
#include "cuda/update/group_mask_table.h"
#include "cuda/update/known_tables.h"
#include "cuda/update/update_kernels.h"
#include "cuda/update/work_queue.h"
#include "launch/exact_updater.h"
#include "launch/queue_age.h"

namespace accessvdb::kernels {

class ToolUpdate {
 public:
  /// Most moved points for which room is taken at a time.
  static constexpr std::uint32_t kMovedChunk = DueLists::kLeastItems;

  /// @param counters  its search and its outcome count there; must outlive this
  ToolUpdate(std::shared_ptr<DeviceContext> context, DeviceMemory& memory, const NeighbourTables& neighbours,
             const ToolTables& tables, DeviceCounters& counters);

  /// Makes room for what is admitted.
  void grow(const AdmitInput& input);
  [[nodiscard]] const KnownView& known() const { return known_.view(); }

  /// Finds out what flips mean, and ages what is known. @param flips  null: there are none
  void takeFlips(const ToolInput& input, const PointsView& points, const FlipsView* flips, float inverse_voxel_size);

  /// Lets what is known follow the flips, beside what the stream still does. Once per update, before choose().
  /// @param ready  recorded once flips and points are there
  void follow(const ToolInput& input, const PointsView& points, float inverse_voxel_size, cudaEvent_t ready);
  /// What its tools share of an update.
  struct Setting {
    PointsView points;
    OccupancyView map;
    BusyMapView busy;
    std::uint32_t budget_points = 0;
    const std::uint32_t* changed_bits = nullptr;  ///< from launchStoreNeighbours
  };
  /// Sets what the rest of this update reads. Once per update.
  void choose(const ToolInput& input, const Setting& setting);
  /// Lists what is due at some moved points, at most kMovedChunk. @param before  from launchStoreNeighbours
  void takeMoved(const PointChunk& part, const FoundNeighbourhood* before);
  /// Lists what is due because of flips alone.
  void takeFlipped();
  /// Lists what is due at the first points in the queue; only where points wait.
  void takeTurn();
  /// Evaluates what is due so far.
  void evaluate();

  [[nodiscard]] std::uint32_t waiting() const { return queue_.size(); }
  /// Which points wait. After evaluate().
  [[nodiscard]] WorkQueue::Left left() { return queue_.left(setting_.points.points.label, stream()); }
  [[nodiscard]] std::uint64_t waitingUpdates() const { return age_.updates(); }
  /// Time spent evaluating since the last call.
  [[nodiscard]] double takeScore_ms();
  /// Bytes not taken from `memory`.
  [[nodiscard]] std::uint64_t mappedBytes() const { return known_.mappedBytes() + masks_.mappedBytes(); }

 private:
  [[nodiscard]] cudaStream_t stream() const { return context_->stream(); }
  [[nodiscard]] DueContext dueContext() const { return {setting_.points, evaluation_, masks_.masks(), due_.view()}; }
  std::uint32_t takeRoom(std::uint32_t wanted, std::uint32_t at_least);

  std::shared_ptr<DeviceContext> context_;
  DeviceCounters& counters_;
  OwnedEvent fork_{cudaEventDisableTiming}, join_{cudaEventDisableTiming};  ///< for the search
  OwnedEvent followed_{cudaEventDisableTiming};
  FootprintTable footprint_;
  KnownTables known_;
  GroupMaskTable masks_;
  DueLists due_;
  WorkQueue queue_;
  QueueAge age_;
  bool waits_ = false;  ///< this update has a budget, or the one before left points
  // For the update in progress.
  std::optional<FlipsView> flips_;
  Setting setting_;
  EvaluationView evaluation_;
  DueSearch search_;
  std::uint32_t items_ = 0;  ///< upper bound of the items listed
  double score_ms_ = 0;
};

}  // namespace accessvdb::kernels

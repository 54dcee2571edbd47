// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Tells all tools' schedulers of what happens, and runs them one after the other.
#pragma once

#include <functional>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "points/point_store.h"
#include "update/scheduler.h"
#include "update/update_stats_sum.h"

namespace accessvdb::internal {

class SchedulerOfTools final : public UpdateScheduler {
 public:
  /// Of one tool, or on a device of all that read the same points.
  struct Part {
    std::unique_ptr<UpdateScheduler> scheduler;
    std::size_t views_of;      ///< the part that is told first of the points it reads
    PointStore* adds_returns;  ///< as in ScheduledTool
    const TouchedPoints* touched = nullptr;
  };
  explicit SchedulerOfTools(std::vector<Part> parts) : parts_(std::move(parts)) {}

  [[nodiscard]] Needs needs() const override {
    Needs all;
    for (const Part& part : parts_) {
      const Needs needs = part.scheduler->needs();
      all.deltas = all.deltas || needs.deltas;
      all.changes = all.changes || needs.changes;
      all.distances = all.distances || needs.distances;
    }
    return all;
  }

  void noteReturns(const TouchedPoints& touched, std::span<const Eigen::Vector3f> p_L,
                   std::span<const Eigen::Vector3f> q_L) override {
    for (Part& part : parts_) {
      if (part.adds_returns != nullptr) {
        part.adds_returns->describeTouched(part.scheduler->needs().deltas);
        part.touched = &part.adds_returns->addReturns(p_L, q_L);
      } else {
        part.touched = part.views_of == 0 ? &touched : parts_[part.views_of].touched;
      }
      part.scheduler->noteReturns(*part.touched, p_L, q_L);
    }
  }
  void noteChange(std::size_t number, const LeafChange& change) override {
    for (const Part& part : parts_) part.scheduler->noteChange(number, change);
  }
  void noteChanges(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                   const MapChanges& changes) override {
    for (const Part& part : parts_) part.scheduler->noteChanges(p_L, q_L, changes);
  }
  void noteChangesAlone(std::span<const std::span<const LeafChange>> facts) override {
    for (const Part& part : parts_) part.scheduler->noteChangesAlone(facts);
  }
  void noteRestored() override {
    for (const Part& part : parts_) part.scheduler->noteRestored();
  }

  bool noteScored() override {
    bool all = true;
    for (const Part& part : parts_) all = part.scheduler->noteScored() && all;
    return all;
  }

  void prepare(const kernels::OccupancyGrid* mirror) override {
    for (const Part& part : parts_) part.scheduler->prepare(mirror);
  }

  UpdateStats update(const kernels::OccupancyGrid* mirror, int budget_points) override {
    UpdateStats all;
    for (const Part& part : parts_) {
      const bool last = &part == &parts_.back();
      part.scheduler->whenMapIsReleased(last ? std::function<void()>([this] { releaseMap(); }) : nullptr);
      add(part.scheduler->update(mirror, budget_points), all);
    }
    return all;
  }

  [[nodiscard]] std::uint64_t bytes() const override {
    std::uint64_t bytes = 0;
    for (const Part& part : parts_) bytes += part.scheduler->bytes();
    return bytes;
  }
  [[nodiscard]] std::uint64_t deviceBytes() const override {
    std::uint64_t bytes = 0;
    for (const Part& part : parts_) bytes += part.scheduler->deviceBytes();
    return bytes;
  }

 private:
  std::vector<Part> parts_;
};

}  // namespace accessvdb::internal

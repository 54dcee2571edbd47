// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What exact schedulers on the host share: what a scan changed, possibly with those of other tools, and which blocks
/// of a leaf group that may concern.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "update/flip_columns.h"
#include "update/leaf_footprint.h"
#include "update/scan_changes.h"
#include "update/scheduled_tool.h"
#include "update/scheduler.h"

namespace accessvdb::internal {

class HostScheduler : public UpdateScheduler {
 public:
  /// @param changes  of the points and the map, possibly shared with the schedulers of other tools
  HostScheduler(const ScheduledTool& tool, std::shared_ptr<ScanChanges> changes);

  void noteReturns(const TouchedPoints& touched, std::span<const Eigen::Vector3f> p_L,
                   std::span<const Eigen::Vector3f> q_L) override;
  void noteChanges(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                   const MapChanges& changes) override;
  bool noteScored() override;

 protected:
  /// Of several schedulers that share changes, one is told of them.
  [[nodiscard]] bool leads() const { return &changes_->scorer() == &scorer_; }
  /// Brings points and neighbourhoods up to date: finds them, or takes over what the leading scheduler found.
  void takeChanges();

  /// Blocks of a leaf group with points that were scored or changed, and what flipped around them. Scratch memory of a
  /// thread.
  struct LeafGroupBlocks {
    FlipColumns flips;
    std::vector<std::uint32_t> blocks;
    bool flipped = false;  ///< anything did
  };
  /// @return false if nothing changed in the leaf group or around it
  [[nodiscard]] bool findBlocks(std::uint32_t leaf_group, LeafGroupBlocks& found) const;

  PointScorer& scorer_;
  MakeTables tables_;
  LeafFootprint footprint_;
  std::shared_ptr<ScanChanges> changes_;
};

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which directions the paper tries at a point (hostdev/paper_rule.h), with the points on the host.
#pragma once

#include "hostdev/paper_rule.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

/// The rule for a field.
kernels::CoarseToFine coarseToFineRule(const FieldParams& resolved);

class CandidateDirections {
 public:
  /// @param collision_limit  [n_c] a point is resolved when its best score is below
  CandidateDirections(const PointScorer& scorer, std::uint16_t collision_limit);

  /// To be called before a batch: whether any point is resolved, without which nobody need be searched for.
  void beginBatch();

  /// Directions to try at a point: all of them unless ApproachParams::coarse_to_fine. Reads the stored best directions,
  /// so within one batch no point sees what the others of the batch are about to find.
  [[nodiscard]] DirectionMask candidates(std::uint32_t id) const;

 private:
  [[nodiscard]] bool resolved(std::uint32_t id) const;
  /// Best direction of the nearest other resolved point within 0.3 m, ties by lower id; kNoDirection without one.
  [[nodiscard]] std::uint16_t directionOfNearestResolved(std::uint32_t id) const;

  const PointScorer& scorer_;
  kernels::CoarseToFine rule_;
  std::uint16_t collision_limit_;
  bool any_resolved_ = false;
};

}  // namespace accessvdb::internal

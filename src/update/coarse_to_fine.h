// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which directions the paper tries at a point (hostdev/paper_rule.h), for points kept on the host.
#pragma once

#include "hostdev/paper_rule.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

/// The rule for a field.
kernels::CoarseToFine coarseToFineRule(const FieldParams& resolved);

class CandidateDirections {
 public:
  /// @param collision_limit  [n_c] a point is resolved if its best score is below this
  CandidateDirections(const PointScorer& scorer, std::uint16_t collision_limit);

  /// Call before each batch: checks whether any point is resolved; if none is, candidates() searches for none.
  void beginBatch();

  /// Directions to try at a point: all of them unless ApproachParams::coarse_to_fine. Reads the stored best directions,
  /// so the points of a batch do not see each other's results.
  [[nodiscard]] DirectionMask candidates(std::uint32_t id) const;

 private:
  [[nodiscard]] bool resolved(std::uint32_t id) const;
  /// Best direction of the nearest other resolved point within 0.3 m, ties by lower id; kNoDirection if there is none.
  [[nodiscard]] std::uint16_t directionOfNearestResolved(std::uint32_t id) const;

  const PointScorer& scorer_;
  kernels::CoarseToFine rule_;
  std::uint16_t collision_limit_;
  bool any_resolved_ = false;
};

}  // namespace accessvdb::internal

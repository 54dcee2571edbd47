// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The paper's policy run entirely by a backend: its queue, neighbourhoods and scores, all in arrays that stay on the
/// device (docs/design/gpu.md, "The two backends").
#pragma once

#include <cstdint>
#include <span>

#include "hostdev/paper_rule.h"
#include "launch/point_delta.h"

namespace accessvdb::kernels {

/// Constant tables.
struct PaperTables {
  NeighbourTables neighbours;
  CoarseToFine candidates;
};

/// Points that the triggers request, ids ascending, including points that are not confident; host memory, reusable on
/// return.
struct TriggeredPoints {
  std::span<const std::uint32_t> jumped;   ///< trigger (i), a jump of the distance
  std::span<const std::uint32_t> sampled;  ///< trigger (ii), a sample of all points
  bool all_blocked = false;                ///< every point that is not accessible
};

/// An update is any number of admit(), then update(). Neighbours are those at the time a point is evaluated.
class PaperUpdater : public PointAdmission {
 public:
  virtual UpdateOutcome update(const ScoringInput& input, const ConfidenceDelta& confidence,
                               const TriggeredPoints& triggered) = 0;
};

}  // namespace accessvdb::kernels

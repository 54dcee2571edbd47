// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The paper's policy as a backend runs it by itself: its queue, neighbourhoods and scores, all on arrays that stay on
/// the device (docs/DESIGN.md, "The two backends").
#pragma once

#include <cstdint>
#include <span>

#include "hostdev/paper_rule.h"
#include "launch/point_news.h"

namespace accessvdb::kernels {

/// What never changes.
struct PaperTables {
  NeighbourTables neighbours;
  CoarseToFine candidates;
};

/// Points that the triggers ask for, ids ascending; host memory, free again on return. Points that are not confident
/// may be among them.
struct TriggeredPoints {
  std::span<const std::uint32_t> jumped;   ///< trigger (i), a jump of the distance
  std::span<const std::uint32_t> sampled;  ///< trigger (ii), a sample of all points
  bool all_blocked = false;                ///< every point that is not accessible
};

/// An update is any number of admit(), then update(). Neighbours are those of the moment at which a point is evaluated.
class PaperUpdater : public PointAdmission {
 public:
  virtual UpdateOutcome update(const ScoringInput& input, const ConfidenceNews& news,
                               const TriggeredPoints& triggered) = 0;
};

}  // namespace accessvdb::kernels

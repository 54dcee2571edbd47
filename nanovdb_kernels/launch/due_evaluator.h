// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a backend evaluates under the exact policy if the host decides what is due (src/update/exact_on_host.cpp).
#pragma once

#include <cstddef>

#include "hostdev/due_evaluation.h"

namespace accessvdb::kernels {

class PreparedTool;

/// Constants of an update.
struct DueUpdate {
  OccupancyView map;
  ToolKernelView tool;    ///< in the backend's memory
  ApproachView approach;  ///< in the backend's memory
  PointStateView points;  ///< in the backend's memory
  UpdateRule rule;
  KnownScale scale;
  const PreparedTool* prepared = nullptr;  ///< as in ScoreRequest
};

/// One point. Its memory of directions is written.
struct DueItem {
  std::uint32_t id = 0;
  Due due;
  KnownPoint known;
};

/// Evaluates points by hostdev/due_evaluation.h. Not valid beyond the update.
class DueEvaluator {
 public:
  virtual ~DueEvaluator() = default;
  /// From any thread, also at the same time for other points. Fastest if the points of a block follow each other.
  /// @param items, outcomes  [count] ids differ
  virtual void evaluate(const DueItem* items, DueOutcome* outcomes, std::size_t count) = 0;
};

}  // namespace accessvdb::kernels

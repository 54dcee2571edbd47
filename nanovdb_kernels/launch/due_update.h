// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the host hands to a DueEvaluator.
#pragma once

#include "hostdev/due_evaluation.h"
#include "launch/due_evaluator.h"

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
struct DueTask {
  std::uint32_t id = 0;
  Due due;
  KnownPoint known;
};

}  // namespace accessvdb::kernels

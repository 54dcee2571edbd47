// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a backend evaluates under the exact policy if the host decides what is due (src/update/exact_on_host.cpp).
#pragma once

#include <cstddef>

#include "hostdev/due_evaluation.h"

namespace accessvdb::kernels {

class PreparedTool;

/// One point. Its memory of directions is written.
struct DueItem {
  std::uint32_t id = 0;
  Due due;
  KnownPoint known;
};

/// Evaluates `count` items by hostdev/due_evaluation.h.
struct DueRequest {
  OccupancyView map;
  ToolKernelView tool;    ///< in the backend's memory
  ApproachView approach;  ///< in the backend's memory
  PointStateView points;  ///< in the backend's memory
  UpdateRule rule;
  KnownScale scale;
  const PreparedTool* prepared = nullptr;  ///< as in ScoreRequest
  const DueItem* items = nullptr;          ///< [count] host memory; ids differ
  DueOutcome* outcomes = nullptr;          ///< [count] host memory
  std::size_t count = 0;
};

}  // namespace accessvdb::kernels

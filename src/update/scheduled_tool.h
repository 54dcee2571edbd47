// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A tool as schedulers see it.
#pragma once

#include <cstddef>
#include <functional>

#include "hostdev/views.h"
#include "points/point_store.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

/// The tool and the corridor in host memory; the memory they point to must outlive the scheduler.
struct HostTables {
  kernels::ToolKernelView tool;
  kernels::ApproachView approach;
};

/// Makes a tool's tables for an update. @param mirror  in the backend's memory
using MakeTables = std::function<ScoringTables(const kernels::OccupancyGrid* mirror)>;

/// A tool that is scored: its state of the points, and its tables. What these refer to must outlive the scheduler.
struct ScheduledTool {
  PointScorer& scorer;
  HostTables host;
  MakeTables tables;
  std::size_t views_of = 0;            ///< number of the tool whose points it reads: its own, or a lower one
  PointStore* adds_returns = nullptr;  ///< to which the scheduler adds the returns of scans; null: others do so
};

}  // namespace accessvdb::internal

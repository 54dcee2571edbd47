// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The schedulers, and which one a field gets.
#pragma once

#include <functional>
#include <memory>
#include <span>

#include "hostdev/views.h"
#include "update/scheduler.h"

namespace accessvdb::internal {

class ScanChanges;

/// The tool and the corridor in host memory; the memory they point to must outlive the scheduler.
struct HostTables {
  kernels::ToolKernelView tool;
  kernels::ApproachView approach;
};

/// The scheduler for the policy of scorer.params(): on the backend if it supports that, otherwise on the host.
std::unique_ptr<UpdateScheduler> makeScheduler(PointScorer& scorer, const HostTables& tables);

/// docs/DESIGN.md, "Exact updates": labels equal those of a full evaluation of the current map.
/// @param changes  shared by the schedulers of tools that are tried in the same directions; null: none. Of those, the
///                 one of changes->scorer() has to be told of scans and updated before the others
std::unique_ptr<UpdateScheduler> makeExactOnHost(PointScorer& scorer, const HostTables& tables,
                                                 std::shared_ptr<ScanChanges> changes = nullptr);
/// The same for a wide set of directions (hostdev/wide_search.h).
std::unique_ptr<UpdateScheduler> makeWideOnHost(PointScorer& scorer, const HostTables& tables,
                                                std::shared_ptr<ScanChanges> changes);
/// A tool beside the first of a scheduler on a device, tried in the same directions.
struct FurtherTool {
  PointScorer& scorer;  ///< of the first one's points, new
  HostTables host;
  std::function<ScoringTables(const kernels::OccupancyGrid* mirror)> tables;  ///< as for update()
};
/// The same on a backend that decides itself what is due and keeps all state; null if this backend cannot.
/// @param further  scored with the first one: points, normals, views and what changed are kept once for all of them
std::unique_ptr<UpdateScheduler> makeExactOnDevice(PointScorer& scorer, const HostTables& tables,
                                                   std::span<const FurtherTool> further = {});

/// The paper's triggers (i) to (iii), sample, budget and backlog (docs/PAPER_MAP.md, "Update policy").
/// @param collision_limit  [n_c]
std::unique_ptr<UpdateScheduler> makePaperOnHost(PointScorer& scorer, std::uint16_t collision_limit);
/// The same on a backend that keeps queue and state; null if this backend cannot. Scores the same points at the same
/// updates.
std::unique_ptr<UpdateScheduler> makePaperOnDevice(PointScorer& scorer);

}  // namespace accessvdb::internal

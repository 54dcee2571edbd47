// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The schedulers, and which one a field gets.
#pragma once

#include <memory>
#include <span>

#include "update/scheduled_tool.h"
#include "update/scheduler.h"

namespace accessvdb::internal {

class ScanChanges;

/// The scheduler of all tools of a field, for the policy of their parameters: on the backend if it supports that,
/// otherwise on the host. @param tools  at least one; one alone for the paper's policy
std::unique_ptr<UpdateScheduler> makeScheduler(std::span<const ScheduledTool> tools);

/// docs/DESIGN.md, "Exact updates": labels equal those of a full evaluation of the current map.
/// @param changes  shared by the schedulers of tools that are tried in the same directions; null: none. Of those, the
///                 one of changes->scorer() has to be told of scans and updated before the others
std::unique_ptr<UpdateScheduler> makeExactOnHost(const ScheduledTool& tool,
                                                 std::shared_ptr<ScanChanges> changes = nullptr);
/// The same for a wide set of directions (hostdev/wide_search.h).
std::unique_ptr<UpdateScheduler> makeWideOnHost(const ScheduledTool& tool, std::shared_ptr<ScanChanges> changes);
/// The same on a backend that decides itself what is due and keeps all state; null if this backend cannot.
/// @param tools  tried in the same directions: points, normals, views and what changed are kept once for all of them.
///               From then on all scorers share the first one's device
std::unique_ptr<UpdateScheduler> makeExactOnDevice(std::span<const ScheduledTool> tools);

/// The paper's triggers (i) to (iii), sample, budget and backlog (docs/PAPER_MAP.md, "Update policy").
std::unique_ptr<UpdateScheduler> makePaperOnHost(const ScheduledTool& tool);
/// The same on a backend that keeps queue and state; null if this backend cannot. Scores the same points at the same
/// updates.
std::unique_ptr<UpdateScheduler> makePaperOnDevice(const ScheduledTool& tool);

}  // namespace accessvdb::internal

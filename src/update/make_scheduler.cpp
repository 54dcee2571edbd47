// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/make_scheduler.h"

#include <utility>
#include <vector>

#include "update/scan_changes.h"
#include "update/scheduler_of_tools.h"

namespace accessvdb::internal {
namespace {

/// For tools that are tried in the same directions: one scheduler on a device, or one each on the host.
/// @param store  number of the first of them
void addExact(std::span<const ScheduledTool> tools, std::size_t store, std::vector<SchedulerOfTools::Part>& parts) {
  PointStore* const adds_returns = tools.front().adds_returns;
  if (auto on_device = makeExactOnDevice(tools)) {
    parts.push_back({std::move(on_device), store, adds_returns});
    return;
  }
  const auto changes = std::make_shared<ScanChanges>(tools.front().scorer);
  for (const ScheduledTool& tool : tools) {
    const bool first = &tool == &tools.front();
    parts.push_back({makeExactOnHost(tool, changes), store, first ? adds_returns : nullptr});
  }
}

}  // namespace

std::unique_ptr<UpdateScheduler> makeScheduler(std::span<const ScheduledTool> tools) {
  if (tools.front().scorer.params().update.policy == UpdatePolicy::Paper) {
    auto on_device = makePaperOnDevice(tools.front());
    return on_device != nullptr ? std::move(on_device) : makePaperOnHost(tools.front());
  }
  std::vector<SchedulerOfTools::Part> parts;
  for (std::size_t first = 0; first < tools.size(); ++first) {
    if (tools[first].views_of != first) continue;  // it reads the points of an earlier tool
    std::vector<ScheduledTool> together;
    for (const ScheduledTool& tool : tools) {
      if (tool.views_of == first) together.push_back(tool);
    }
    addExact(together, parts.size(), parts);
  }
  if (parts.size() == 1) return std::move(parts.front().scheduler);
  return std::make_unique<SchedulerOfTools>(std::move(parts));
}

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/make_scheduler.h"

namespace accessvdb::internal {

std::unique_ptr<UpdateScheduler> makeScheduler(PointScorer& scorer, const HostTables& tables) {
  const bool paper = scorer.params().update.policy == UpdatePolicy::Paper;
  auto on_device = paper ? makePaperOnDevice(scorer) : makeExactOnDevice(scorer, tables);
  if (on_device != nullptr) return on_device;
  return paper ? makePaperOnHost(scorer, tables.tool.collision_limit) : makeExactOnHost(scorer, tables);
}

}  // namespace accessvdb::internal

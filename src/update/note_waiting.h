// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The end of an update by a scheduler on the host: what it left waiting.
#pragma once

#include <algorithm>
#include <cstdint>

#include "accessvdb/types.h"
#include "update/backlog.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

inline void noteWaiting(const Backlog& backlog, PointScorer& scorer, UpdateStats& stats) {
  stats.backlog = backlog.size();
  stats.backlog_updates = backlog.updates();
  stats.withheld_points = static_cast<std::uint64_t>(std::ranges::count_if(
      backlog.ids(), [&](std::uint32_t id) { return scorer.record(id).label == PointLabel::Accessible; }));
  scorer.setWaiting(backlog.ids());
}

}  // namespace accessvdb::internal

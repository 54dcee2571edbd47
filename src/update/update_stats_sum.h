// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What updates of parts of a field, or of tiles of a map, did together.
#pragma once

#include <algorithm>

#include "accessvdb/types.h"

namespace accessvdb::internal {

inline void add(const UpdateStats& part, UpdateStats& all) {
  all.dirty_points += part.dirty_points;
  all.scored_points += part.scored_points;
  all.direction_tests += part.direction_tests;
  all.backlog += part.backlog;
  all.backlog_updates = std::max(all.backlog_updates, part.backlog_updates);
  all.withheld_points += part.withheld_points;
  all.label_changes += part.label_changes;
  all.update_ms += part.update_ms;
  all.score_ms += part.score_ms;
  all.moved_points += part.moved_points;
}

}  // namespace accessvdb::internal

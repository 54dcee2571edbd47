// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where a call writes what an update did.
#pragma once

#include "accessvdb/c_api.h"
#include "accessvdb/types.h"
#include "capi/boundary.h"

namespace accessvdb::capi {

class UpdateStatsOut {
 public:
  /// Checks the caller's struct before anything happens. @param stats  may be null
  explicit UpdateStatsOut(accessvdb_update_stats* stats) : out_("stats", stats) {}

  void write(const UpdateStats& stats) const {
    accessvdb_update_stats c = {};
    c.dirty_points = stats.dirty_points;
    c.scored_points = stats.scored_points;
    c.direction_tests = stats.direction_tests;
    c.backlog = stats.backlog;
    c.label_changes = stats.label_changes;
    c.update_ms = stats.update_ms;
    c.score_ms = stats.score_ms;
    out_.write(c);
  }

 private:
  OptionalOut<accessvdb_update_stats, 64> out_;
};

}  // namespace accessvdb::capi

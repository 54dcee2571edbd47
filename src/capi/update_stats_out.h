// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where a call writes what an update did.
#pragma once

#include <cstddef>

#include "accessvdb/c_api.h"
#include "accessvdb/types.h"
#include "capi/boundary.h"

namespace accessvdb::capi {

class UpdateStatsOut {
 public:
  /// Checks the caller's struct before anything happens. @param stats  may be null
  explicit UpdateStatsOut(accessvdb_update_stats* stats)
      : out_(stats), size_(stats == nullptr ? 0 : checkedSize("stats", stats, kBytes1)) {}

  void write(const UpdateStats& stats) const {
    if (out_ == nullptr) return;
    accessvdb_update_stats c = {};
    c.dirty_points = stats.dirty_points;
    c.scored_points = stats.scored_points;
    c.direction_tests = stats.direction_tests;
    c.backlog = stats.backlog;
    c.label_changes = stats.label_changes;
    c.update_ms = stats.update_ms;
    c.score_ms = stats.score_ms;
    writeSized(out_, size_, c);
  }

 private:
  static constexpr std::size_t kBytes1 = 64;  ///< size of the first version
  static_assert(sizeof(accessvdb_update_stats) >= kBytes1);

  accessvdb_update_stats* out_;
  std::size_t size_;
};

}  // namespace accessvdb::capi

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where a call writes what a scan did.
#pragma once

#include <algorithm>

#include "accessvdb/c_api.h"
#include "accessvdb/types.h"
#include "capi/boundary.h"

namespace accessvdb::capi {

class FrameStatsOut {
 public:
  /// Checks the caller's struct before anything happens. @param stats  may be null
  explicit FrameStatsOut(accessvdb_frame_stats* stats) : out_("stats", stats) {}

  void write(const FrameStats& stats) const {
    accessvdb_frame_stats c = {};
    c.points_in = stats.points_in;
    c.points_used = stats.points_used;
    std::copy(stats.dropped.begin(), stats.dropped.end(), c.dropped);
    c.touched_leaves = stats.touched_leaves;
    c.new_leaves = stats.new_leaves;
    c.distance_updates = stats.distance_updates;
    c.cleared_updates = stats.cleared_updates;
    c.integrate_ms = stats.integrate_ms;
    c.mirror_ms = stats.mirror_ms;
    out_.write(c);
  }

 private:
  OptionalOut<accessvdb_frame_stats, 112> out_;
};

}  // namespace accessvdb::capi

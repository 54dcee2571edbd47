// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where a call writes what a scan did.
#pragma once

#include <algorithm>
#include <cstddef>

#include "accessvdb/c_api.h"
#include "accessvdb/types.h"
#include "capi/boundary.h"

namespace accessvdb::capi {

class FrameStatsOut {
 public:
  /// Checks the caller's struct before anything happens. @param stats  may be null
  explicit FrameStatsOut(accessvdb_frame_stats* stats)
      : out_(stats), size_(stats == nullptr ? 0 : checkedSize("stats", stats, kBytes1)) {}

  void write(const FrameStats& stats) const {
    if (out_ == nullptr) return;
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
    writeSized(out_, size_, c);
  }

 private:
  static constexpr std::size_t kBytes1 = 112;  ///< size of the first version
  static_assert(sizeof(accessvdb_frame_stats) >= kBytes1);

  accessvdb_frame_stats* out_;
  std::size_t size_;
};

}  // namespace accessvdb::capi

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Whether the motion within scans can be removed, and the words in which the matching rule says so.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/scan_io.h"
#include "io/clouds/point_times.h"
#include "io/poses/pose_gap.h"

namespace accessvdb::io {

/// What is known of some of the scans before any is used.
struct TimedScans {
  std::string subject = {};             ///< for messages
  bool posed_by_time = true;            ///< else nothing says where the sensor was between scans
  bool registered = false;              ///< without motion already: only the rays' origins depend on times
  std::string field = {};               ///< with the times; empty without
  std::vector<TimeSpan> samples = {};   ///< of scans with returns
  std::optional<TimeScale> scale = {};  ///< where the format says it
  std::size_t scans = 0;                ///< all that are used; 0: nobody knows yet
  double max_gap_s = kMaxPoseGap_s;     ///< for messages
  /// How many scans have poses at both ends of this range.
  std::function<std::size_t(const OffsetRange&)> covered = {};
};

/// Samples of at most so many scans tell the unit.
inline constexpr std::size_t kTimedSamples = 32;

struct DeskewChoice {
  std::optional<TimeScale> scale = {};  ///< nothing: scans are used as they are
  OffsetRange usual = {};               ///< no scan that is timed as most are has times outside
  std::string words = {};               ///< for the end of the matching rule
};

/// @throws UnusableInput "deskew.no_times", "deskew.clock", "deskew.poses" where motion has to be removed and cannot
[[nodiscard]] DeskewChoice chooseDeskew(Deskew wanted, const TimedScans& timed);

}  // namespace accessvdb::io

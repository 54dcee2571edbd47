// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the times of the points of live scans mean. A recording is looked at before its first scan is used; here the
/// latest scans decide together, by the same rule (io/scans/deskew_choice.h).
#pragma once

#include <deque>
#include <optional>
#include <string>

#include "accessvdb/live_session.h"
#include "io/clouds/point_times.h"

namespace accessvdb::internal {

/// How the points of one scan are timed.
struct TimedPoints {
  io::TimeScale scale;
  io::OffsetRange usual;  ///< of scans that are timed right
  io::OffsetRange range;  ///< of this one
};

class ScanTimes {
 public:
  ScanTimes(io::Deskew wanted, double max_gap_s) : wanted_(wanted), max_gap_s_(max_gap_s) {}

  enum class Use { ByTimes, AsIs, None };
  struct Verdict {
    Use use = Use::AsIs;
    std::optional<TimedPoints> timed = {};  ///< of ByTimes
  };
  /// @param scan  with as many times as returns, or none @param registered  without motion already
  [[nodiscard]] Verdict next(const LiveScan& scan, bool registered);
  /// What is done about motion within scans, and why.
  [[nodiscard]] const std::string& words() const { return words_; }

 private:
  io::Deskew wanted_;
  double max_gap_s_;
  std::deque<io::TimeSpan> latest_;
  bool chosen_ = false;  ///< scans were placed by their times before
  std::string words_;
};

}  // namespace accessvdb::internal

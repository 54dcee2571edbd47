// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "live/scan_times.h"

#include <algorithm>

#include "io/poses/pose_track.h"
#include "io/scans/deskew_choice.h"

namespace accessvdb::internal {
namespace {

std::optional<io::TimeSpan> spanOf(const LiveScan& scan) {
  const double stamp_s = io::seconds(scan.stamp_ns);
  return scan.points.empty() ? io::timeSpanOf(scan.points_double, scan.times, stamp_s)
                             : io::timeSpanOf(scan.points, scan.times, stamp_s);
}

bool hasReturn(const LiveScan& scan) {
  return std::any_of(scan.points.begin(), scan.points.end(), io::isReturn<Eigen::Vector3f>) ||
         std::any_of(scan.points_double.begin(), scan.points_double.end(), io::isReturn<Eigen::Vector3d>);
}

}  // namespace

ScanTimes::Verdict ScanTimes::next(const LiveScan& scan, bool registered) {
  const bool insist = wanted_ == io::Deskew::On && !registered;
  io::TimedScans timed;
  timed.registered = registered;
  timed.max_gap_s = max_gap_s_;
  timed.covered = [](const io::OffsetRange&) { return std::size_t{1}; };  // seen when the scan has its turn
  const auto span = wanted_ == io::Deskew::Off || scan.times.empty() ? std::nullopt : spanOf(scan);
  if (span) {
    latest_.push_back(*span);
    if (latest_.size() > io::kTimedSamples) latest_.pop_front();
    timed.field = "times";
    timed.samples.assign(latest_.begin(), latest_.end());
    if (scan.time_unit_s > 0) timed.scale = io::TimeScale{scan.time_unit_s, false};
  }
  // Deskew::On refuses a recording; here it refuses a scan.
  const io::Deskew asked = wanted_ == io::Deskew::On ? io::Deskew::Auto : wanted_;
  const io::DeskewChoice choice = io::chooseDeskew(asked, timed);
  const bool has_returns = !scan.points.empty() || !scan.points_double.empty();
  if (span || (!chosen_ && has_returns)) words_ = choice.words.substr(std::min<std::size_t>(2, choice.words.size()));
  if (!choice.scale) {
    // Among scans that are placed by their times, one whose times cannot be told is not used as if it had none.
    const bool timeless = !span && wanted_ != io::Deskew::Off && !scan.times.empty() && hasReturn(scan);  // NaN, inf
    const bool contradicts = chosen_ && (span || timeless);
    return {contradicts || (insist && has_returns) ? Use::None : Use::AsIs, {}};
  }
  chosen_ = true;
  const io::TimeSpan alone[] = {*span};
  return {Use::ByTimes, TimedPoints{*choice.scale, choice.usual, io::offsetRange(alone, *choice.scale)}};
}

}  // namespace accessvdb::internal

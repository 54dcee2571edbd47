// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the times of the points within a scan mean: drivers agree neither on the unit nor on where time begins.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace accessvdb::io {

/// Times of the returns of one scan, in the scan's own unit.
struct TimeSpan {
  double stamp_s = 0;  ///< of the scan, on the scan's clock
  double first = 0, last = 0;
};

struct TimeScale {
  double unit_s = 1;
  bool absolute = false;  ///< else since the scan's stamp

  /// @param stamp_s  as TimeSpan::stamp_s
  [[nodiscard]] double offset_s(double time, double stamp_s) const {
    return absolute ? time * unit_s - stamp_s : time * unit_s;
  }
  /// "ns since the scan's stamp"
  [[nodiscard]] std::string inWords() const;
};

/// No scan takes longer, nor begins or ends this far from its stamp.
inline constexpr double kLongestScan_s = 2;

/// Whether a point is a return: neither "no return" (0,0,0) nor damaged. Only their times are looked at.
template <typename Point>
[[nodiscard]] bool isReturn(const Point& p) {
  return p.allFinite() && !p.isZero(0);
}

/// @param times  [points] @return nothing without a return that has a finite time
template <typename Point>
[[nodiscard]] std::optional<TimeSpan> timeSpanOf(const std::vector<Point>& points, const std::vector<double>& times,
                                                 double stamp_s) {
  std::optional<TimeSpan> span;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double time = times[i];
    if (!(time - time == 0) || !isReturn(points[i])) continue;
    if (!span) span = TimeSpan{stamp_s, time, time};
    if (time < span->first) span->first = time;
    if (time > span->last) span->last = time;
  }
  return span;
}

/// The unit is seconds, milli-, micro- or nanoseconds, whichever makes most of the scans take 2 ms to 2 s. Times near
/// zero count from the scan's stamp, times near the stamp are absolute. Scans whose times do not fit are those of few.
/// @return nothing where times do not differ within a scan, or are on another clock
[[nodiscard]] std::optional<TimeScale> timeScaleOf(std::span<const TimeSpan> scans);

/// The unit of a time that is a date, by its size: 1.7e18 is in nanoseconds, 1.7e15 in microseconds, 1.7e12 in
/// milliseconds, since 1970 or since 1980. All else, such as seconds of a week, is in seconds.
[[nodiscard]] double unitOfDate_s(double time);
/// "ns"
[[nodiscard]] const char* timeUnitName(double unit_s);
/// "nanoseconds"
[[nodiscard]] std::string inWords(double unit_s);

/// Offsets from the stamps of those of these scans that fit: the earliest and the latest.
struct OffsetRange {
  double first_s = 0, last_s = 0;
};
[[nodiscard]] OffsetRange offsetRange(std::span<const TimeSpan> scans, const TimeScale& scale);

}  // namespace accessvdb::io

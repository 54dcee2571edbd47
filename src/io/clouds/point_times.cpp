// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/clouds/point_times.h"

#include <algorithm>
#include <cmath>

namespace accessvdb::io {
namespace {

struct Unit {
  double seconds;
  const char* name;
};
constexpr Unit kUnits[] = {{1, "s"}, {1e-3, "ms"}, {1e-6, "us"}, {1e-9, "ns"}};

/// Each unit covers three digits, so there is one for each span.
std::optional<double> unitOf(double longest) {
  if (!(longest > 0)) return std::nullopt;
  for (const Unit& unit : kUnits)
    if (longest * unit.seconds <= kLongestScan_s) return unit.seconds;
  return std::nullopt;
}

}  // namespace

std::string TimeScale::inWords() const {
  const Unit* const unit =
      std::find_if(std::begin(kUnits), std::end(kUnits), [this](const Unit& one) { return one.seconds == unit_s; });
  return std::string(unit->name) + (absolute ? ", absolute" : " since the scan's stamp");
}

std::optional<TimeScale> timeScaleOf(std::span<const TimeSpan> scans) {
  double longest = 0;
  for (const TimeSpan& scan : scans) longest = std::max(longest, scan.last - scan.first);
  const auto unit_s = unitOf(longest);
  if (!unit_s) return std::nullopt;
  for (const bool absolute : {false, true}) {
    const TimeScale scale = {*unit_s, absolute};
    const auto fits = [&](const TimeSpan& scan) {
      return std::abs(scale.offset_s(scan.first, scan.stamp_s)) <= kLongestScan_s &&
             std::abs(scale.offset_s(scan.last, scan.stamp_s)) <= kLongestScan_s;
    };
    if (std::all_of(scans.begin(), scans.end(), fits)) return scale;
  }
  return std::nullopt;
}

double unitOfDate_s(double time) {
  constexpr double kFirst_s = 0.9e9, kLast_s = 4e9;  // 2008 by GPS, 2096 by Unix
  for (const double unit_s : {1e-9, 1e-6, 1e-3})
    if (time * unit_s >= kFirst_s && time * unit_s <= kLast_s) return unit_s;
  // Adjusted standard GPS time is 1e9 s less: from 1.5e8 s on.
  return time * 1e-9 >= 1e8 ? 1e-9 : 1;
}

std::string inWords(double unit_s) {
  return unit_s == 1e-9 ? "nanoseconds" : unit_s == 1e-6 ? "microseconds" : unit_s == 1e-3 ? "milliseconds" : "seconds";
}

OffsetRange offsetRange(std::span<const TimeSpan> scans, const TimeScale& scale) {
  OffsetRange range;
  bool first = true;
  for (const TimeSpan& scan : scans) {
    const double begin_s = scale.offset_s(scan.first, scan.stamp_s), end_s = scale.offset_s(scan.last, scan.stamp_s);
    range.first_s = first ? begin_s : std::min(range.first_s, begin_s);
    range.last_s = first ? end_s : std::max(range.last_s, end_s);
    first = false;
  }
  return range;
}

}  // namespace accessvdb::io

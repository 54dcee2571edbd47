// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/clouds/point_times.h"

#include <algorithm>
#include <cmath>
#include <map>

namespace accessvdb::io {
namespace {

struct Unit {
  double seconds;
  const char *name, *words;
};
constexpr Unit kUnits[] = {
    {1, "s", "seconds"}, {1e-3, "ms", "milliseconds"}, {1e-6, "us", "microseconds"}, {1e-9, "ns", "nanoseconds"}};

/// @param seconds  of one of them
const Unit& unitOfSeconds(double seconds) {
  return *std::find_if(std::begin(kUnits), std::end(kUnits), [&](const Unit& one) { return one.seconds == seconds; });
}

/// Each unit covers three digits, so there is one for each span.
std::optional<double> unitOf(double longest) {
  if (!(longest > 0)) return std::nullopt;
  for (const Unit& unit : kUnits)
    if (longest * unit.seconds <= kLongestScan_s) return unit.seconds;
  return std::nullopt;
}

/// Whether these can be the times of a scan.
bool fits(const TimeSpan& scan, const TimeScale& scale) {
  return std::abs(scale.offset_s(scan.first, scan.stamp_s)) <= kLongestScan_s &&
         std::abs(scale.offset_s(scan.last, scan.stamp_s)) <= kLongestScan_s;
}

}  // namespace

std::string TimeScale::inWords() const {
  return std::string(timeUnitName(unit_s)) + (absolute ? ", absolute" : " since the scan's stamp");
}

std::optional<TimeScale> timeScaleOf(std::span<const TimeSpan> scans) {
  // Each scan has a say, so that one with wrong times does not decide. The unit of most is that of the longest, unless
  // that one is wrong.
  std::map<double, std::size_t> votes;
  for (const TimeSpan& scan : scans)
    if (const auto unit_s = unitOf(scan.last - scan.first)) ++votes[*unit_s];
  std::optional<double> unit_s;
  for (const auto& [unit, count] : votes)  // from the finest on, which is that of the longest scans
    if (!unit_s || count > votes[*unit_s]) unit_s = unit;
  if (!unit_s) return std::nullopt;
  for (const bool absolute : {false, true}) {
    const TimeScale scale = {*unit_s, absolute};
    const auto fit = std::count_if(scans.begin(), scans.end(), [&](const TimeSpan& scan) { return fits(scan, scale); });
    if (2 * static_cast<std::size_t>(fit) > scans.size()) return scale;
  }
  return std::nullopt;
}

double unitOfDate_s(double time) {
  constexpr double kFirst_s = 0.9e9, kLast_s = 4e9;  // 2008 by GPS, 2096 by Unix
  // Adjusted standard GPS time is 1e9 s less: from 1.5e8 s on.
  constexpr double kFirstAdjusted_s = 1e8;
  for (const double first_s : {kFirst_s, kFirstAdjusted_s})
    for (const double unit_s : {1e-9, 1e-6, 1e-3})
      if (time * unit_s >= first_s && time * unit_s <= kLast_s) return unit_s;
  return time * 1e-9 >= kFirstAdjusted_s ? 1e-9 : 1;
}

const char* timeUnitName(double unit_s) { return unitOfSeconds(unit_s).name; }
std::string inWords(double unit_s) { return unitOfSeconds(unit_s).words; }

OffsetRange offsetRange(std::span<const TimeSpan> scans, const TimeScale& scale) {
  OffsetRange range;
  bool first = true;
  for (const TimeSpan& scan : scans) {
    if (scans.size() > 1 && !fits(scan, scale)) continue;
    const double begin_s = scale.offset_s(scan.first, scan.stamp_s), end_s = scale.offset_s(scan.last, scan.stamp_s);
    range.first_s = first ? begin_s : std::min(range.first_s, begin_s);
    range.last_s = first ? end_s : std::max(range.last_s, end_s);
    first = false;
  }
  return range;
}

}  // namespace accessvdb::io

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/scans/deskew_choice.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "accessvdb/error.h"
#include "io/median.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {
namespace {

std::string rangeText(const OffsetRange& range) {
  char text[96];
  std::snprintf(text, sizeof text, "%.0f to %.0f ms", range.first_s * 1e3, range.last_s * 1e3);
  return text;
}

/// Scans are alike: one that reaches three scans beyond the others has wrong times.
OffsetRange usualTimes(const std::vector<TimeSpan>& samples, const TimeScale& scale) {
  std::vector<double> first_s, last_s, length_s;
  for (const TimeSpan& sample : samples) {
    const TimeSpan alone[] = {sample};
    const OffsetRange range = offsetRange(alone, scale);
    first_s.push_back(range.first_s);
    last_s.push_back(range.last_s);
    length_s.push_back(range.last_s - range.first_s);
  }
  constexpr double kLeastSlack_s = 0.2;
  const double slack_s = std::max(3 * median(length_s), kLeastSlack_s);
  return {std::max(median(first_s) - slack_s, -kLongestScan_s), std::min(median(last_s) + slack_s, kLongestScan_s)};
}

std::vector<TimeSpan> samplesWithin(const OffsetRange& usual, std::vector<TimeSpan> samples, const TimeScale& scale) {
  std::erase_if(samples, [&](const TimeSpan& sample) {
    const TimeSpan alone[] = {sample};
    const OffsetRange range = offsetRange(alone, scale);
    return range.first_s < usual.first_s || range.last_s > usual.last_s;
  });
  return samples;
}

}  // namespace

DeskewChoice chooseDeskew(Deskew wanted, const TimedScans& timed) {
  const auto unchanged = [&](const std::string& id, const std::string& why, const std::string& advice) {
    if (timed.registered) return DeskewChoice{{}, {}, "; all rays of a cloud begin at one place: " + why};
    if (wanted == Deskew::On)
      throw UnusableInput(id, timed.subject, "the motion within a scan cannot be removed, as Deskew::On asks: " + why,
                          advice);
    return DeskewChoice{{}, {}, "; motion within a scan is not removed: " + why};
  };
  if (timed.registered && (wanted == Deskew::Off || timed.field.empty())) return {};
  if (wanted == Deskew::Off) return {{}, {}, "; motion within a scan is not removed: Deskew::Off"};
  if (!timed.posed_by_time)
    return unchanged("deskew.poses", "the poses have no times",
                     "Use poses in TUM format, or leave out ScanInputOptions::deskew");
  if (timed.field.empty())
    return unchanged("deskew.no_times", "its points have no times",
                     "Record the driver's clouds with a time for each point, or leave out ScanInputOptions::deskew");
  const std::string field = "'" + wordForMessage(timed.field) + "'";
  const auto scale = timed.scale && !timed.samples.empty() ? timed.scale : timeScaleOf(timed.samples);
  bool differ = false;
  for (const TimeSpan& span : timed.samples) differ = differ || span.last > span.first;
  if (!differ)
    return unchanged("deskew.no_times", field + " is the same for all points of a scan",
                     "Record the driver's clouds with a time for each point, or leave out ScanInputOptions::deskew");
  if (!scale)
    return unchanged(
        "deskew.clock", field + " is on another clock than the scan's stamp",
        "Record times that count from the scan's stamp, or are on its clock, or leave out ScanInputOptions::deskew");
  const OffsetRange usual = usualTimes(timed.samples, *scale);
  const OffsetRange range = offsetRange(samplesWithin(usual, timed.samples, *scale), *scale);
  const std::size_t covered = timed.covered(range);
  if (covered == 0)
    return unchanged(
        "deskew.poses",
        "no scan has poses within " + gapInWords(timed.max_gap_s) + " of all of its points, " + rangeText(range),
        "Record poses more often, bridge longer gaps with ScanInputOptions::max_gap_s, or leave out "
        "ScanInputOptions::deskew");
  return {
      scale, usual,
      std::string(timed.registered ? "; each ray begins where the sensor was at its point's time ("
                                   : "; each point is placed by the pose at its own time (") +
          field + ", " + scale->inWords() + ", " + rangeText(range) + ")" +
          (timed.scans > 0 ? " in " + std::to_string(covered) + " of " + std::to_string(timed.scans) + " scans" : "")};
}

}  // namespace accessvdb::io

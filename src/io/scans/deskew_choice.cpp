// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/scans/deskew_choice.h"

#include <cmath>
#include <cstdio>

#include "accessvdb/error.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {
namespace {

std::string rangeText(const OffsetRange& range) {
  char text[96];
  std::snprintf(text, sizeof text, "%.0f to %.0f ms", range.first_s * 1e3, range.last_s * 1e3);
  return text;
}

}  // namespace

DeskewChoice chooseDeskew(Deskew wanted, const TimedScans& timed) {
  const auto unchanged = [&](const std::string& id, const std::string& why, const std::string& advice) {
    if (wanted == Deskew::On)
      throw UnusableInput(id, timed.subject, "the motion within a scan cannot be removed, as Deskew::On asks: " + why,
                          advice);
    return DeskewChoice{{}, "; motion within a scan is not removed: " + why};
  };
  if (wanted == Deskew::Off) return {{}, "; motion within a scan is not removed: Deskew::Off"};
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
  const OffsetRange range = offsetRange(timed.samples, *scale);
  const std::size_t covered = timed.covered(range);
  if (covered == 0)
    return unchanged("deskew.poses", "no scan has poses within 0.2 s of all of its points, " + rangeText(range),
                     "Record poses more often, or leave out ScanInputOptions::deskew");
  return {scale, "; each point is placed by the pose at its own time (" + field + ", " + scale->inWords() + ", " +
                     rangeText(range) + ") in " + std::to_string(covered) + " of " + std::to_string(timed.scans) +
                     " scans"};
}

}  // namespace accessvdb::io

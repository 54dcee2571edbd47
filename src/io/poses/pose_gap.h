// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Over how long a time without poses one is interpolated.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <string>
#include <vector>

namespace accessvdb::io {

/// Longest gap between two poses that is interpolated over, unless ScanInputOptions::max_gap_s says another.
inline constexpr double kMaxPoseGap_s = 0.2;
/// What may be asked for: beyond, what moves a scanner has turned in between.
inline constexpr double kLeastPoseGap_s = 1e-3, kMostPoseGap_s = 10;
/// A stamp this close to a pose's is that pose's: both were rounded when written, to 5 digits or more.
inline constexpr double kSameStamp_s = 1e-5;

/// Stamps are rounded, so gaps are, too: poses at 5 Hz are 0.2 s apart.
[[nodiscard]] inline bool bridges(double gap_s, double max_gap_s) { return gap_s <= max_gap_s + kSameStamp_s; }

/// Files may hold any number. What is more than a century from 0 is that far: a stamp of a message and an offset add up
/// without overflow.
[[nodiscard]] inline std::int64_t nanoseconds(double seconds) {
  constexpr double kMost_s = 4e9;
  return static_cast<std::int64_t>(std::llround(std::clamp(seconds, -kMost_s, kMost_s) * 1e9));
}

/// "0.2 s"
[[nodiscard]] inline std::string gapInWords(double gap_s) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g s", gap_s);
  return text;
}

/// A value for max_gap_s that is enough for nearly all of these gaps, in hundredths of a second and with room for
/// jitter; 0 where none may be asked for.
[[nodiscard]] inline double sufficientGap_s(std::vector<double> gaps_s) {
  if (gaps_s.empty()) return 0;
  const auto nearly_last = gaps_s.begin() + static_cast<std::ptrdiff_t>((gaps_s.size() - 1) * 999 / 1000);
  std::nth_element(gaps_s.begin(), nearly_last, gaps_s.end());
  const double enough_s = std::ceil(*nearly_last * 1.05 * 100) / 100;
  return enough_s <= kMostPoseGap_s ? enough_s : 0;
}

}  // namespace accessvdb::io

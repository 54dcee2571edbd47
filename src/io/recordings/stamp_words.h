// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Stamps of a recording in messages.
#pragma once

#include <cstdint>
#include <cstdio>
#include <string>

#include "io/poses/pose_track.h"

namespace accessvdb::io {

/// Seconds with three decimals.
[[nodiscard]] inline std::string secondsText(std::int64_t stamp_ns) {
  char text[64];
  std::snprintf(text, sizeof text, "%.3f", seconds(stamp_ns));
  return text;
}

[[nodiscard]] inline std::string spanText(std::int64_t first_ns, std::int64_t last_ns) {
  return secondsText(first_ns) + " to " + secondsText(last_ns) + " s";
}

}  // namespace accessvdb::io

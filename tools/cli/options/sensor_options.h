// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The flags for a sensor on a platform: where it is, how it moves and is tilted, and what of the platform it sees.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "accessvdb/scan_io.h"
#include "options/flag_parser.h"

namespace accessvdb::tools {

struct SensorOptions {
  std::string extrinsic, exclude_box, level;
  std::string deskew = "auto";
};

/// Where the sensor is, and what it sees of the platform.
void addSensorOptions(FlagParser& flags, SensorOptions& options);
/// How it moves within a scan and is tilted.
void addMotionOptions(FlagParser& flags, SensorOptions& options);

/// @throws InvalidArgument naming the flag
void applySensorOptions(const SensorOptions& options, io::ScanInputOptions& input);

/// Names and values of those that were given, for the report.
[[nodiscard]] std::vector<std::pair<std::string, std::string>> givenSensorOptions(const SensorOptions& options);

}  // namespace accessvdb::tools

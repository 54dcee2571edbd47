// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The flags for recordings of ROS: which topics, and which frame the map is in.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "accessvdb/scan_io.h"
#include "options/flag_parser.h"

namespace accessvdb::tools {

struct RecordingOptions {
  std::string topic, pose_topic, fixed_frame;
};

void addRecordingOptions(FlagParser& flags, RecordingOptions& options);

/// Copies them into the library's options.
void applyRecordingOptions(const RecordingOptions& options, io::ScanInputOptions& input);

/// Names and values of those that were given, for the report.
[[nodiscard]] std::vector<std::pair<std::string, std::string>> givenRecordingOptions(const RecordingOptions& options);

}  // namespace accessvdb::tools

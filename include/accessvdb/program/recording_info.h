// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is in a recording of ROS: .mcap, .db3 (ROS 2), .bag (ROS 1).
/// Made for the program `accessvdb`: unlike the headers above this folder, it may change with every version.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "accessvdb/export.h"

namespace accessvdb::io {

struct RecordingTopic {
  std::string name;
  std::string type;      ///< "sensor_msgs/PointCloud2", the same for ROS 1 and ROS 2
  std::string encoding;  ///< "cdr" (ROS 2), "ros1", or another word
  std::uint64_t messages = 0;
  double first_s = 0, last_s = 0;    ///< when messages were recorded, seconds since 1970
  std::vector<std::string> frames;   ///< of the headers, for types that are read; at most 64
  std::string child_frame;           ///< odometry: the frame that is posed
  bool cloud = false, pose = false;  ///< usable as --topic, as --pose-topic
  std::string problem;               ///< why its messages cannot be read; empty if they can
};

struct RecordingSummary {
  std::vector<std::string> files;  ///< one, or the parts of a folder
  std::uint64_t bytes = 0;
  std::uint64_t messages = 0;
  double first_s = 0, last_s = 0;       ///< of all messages
  std::vector<RecordingTopic> topics;   ///< in the order in which they appear
  std::vector<std::string> transforms;  ///< "odom -> base_link", at most 200
  std::vector<std::string> warnings;    ///< one line for each file that is not whole
};

/// Whether a path is a recording by its name, or a folder with parts of one.
[[nodiscard]] ACCESSVDB_API bool isRecordingFile(const std::filesystem::path& path);

/// Reads the whole recording once, with the memory of its largest chunk.
/// @throws InputError (code 3) as ScanSequence::open
[[nodiscard]] ACCESSVDB_API RecordingSummary summarizeRecording(const std::filesystem::path& path);

}  // namespace accessvdb::io

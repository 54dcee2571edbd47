// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "options/recording_options.h"

namespace accessvdb::tools {

void addRecordingOptions(FlagParser& flags, RecordingOptions& options) {
  flags.option("--topic", &options.topic, "recordings: the topic with the clouds, if there are several");
  flags.option("--pose-topic", &options.pose_topic,
               "recordings: the topic with the poses (odometry, poses, or /tf), if there are several");
  flags.option(
      "--fixed-frame", &options.fixed_frame,
      "recordings: the frame of the map; default: the one that the odometry is in, or the top of the transforms");
}

void applyRecordingOptions(const RecordingOptions& options, io::ScanInputOptions& input) {
  input.topic = options.topic;
  input.pose_topic = options.pose_topic;
  input.fixed_frame = options.fixed_frame;
}

std::vector<std::pair<std::string, std::string>> givenRecordingOptions(const RecordingOptions& options) {
  std::vector<std::pair<std::string, std::string>> given;
  if (!options.topic.empty()) given.emplace_back("topic", options.topic);
  if (!options.pose_topic.empty()) given.emplace_back("pose_topic", options.pose_topic);
  if (!options.fixed_frame.empty()) given.emplace_back("fixed_frame", options.fixed_frame);
  return given;
}

}  // namespace accessvdb::tools

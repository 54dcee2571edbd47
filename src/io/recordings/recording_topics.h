// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which topics of a recording are used: those that were asked for, or the only ones, or an error that lists them.
#pragma once

#include <string>
#include <vector>

#include "io/recordings/recording_index.h"

namespace accessvdb::io {

/// "/points (sensor_msgs/PointCloud2, 600 messages)"
[[nodiscard]] std::string topicInWords(const IndexedTopic& topic);

/// @param wanted   --topic; empty: the only one, or the registered one of FAST-LIO and its relatives
/// @param subject  the recording's name for messages
/// @throws InputError "recording.topic"; UnusableInput "recording.no_clouds", "recording.several_clouds"
[[nodiscard]] IndexedTopic& chooseCloudTopic(RecordingIndex& index, const std::string& wanted,
                                             const std::string& subject);

/// @param wanted  --pose-topic; empty: the only odometry, else transforms, else the only topic of poses
/// @return null for transforms
/// @throws InputError "recording.topic"; UnusableInput "recording.several_poses", "poses.none"
[[nodiscard]] IndexedTopic* choosePoseTopic(RecordingIndex& index, const IndexedTopic& cloud, const std::string& wanted,
                                            const std::string& subject);

}  // namespace accessvdb::io

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Messages of ROS 2 as scans and poses of a live session. Nothing is allocated that the message's own bytes do not
/// fill.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "accessvdb/live_session.h"
#include "bags/messages.h"

namespace accessvdb::dds {

/// "sensor_msgs/PointCloud2" of "sensor_msgs::msg::dds_::PointCloud2_"; the name unchanged if it is of another form.
[[nodiscard]] std::string rosType(const std::string& dds_type);
/// The way back.
[[nodiscard]] std::string ddsType(const std::string& ros_type);
/// "rt/livox/lidar" of "/livox/lidar".
[[nodiscard]] std::string ddsTopic(const std::string& ros_topic);

/// @throws bags::MessageError
[[nodiscard]] LiveScan scanFrom(bags::MessageKind kind, std::string_view cdr);
[[nodiscard]] LivePose poseFrom(bags::MessageKind kind, std::string_view cdr);
/// Of std_msgs/String.
[[nodiscard]] std::string textFrom(std::string_view cdr);
[[nodiscard]] LiveImu imuFrom(std::string_view cdr);
/// @param fixed  of /tf_static
[[nodiscard]] std::vector<LiveTransform> transformsFrom(std::string_view cdr, bool fixed);

}  // namespace accessvdb::dds

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "dds/incoming_messages.h"

#include "bags/message_reader.h"

namespace accessvdb::dds {

std::string rosType(const std::string& dds_type) {
  constexpr std::string_view kMiddle = "::msg::dds_::";
  const std::size_t middle = dds_type.find(kMiddle);
  if (middle == std::string::npos || dds_type.back() != '_') return dds_type;
  const std::size_t name = middle + kMiddle.size();
  return dds_type.substr(0, middle) + "/" + dds_type.substr(name, dds_type.size() - 1 - name);
}

std::string ddsType(const std::string& ros_type) {
  const std::size_t slash = ros_type.find('/');
  if (slash == std::string::npos) return ros_type;
  return ros_type.substr(0, slash) + "::msg::dds_::" + ros_type.substr(slash + 1) + "_";
}

std::string ddsTopic(const std::string& ros_topic) {
  return "rt" + std::string(ros_topic.starts_with('/') ? "" : "/") + ros_topic;
}

LiveScan scanFrom(bags::MessageKind kind, std::string_view cdr) {
  const bags::CloudMessage cloud = bags::readCloud(kind, cdr, bags::Wire::Cdr);
  LiveScan scan;
  scan.stamp_ns = cloud.header.stamp_ns;
  scan.frame = cloud.header.frame;
  if (cloud.doubles) {
    bags::appendPoints(cloud, scan.points_double);
  } else {
    bags::appendPoints(cloud, scan.points);
  }
  if (!cloud.time) return scan;
  bags::appendTimes(cloud, scan.times);
  if (kind == bags::MessageKind::LivoxCustom) scan.time_unit_s = 1e-9;
  return scan;
}

LivePose poseFrom(bags::MessageKind kind, std::string_view cdr) {
  const bags::PoseMessage message = bags::readPose(kind, cdr, bags::Wire::Cdr);
  LivePose pose;
  pose.stamp_ns = message.header.stamp_ns;
  pose.p_W = message.p;
  pose.q_W_B = Eigen::Quaterniond(message.q[0], message.q[1], message.q[2], message.q[3]);
  pose.frame = message.header.frame;
  pose.child = message.child;
  return pose;
}

std::string textFrom(std::string_view cdr) {
  bags::MessageReader reader(cdr, bags::Wire::Cdr);
  return std::string(reader.text());
}

LiveImu imuFrom(std::string_view cdr) {
  const bags::ImuMessage message = bags::readImu(cdr, bags::Wire::Cdr);
  return {message.header.stamp_ns, message.force, std::string(message.header.frame)};
}

std::vector<LiveTransform> transformsFrom(std::string_view cdr, bool fixed) {
  std::vector<LiveTransform> transforms;
  for (const bags::PoseMessage& message : bags::readTransforms(cdr, bags::Wire::Cdr)) {
    LiveTransform& transform = transforms.emplace_back();
    transform.stamp_ns = message.header.stamp_ns;
    transform.parent = message.header.frame;
    transform.child = message.child;
    transform.p = message.p;
    transform.q = Eigen::Quaterniond(message.q[0], message.q[1], message.q[2], message.q[3]);
    transform.fixed = fixed;
  }
  return transforms;
}

}  // namespace accessvdb::dds

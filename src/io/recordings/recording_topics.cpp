// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/recordings/recording_topics.h"

#include <algorithm>

#include "accessvdb/error.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {
namespace {

/// More would not fit into one line that somebody reads.
constexpr std::size_t kMostListed = 20;

using Topics = std::vector<IndexedTopic*>;

template <typename Fits>
Topics topicsOf(RecordingIndex& index, const Fits& fits) {
  Topics found;
  for (IndexedTopic& topic : index.topics)
    if (topic.topic.messages > 0 && fits(topic)) found.push_back(&topic);
  return found;
}

std::string list(const Topics& topics) {
  std::string words;
  for (std::size_t i = 0; i < std::min(topics.size(), kMostListed); ++i)
    words += (i == 0 ? "" : ", ") + topicInWords(*topics[i]);
  if (topics.size() > kMostListed) words += " and " + std::to_string(topics.size() - kMostListed) + " more";
  return words.empty() ? "none" : words;
}

Topics all(RecordingIndex& index) {
  return topicsOf(index, [](const IndexedTopic&) { return true; });
}
Topics cloudsIn(RecordingIndex& index) {
  return topicsOf(index, [](const IndexedTopic& topic) { return topic.isReadCloud(); });
}
Topics posesIn(RecordingIndex& index) {
  return topicsOf(index, [](const IndexedTopic& topic) { return topic.isReadPose(); });
}

/// The topic that was asked for, if its type fits.
template <typename Fits>
IndexedTopic& named(RecordingIndex& index, const std::string& wanted, const std::string& subject, const char* flag,
                    const char* types, const Fits& fits) {
  const Topics same = topicsOf(index, [&](const IndexedTopic& topic) { return topic.topic.name == wanted; });
  for (IndexedTopic* topic : same)
    if (fits(*topic)) return *topic;
  const bool exists = !same.empty();
  throw InputError("recording.topic", subject,
                   exists ? wordForMessage(wanted) + " is of type " + wordForMessage(same.front()->topic.type) + " (" +
                                wordForMessage(same.front()->topic.encoding) + "), not one of " + types
                          : "has no messages on " + wordForMessage(wanted),
                   std::string("Use ") + flag + " with one of: " + list(topicsOf(index, fits)));
}

/// FAST-LIO and its relatives publish this next to the cloud in the sensor's frame.
bool isRegistered(const IndexedTopic& cloud, RecordingIndex& index) {
  const std::string_view name = cloud.topic.name;
  if (name.substr(name.rfind('/') + 1) != "cloud_registered" || cloud.frames.empty()) return false;
  const Topics poses = posesIn(index);
  return std::any_of(poses.begin(), poses.end(), [&](const IndexedTopic* topic) {
    return !topic->frames.empty() && topic->frames.front() == cloud.frames.front();
  });
}

IndexedTopic* onlyOf(const Topics& topics, const IndexedTopic& cloud, const std::string& subject) {
  if (topics.size() == 1) return topics.front();
  // Several: the one that speaks about the cloud's frame.
  Topics near;
  for (IndexedTopic* topic : topics)
    if (!topic->child.empty() && std::count(cloud.frames.begin(), cloud.frames.end(), topic->child) > 0)
      near.push_back(topic);
  if (near.size() == 1) return near.front();
  throw UnusableInput("recording.several_poses", subject, "has several topics with poses: " + list(topics),
                      "Choose one with pose_topic, or the transforms with pose_topic /tf");
}

}  // namespace

std::string topicInWords(const IndexedTopic& topic) {
  return wordForMessage(topic.topic.name) + " (" + wordForMessage(topic.topic.type) + ", " +
         std::to_string(topic.topic.messages) + " messages)";
}

IndexedTopic& chooseCloudTopic(RecordingIndex& index, const std::string& wanted, const std::string& subject) {
  if (!wanted.empty())
    return named(index, wanted, subject, "ScanInputOptions::topic",
                 "sensor_msgs/PointCloud2 and livox_ros_driver2/CustomMsg",
                 [](const IndexedTopic& topic) { return topic.isReadCloud(); });
  const Topics clouds = cloudsIn(index);
  if (clouds.empty())
    throw UnusableInput("recording.no_clouds", subject,
                        "has no clouds of type sensor_msgs/PointCloud2 or livox_ros_driver2/CustomMsg in cdr or ros1; "
                        "it has " +
                            list(all(index)),
                        "Record the topic of the scanner, or convert its clouds to PointCloud2");
  if (clouds.size() == 1) return *clouds.front();
  Topics registered;
  for (IndexedTopic* cloud : clouds)
    if (isRegistered(*cloud, index)) registered.push_back(cloud);
  if (registered.size() == 1) return *registered.front();
  throw UnusableInput("recording.several_clouds", subject, "has several topics with clouds: " + list(clouds),
                      "Choose one with ScanInputOptions::topic");
}

IndexedTopic* choosePoseTopic(RecordingIndex& index, const IndexedTopic& cloud, const std::string& wanted,
                              const std::string& subject) {
  const auto isTransforms = [](const IndexedTopic& topic) {
    return topic.kind == bags::MessageKind::Transforms && topic.wire.has_value();
  };
  if (!wanted.empty()) {
    IndexedTopic& topic = named(index, wanted, subject, "pose_topic",
                                "nav_msgs/Odometry, geometry_msgs/PoseStamped, geometry_msgs/PoseWithCovarianceStamped "
                                "and tf2_msgs/TFMessage",
                                [&](const IndexedTopic& t) { return t.isReadPose() || isTransforms(t); });
    return isTransforms(topic) ? nullptr : &topic;
  }
  const Topics poses = posesIn(index);
  Topics odometry, others;
  for (IndexedTopic* topic : poses) (topic->kind == bags::MessageKind::Odometry ? odometry : others).push_back(topic);
  if (!odometry.empty()) return onlyOf(odometry, cloud, subject);
  if (!index.transforms.empty()) return nullptr;
  if (!others.empty()) return onlyOf(others, cloud, subject);
  throw UnusableInput("poses.none", subject, "has no odometry, poses or transforms",
                      "Use ScanInputOptions::poses with a pose file in TUM format, on the recording's clock");
}

}  // namespace accessvdb::io

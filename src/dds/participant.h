// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One participant of DDS that programs of ROS 2 see as topics: it subscribes to clouds and poses, and publishes what a
/// live map has to say. No part of ROS is needed.
///
/// Sizes are bounded before anything is allocated: Fast DDS reserves a fixed number of messages of at most
/// ParticipantOptions::most_message_bytes and refuses larger ones, and remembers at most so many other participants and
/// endpoints.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "accessvdb/live_session.h"

namespace accessvdb::dds {

struct ParticipantOptions {
  int domain = 0;        ///< 0 .. 232
  bool network = false;  ///< all interfaces with multicast, else UDP on 127.0.0.1 alone
  std::uint32_t most_message_bytes = 16U << 20;
  /// As ROS names them: "/livox/lidar". The IMU's may be empty.
  std::string cloud_topic, pose_topic, imu_topic;
};

inline constexpr const char* kCommandTopic = "/accessvdb/command";
/// Texts, of commands and of the status, have no more; longer ones are not accepted.
inline constexpr std::uint32_t kMostTextBytes = 64U << 10;
inline constexpr const char* kTransformTopics[] = {"/tf", "/tf_static"};

/// What receives. Called from threads of the middleware, which must not wait.
struct Receivers {
  std::function<void(LiveScan)> scan;
  std::function<void(LivePose)> pose;
  std::function<void(LiveTransform)> transform;
  std::function<void(LiveImu)> imu;
  std::function<void(std::string)> command;
};

/// One topic that is subscribed to.
struct TopicState {
  std::string topic;              ///< as ROS names it
  std::string type;               ///< as ROS names it; empty as long as nobody publishes it
  std::uint64_t senders = 0;      ///< connected now
  std::uint64_t received = 0;     ///< messages that arrived
  std::uint64_t malformed = 0;    ///< of these: not what their type says, not used
  std::uint64_t lost = 0;         ///< messages that did not arrive between two that did: too large, or not sent again
  std::string last_problem = {};  ///< of the last malformed one
};

enum class Input { Clouds, Poses, Transforms, FixedTransforms, Imu, Commands };
inline constexpr int kNumInputs = 6;

enum class Output { Points, Changes, Status, Approaches, Views };
inline constexpr const char* kOutputTopics[] = {"/accessvdb/points", "/accessvdb/changes", "/accessvdb/status",
                                                "/accessvdb/approaches", "/accessvdb/views"};

/// "Fast DDS 2.9.1"
[[nodiscard]] std::string middleware();

class Participant {
 public:
  /// Joins a domain. @throws ResourceLimit "dds.participant"
  Participant(const ParticipantOptions& options, const Receivers& receivers);
  ~Participant();
  Participant(const Participant&) = delete;
  Participant& operator=(const Participant&) = delete;

  /// Subscribes to topics once somebody publishes them, in their type and with their reliability; to be called now and
  /// then. @return what is new, in words
  std::vector<std::string> poll();
  /// No receiver is called after this returns.
  void stopReceiving();

  /// Never waits for a subscriber. @param cdr  a message of the topic's type @return whether it was handed over
  bool publish(Output output, std::string cdr);
  /// Programs that subscribe to an output now.
  [[nodiscard]] std::uint64_t subscribers(Output output) const;

  [[nodiscard]] TopicState state(Input input) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace accessvdb::dds

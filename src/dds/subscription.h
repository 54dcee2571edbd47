// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Topics that are wanted: who publishes them, and what comes of them.
#pragma once

#include <cstdint>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

#include "dds/fastdds_compat.h"
#include "dds/participant.h"

namespace accessvdb::dds {

/// Somebody who publishes a topic that is wanted.
struct Sender {
  rtps::GUID_t id;
  std::string type;  ///< as DDS has it
  bool reliable = false, latched = false;
};

/// What a topic is wanted for.
struct WantedTopic {
  std::string topic;      ///< as ROS names it
  const char* what = "";  ///< "clouds", for messages
  std::uint32_t most_bytes = 0;
  bool latched = false;                                                       ///< what was sent before counts, too
  std::function<bool(const std::string& type)> reads;                         ///< types as ROS names them
  std::function<void(const std::string& type, std::string_view cdr)> decode;  ///< throws for what is none
};

/// A topic that is subscribed to once it is found.
class Subscription : public fast::DataReaderListener {
 public:
  explicit Subscription(WantedTopic topic) : wanted(std::move(topic)) { state_.topic = wanted.topic; }

  void on_data_available(fast::DataReader* from) override;
  void on_subscription_matched(fast::DataReader*, const fast::SubscriptionMatchedStatus& status) override;
  void setType(const std::string& ros_type);
  [[nodiscard]] TopicState state() const;

  const WantedTopic wanted;
  std::string type;  ///< as ROS names it; of the reader
  fast::DataReader* reader = nullptr;
  Sender heard;             ///< the one that the reader was made for
  bool said_type = false;   ///< that somebody sends a type that is not read
  bool said_other = false;  ///< that somebody sends in another way than the one who is heard

 private:
  void countLost(const rtps::SampleIdentity& message);

  std::string message_;  ///< one thread of the middleware at a time calls a reader's listener
  mutable std::mutex lock_;
  TopicState state_;
  std::map<rtps::GUID_t, std::uint64_t> last_of_;  ///< message of each sender
};

/// Remembers who publishes what is wanted, as long as they do.
class Discovery : public WriterListener {
 public:
  void want(const std::string& topic);
  /// In the order in which they were found.
  [[nodiscard]] std::vector<Sender> sendersOf(const std::string& topic);

 private:
  void onWriter(AnnouncedWriter writer) override;

  std::mutex lock_;
  std::map<std::string, std::vector<Sender>> found_;  ///< by DDS topics, of which there are a few
};

}  // namespace accessvdb::dds

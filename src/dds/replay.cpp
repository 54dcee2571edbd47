// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "dds/replay.h"

#include <algorithm>
#include <chrono>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/log/Log.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <map>
#include <memory>
#include <thread>
#include <vector>

#include "accessvdb/error.h"
#include "dds/incoming_messages.h"
#include "dds/participant_qos.h"
#include "dds/raw_type.h"
#include "io/recordings/recording_index.h"
#include "io/scans/scan_files.h"

namespace accessvdb::dds {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::uint32_t kMostMessageBytes = 1U << 30;

/// A participant that only publishes.
class Publisher {
 public:
  explicit Publisher(const ReplayOptions& options) {
    fast::Log::ClearConsumers();
    participant_ = fast::DomainParticipantFactory::get_instance()->create_participant(
        static_cast<std::uint32_t>(options.domain), participantQos("accessvdb replay", options.network));
    publisher_ = participant_ == nullptr ? nullptr : participant_->create_publisher(fast::PUBLISHER_QOS_DEFAULT);
    if (publisher_ == nullptr)
      throw ResourceLimit("dds.participant", "domain " + std::to_string(options.domain), "could not join the domain",
                          "Use another --domain, or end other programs that use DDS");
  }
  ~Publisher() {
    if (participant_ == nullptr) return;
    participant_->delete_contained_entities();
    fast::DomainParticipantFactory::get_instance()->delete_participant(participant_);
  }
  Publisher(const Publisher&) = delete;
  Publisher& operator=(const Publisher&) = delete;

  fast::DataWriter* writer(const std::string& ros_topic, const std::string& ros_type, bool latched) {
    const std::string type = ddsType(ros_type);
    if (participant_->find_type(type).empty())
      participant_->register_type(fast::TypeSupport(new RawType(type, kMostMessageBytes)));
    fast::Topic* topic = participant_->create_topic(ddsTopic(ros_topic), type, fast::TOPIC_QOS_DEFAULT);
    fast::DataWriterQos qos;
    qos.reliability().kind = fast::RELIABLE_RELIABILITY_QOS;
    // Nothing is given up: a reader that is slow holds the others up.
    qos.reliability().max_blocking_time = {60, 0};
    qos.durability().kind = latched ? fast::TRANSIENT_LOCAL_DURABILITY_QOS : fast::VOLATILE_DURABILITY_QOS;
    qos.history().kind = fast::KEEP_ALL_HISTORY_QOS;
    qos.resource_limits().max_samples = latched ? 5000 : 50;
    qos.resource_limits().max_samples_per_instance = qos.resource_limits().max_samples;
    qos.resource_limits().allocated_samples = 10;
    qos.publish_mode().kind = fast::ASYNCHRONOUS_PUBLISH_MODE;
    setHeartbeatPeriod(qos, 50'000'000);
    qos.endpoint().history_memory_policy = rtps::DYNAMIC_RESERVE_MEMORY_MODE;
    fast::DataWriter* made = topic == nullptr ? nullptr : publisher_->create_datawriter(topic, qos);
    if (made == nullptr)
      throw ResourceLimit("dds.participant", ros_topic, "could not be published", "End other programs that use DDS");
    return made;
  }

 private:
  fast::DomainParticipant* participant_ = nullptr;
  fast::Publisher* publisher_ = nullptr;
};

bool isHeard(const fast::DataWriter& writer) {
  fast::PublicationMatchedStatus status;
  const_cast<fast::DataWriter&>(writer).get_publication_matched_status(status);
  return status.current_count > 0;
}

}  // namespace

std::uint64_t replay(const ReplayOptions& options) {
  const io::ScanFileList list = io::listScans(options.recording);
  const std::string subject = options.recording.string();
  if (!io::isRecording(list.kind))
    throw InputError("recording.format", subject, "is not a recording", "Name a .mcap or .db3 file");
  std::vector<std::unique_ptr<bags::Recording>> recordings;
  const auto isSent = [](const bags::Topic& topic) { return topic.encoding == "cdr" && bags::kindOf(topic.type); };
  Publisher publisher(options);
  std::map<std::string, fast::DataWriter*> writers, clouds;  // by topics
  for (const auto& file : list.files) {
    recordings.push_back(io::openRecording(file, list.kind, true));
    recordings.back()->scan([](const bags::Topic&) { return false; }, [](const bags::Message&) {});
    for (const bags::Topic& topic : recordings.back()->topics()) {
      if (!isSent(topic) || topic.messages == 0 || writers.contains(topic.name)) continue;
      writers[topic.name] = publisher.writer(topic.name, topic.type, topic.name.ends_with("tf_static"));
      if (bags::isCloud(*bags::kindOf(topic.type))) clouds[topic.name] = writers[topic.name];
    }
  }
  if (writers.empty())
    throw UnusableInput("replay.nothing", subject, "has no clouds, poses or transforms of ROS 2",
                        "Name a recording of ROS 2");
  const auto give_up = Clock::now() + std::chrono::duration<double>(options.wait_s);
  const auto heard = [](const auto& topic) { return isHeard(*topic.second); };
  while (!std::any_of(clouds.begin(), clouds.end(), heard)) {
    if (options.stopped()) return 0;
    if (Clock::now() > give_up)
      throw ResourceLimit("replay.nobody", subject, "is heard by nobody", "Start accessvdb live first");
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  // The others are found at the same moment; both sides must have seen it.
  std::this_thread::sleep_for(std::chrono::milliseconds(1500));

  std::uint64_t published = 0;
  std::optional<std::int64_t> first_ns;
  const auto start = Clock::now();
  for (const auto& recording : recordings) {
    recording->scan(isSent, [&](const bags::Message& message) {
      if (options.stopped()) return;
      if (!first_ns) first_ns = message.logged_ns;
      if (options.rate > 0)
        std::this_thread::sleep_until(start +
                                      std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(
                                          1e-9 * static_cast<double>(message.logged_ns - *first_ns) / options.rate)));
      std::string bytes(message.bytes);
      published += write(*writers.at(recording->topics()[message.topic].name), &bytes) ? 1 : 0;
    });
  }
  for (const auto& [topic, writer] : writers)
    if (isHeard(*writer)) writer->wait_for_acknowledgments({30, 0});
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  return published;
}

}  // namespace accessvdb::dds

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "dds/participant.h"

#include <algorithm>
#include <array>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/log/Log.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <optional>
#include <utility>

#include "accessvdb/error.h"
#include "dds/fastdds_compat.h"
#include "dds/incoming_messages.h"
#include "dds/participant_qos.h"
#include "dds/raw_type.h"
#include "dds/subscription.h"

namespace accessvdb::dds {
namespace {

constexpr const char* kCloudType = "sensor_msgs::msg::dds_::PointCloud2_";
constexpr const char* kPosesType = "geometry_msgs::msg::dds_::PoseArray_";
constexpr const char* kTextType = "std_msgs::msg::dds_::String_";
/// Odometry has about 700 bytes, and two names of up to 256.
constexpr std::uint32_t kMostPoseBytes = 16U << 10;
/// A thousand transforms, with names of 100 letters.
constexpr std::uint32_t kMostTransformBytes = 256U << 10;
/// Messages of one topic that are whole and held at once: the listener takes each when it arrives.
constexpr int kHeldMessages = 4;
/// Places of messages of one topic, also of those that are being put together from fragments: a sender that is killed
/// inside one keeps its place until it is noticed to be gone, ten seconds later, and must not take that of another.
constexpr int kMessagePlaces = kHeldMessages + 64;

/// As Input numbers them.
std::vector<WantedTopic> wantedTopics(const ParticipantOptions& options, const Receivers& to) {
  const auto is = [](bool (*reads)(bags::MessageKind)) {
    return [reads](const std::string& type) {
      const auto kind = bags::kindOf(type);
      return kind && reads(*kind);
    };
  };
  const auto isTransforms = is([](bags::MessageKind kind) { return kind == bags::MessageKind::Transforms; });
  const auto transforms = [&](bool fixed) {
    return [to = to.transform, fixed](const std::string&, std::string_view cdr) {
      for (LiveTransform& transform : transformsFrom(cdr, fixed)) to(std::move(transform));
    };
  };
  return {{options.cloud_topic, "clouds", options.most_message_bytes, false, is(bags::isCloud),
           [to = to.scan](const std::string& type, std::string_view cdr) { to(scanFrom(*bags::kindOf(type), cdr)); }},
          {options.pose_topic, "poses", kMostPoseBytes, false, is(bags::isPose),
           [to = to.pose](const std::string& type, std::string_view cdr) { to(poseFrom(*bags::kindOf(type), cdr)); }},
          {kTransformTopics[0], "transforms", kMostTransformBytes, false, isTransforms, transforms(false)},
          {kTransformTopics[1], "transforms", kMostTransformBytes, true, isTransforms, transforms(true)},
          {options.imu_topic, "the IMU", kMostPoseBytes, false,
           is([](bags::MessageKind kind) { return kind == bags::MessageKind::Imu; }),
           [to = to.imu](const std::string&, std::string_view cdr) { to(imuFrom(cdr)); }},
          {kCommandTopic, "commands", kMostTextBytes, false,
           [](const std::string& type) { return type == "std_msgs/String"; },
           [to = to.command](const std::string&, std::string_view cdr) { to(textFrom(cdr)); }}};
}

}  // namespace

struct Participant::Impl {
  Impl(const ParticipantOptions& given, const Receivers& receivers) : options(given) {
    for (WantedTopic& topic : wantedTopics(given, receivers))
      inputs.push_back(std::make_unique<Subscription>(std::move(topic)));
  }

  ~Impl() {
    if (participant == nullptr) return;
    participant->set_listener(nullptr);
    participant->delete_contained_entities();
    fast::DomainParticipantFactory::get_instance()->delete_participant(participant);
  }

  void join() {
    fast::Log::ClearConsumers();  // this program says what matters in its own words
    for (const auto& input : inputs)
      if (!input->wanted.topic.empty()) discovery.want(input->wanted.topic);
    participant = fast::DomainParticipantFactory::get_instance()->create_participant(
        static_cast<std::uint32_t>(options.domain), participantQos("accessvdb", options.network), &discovery,
        fast::StatusMask::none());
    if (participant == nullptr) fail("could not join the domain");
    publisher = participant->create_publisher(fast::PUBLISHER_QOS_DEFAULT);
    subscriber = participant->create_subscriber(fast::SUBSCRIBER_QOS_DEFAULT);
    if (publisher == nullptr || subscriber == nullptr) fail("could not make its topics");
    writers[0] = writer(Output::Points, kCloudType, /*latched=*/true, 1);
    writers[1] = writer(Output::Changes, kCloudType, /*latched=*/false, 16);
    writers[2] = writer(Output::Status, kTextType, /*latched=*/true, 8);  // answers take up to 7
    writers[3] = writer(Output::Approaches, kPosesType, /*latched=*/true, 1);
    writers[4] = writer(Output::Views, kPosesType, /*latched=*/true, 1);
  }

  [[noreturn]] void fail(const std::string& problem) const {
    throw ResourceLimit("dds.participant", "domain " + std::to_string(options.domain), problem,
                        "Use another --domain, or end other programs that use DDS");
  }

  fast::Topic* topicOf(const std::string& ros_topic, const std::string& type, std::uint32_t most_bytes) {
    if (participant->find_type(type).empty() &&
        participant->register_type(fast::TypeSupport(new RawType(type, most_bytes))) != kDone)
      return nullptr;
    return participant->create_topic(ddsTopic(ros_topic), type, fast::TOPIC_QOS_DEFAULT);
  }

  /// @param latched  who comes later gets the last one
  fast::DataWriter* writer(Output output, const char* type, bool latched, int depth) {
    fast::DataWriterQos qos;
    qos.reliability().kind = fast::RELIABLE_RELIABILITY_QOS;
    qos.durability().kind = latched ? fast::TRANSIENT_LOCAL_DURABILITY_QOS : fast::VOLATILE_DURABILITY_QOS;
    qos.history().kind = fast::KEEP_LAST_HISTORY_QOS;
    qos.history().depth = depth;
    qos.publish_mode().kind = fast::ASYNCHRONOUS_PUBLISH_MODE;  // sends from a thread of its own
    // A datagram that is lost, as in the burst of a large cloud, is noticed and sent again within this time.
    setHeartbeatPeriod(qos, 100'000'000);
    qos.endpoint().history_memory_policy = rtps::DYNAMIC_RESERVE_MEMORY_MODE;
    fast::Topic* topic = topicOf(kOutputTopics[static_cast<int>(output)], type,
                                 output == Output::Status ? kMostTextBytes : options.most_message_bytes);
    fast::DataWriter* made = topic == nullptr ? nullptr : publisher->create_datawriter(topic, qos);
    if (made == nullptr) fail("could not publish " + std::string(kOutputTopics[static_cast<int>(output)]));
    return made;
  }

  /// What a reader that was made for one sender gets from another: the same type, and nothing less reliable or, where
  /// that matters, less durable.
  static bool hears(const Subscription& by, const Sender& other) {
    return by.heard.type == other.type && (other.reliable || !by.heard.reliable) &&
           (!by.wanted.latched || other.latched || !by.heard.latched);
  }

  /// To the first who sends what is wanted; to another when none of those who send can be heard any more.
  void subscribe(Subscription& to, std::vector<std::string>& notices) {
    if (stopped || to.wanted.topic.empty()) return;
    const std::string& topic = to.wanted.topic;
    std::optional<Sender> first;
    bool heard = false, unheard = false;
    for (const Sender& sender : discovery.sendersOf(topic)) {
      const std::string type = rosType(sender.type);
      if (!to.wanted.reads(type)) {
        if (!std::exchange(to.said_type, true))
          notices.push_back(topic + " is of type " + type.substr(0, 100) + ", which is not read here");
        continue;
      }
      if (!first) first = sender;
      (to.reader != nullptr && hears(to, sender) ? heard : unheard) = true;
    }
    if (heard && unheard && !std::exchange(to.said_other, true))
      notices.push_back(topic + " also comes as another type or best effort, which is not heard beside the first");
    if (heard || !first) return;
    unsubscribe(to);
    subscribeTo(to, *first, notices);
  }

  void unsubscribe(Subscription& from) {
    if (from.reader == nullptr) return;
    const auto* const topic = from.reader->get_topicdescription();
    subscriber->delete_datareader(std::exchange(from.reader, nullptr));
    if (fast::Topic* own = dynamic_cast<fast::Topic*>(participant->lookup_topicdescription(topic->get_name())))
      participant->delete_topic(own);
  }

  void subscribeTo(Subscription& to, const Sender& sender, std::vector<std::string>& notices) {
    const std::string type = rosType(sender.type);
    fast::DataReaderQos qos;
    qos.reliability().kind = sender.reliable ? fast::RELIABLE_RELIABILITY_QOS : fast::BEST_EFFORT_RELIABILITY_QOS;
    qos.durability().kind =
        to.wanted.latched && sender.latched ? fast::TRANSIENT_LOCAL_DURABILITY_QOS : fast::VOLATILE_DURABILITY_QOS;
    qos.history().kind = fast::KEEP_LAST_HISTORY_QOS;
    qos.history().depth = kMessagePlaces;  // readers have no other places, whatever extra_samples says
    qos.resource_limits().max_samples = kMessagePlaces;
    qos.resource_limits().max_instances = 1;
    qos.resource_limits().max_samples_per_instance = kMessagePlaces;
    qos.resource_limits().allocated_samples = kHeldMessages;
    // What a sender announces is not what is allocated: messages have their places before they come.
    qos.endpoint().history_memory_policy = rtps::PREALLOCATED_MEMORY_MODE;
    fast::Topic* topic = topicOf(to.wanted.topic, sender.type, to.wanted.most_bytes);
    if (topic == nullptr) fail("could not subscribe to " + to.wanted.topic);
    to.heard = sender;
    to.setType(type);
    to.reader = subscriber->create_datareader(topic, qos, &to);
    if (to.reader == nullptr) fail("could not subscribe to " + to.wanted.topic);
    notices.push_back(to.wanted.what + (" from " + to.wanted.topic) + " (" + type + ", " +
                      (sender.reliable ? "reliable" : "best effort") + ")");
  }

  ParticipantOptions options;
  Discovery discovery;
  std::vector<std::unique_ptr<Subscription>> inputs;  ///< [Input]
  fast::DomainParticipant* participant = nullptr;
  fast::Publisher* publisher = nullptr;
  fast::Subscriber* subscriber = nullptr;
  std::array<fast::DataWriter*, std::size(kOutputTopics)> writers = {};
  bool stopped = false;
};

Participant::Participant(const ParticipantOptions& options, const Receivers& receivers)
    : impl_(std::make_unique<Impl>(options, receivers)) {
  impl_->join();
}
Participant::~Participant() = default;

std::string middleware() { return "Fast DDS " ACCESSVDB_FASTDDS_VERSION; }

std::vector<std::string> Participant::poll() {
  std::vector<std::string> notices;
  for (const auto& input : impl_->inputs) impl_->subscribe(*input, notices);
  return notices;
}

void Participant::stopReceiving() {
  impl_->stopped = true;
  for (const auto& input : impl_->inputs) impl_->unsubscribe(*input);
}

bool Participant::publish(Output output, std::string cdr) {
  return write(*impl_->writers[static_cast<std::size_t>(output)], &cdr);
}

std::uint64_t Participant::subscribers(Output output) const {
  fast::PublicationMatchedStatus status;
  impl_->writers[static_cast<std::size_t>(output)]->get_publication_matched_status(status);
  return static_cast<std::uint64_t>(std::max(status.current_count, 0));
}

TopicState Participant::state(Input input) const { return impl_->inputs[static_cast<std::size_t>(input)]->state(); }

}  // namespace accessvdb::dds

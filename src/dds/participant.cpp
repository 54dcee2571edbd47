// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "dds/participant.h"

#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>
#include <algorithm>
#include <array>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/domain/DomainParticipantListener.hpp>
#include <fastdds/dds/log/Log.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <map>
#include <mutex>
#include <optional>
#include <utility>

#include "accessvdb/error.h"
#include "dds/incoming_messages.h"
#include "dds/raw_type.h"

namespace accessvdb::dds {
namespace {

namespace fast = eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;

constexpr const char* kCloudType = "sensor_msgs::msg::dds_::PointCloud2_";
constexpr const char* kTextType = "std_msgs::msg::dds_::String_";
/// Odometry has about 700 bytes, and two names of up to 256.
constexpr std::uint32_t kMostPoseBytes = 16U << 10;
/// Messages of one topic that are whole and held at once: the listener takes each when it arrives.
constexpr int kHeldMessages = 4;
constexpr int kMostParticipants = 64;
/// Places of messages of one topic, also of those that are being put together from fragments: a sender that is killed
/// inside one keeps its place until it is noticed to be gone, ten seconds later, and must not take that of another.
constexpr int kMessagePlaces = kHeldMessages + kMostParticipants;

/// Somebody who publishes a topic that is wanted.
struct Sender {
  rtps::GUID_t id;
  std::string type;  ///< as DDS has it
  bool reliable = false;
};

rtps::Locator_t loopback() {
  rtps::Locator_t locator;
  locator.kind = LOCATOR_KIND_UDPv4;
  rtps::IPLocator::setIPv4(locator, 127, 0, 0, 1);
  return locator;
}

fast::DomainParticipantQos participantQos(const ParticipantOptions& options) {
  constexpr std::size_t kMostEndpoints = 512;
  constexpr std::uint32_t kSocketBytes = 4U << 20;  // the system may give less
  fast::DomainParticipantQos qos;
  qos.name("accessvdb");
  qos.allocation().participants = {0, kMostParticipants, 1};
  qos.allocation().readers = {0, kMostEndpoints, 1};
  qos.allocation().writers = {0, kMostEndpoints, 1};
  // Shared memory is left out: its versions differ between the releases of Fast DDS that ROS 2 comes with.
  qos.transport().use_builtin_transports = false;
  const auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  udp->receiveBufferSize = kSocketBytes;
  udp->sendBufferSize = kSocketBytes;
  if (!options.network) {
    // The loopback interface often has no multicast: the first participants of this machine are asked one by one.
    constexpr std::uint32_t kAskedParticipants = 32;
    udp->interfaceWhiteList.emplace_back("127.0.0.1");
    udp->maxInitialPeersRange = kAskedParticipants;
    rtps::BuiltinAttributes& discovery = qos.wire_protocol().builtin;
    discovery.initialPeersList.push_back(loopback());
    discovery.metatrafficUnicastLocatorList.push_back(loopback());
  }
  qos.transport().user_transports.push_back(udp);
  return qos;
}

/// A topic that is subscribed to once it is found.
class Subscription : public fast::DataReaderListener {
 public:
  using Decode = std::function<void(bags::MessageKind, std::string_view)>;
  Subscription(std::string ros_topic, bool clouds, Decode decode)
      : topic(std::move(ros_topic)), of_clouds(clouds), decode_(std::move(decode)) {}

  [[nodiscard]] bool isWanted(bags::MessageKind sent) const {
    return bags::isCloud(sent) == of_clouds && sent != bags::MessageKind::Transforms;
  }

  void on_data_available(fast::DataReader* from) override {
    fast::SampleInfo info;
    while (from->take_next_sample(&message_, &info) == ReturnCode_t::RETCODE_OK) {
      if (!info.valid_data) continue;
      std::string problem;
      try {
        decode_(kind, message_);
      } catch (const std::exception& error) {  // of the message, or no memory for it
        problem = error.what();
      }
      const std::scoped_lock locked(lock_);
      ++state_.received;
      countLost(info.sample_identity);
      if (problem.empty()) continue;
      ++state_.malformed;
      state_.last_problem = std::move(problem);
    }
  }
  void on_subscription_matched(fast::DataReader*, const fast::SubscriptionMatchedStatus& status) override {
    const std::scoped_lock locked(lock_);
    state_.senders = static_cast<std::uint64_t>(std::max(status.current_count, 0));
  }
  void setType(const std::string& type) {
    const std::scoped_lock locked(lock_);
    state_.type = type;
    state_.senders = 0;
  }
  [[nodiscard]] TopicState state() const {
    const std::scoped_lock locked(lock_);
    return state_;
  }

  const std::string topic;  ///< as ROS names it
  const bool of_clouds;
  bags::MessageKind kind = bags::MessageKind::PointCloud2;  ///< before there is a reader
  fast::DataReader* reader = nullptr;
  Sender heard;             ///< the one that the reader was made for
  bool said_type = false;   ///< that somebody sends a type that is not read
  bool said_other = false;  ///< that somebody sends in another way than the one who is heard

 private:
  /// Each sender counts its messages: what is missing between two of them was lost, or too large to be accepted, of
  /// which the middleware says nothing.
  void countLost(const rtps::SampleIdentity& message) {
    constexpr std::size_t kMostSenders = 512;
    if (last_of_.size() == kMostSenders && !last_of_.contains(message.writer_guid())) last_of_.clear();
    const std::uint64_t number = message.sequence_number().to64long();
    std::uint64_t& last = last_of_.try_emplace(message.writer_guid(), number).first->second;
    if (number > last + 1) state_.lost += number - last - 1;
    last = std::max(last, number);
  }

  Decode decode_;
  std::string message_;  ///< one thread of the middleware at a time calls a reader's listener
  mutable std::mutex lock_;
  TopicState state_;
  std::map<rtps::GUID_t, std::uint64_t> last_of_;  ///< message of each sender
};

/// Remembers who publishes what is wanted, as long as they do.
class Discovery : public fast::DomainParticipantListener {
 public:
  void want(const std::string& topic) { found_[ddsTopic(topic)]; }

  void on_publisher_discovery(fast::DomainParticipant*, rtps::WriterDiscoveryInfo&& writer) override {
    constexpr std::size_t kMostSenders = 512;  // of one topic
    const std::scoped_lock locked(lock_);
    const auto wanted = found_.find(writer.info.topicName().to_string());
    if (wanted == found_.end()) return;
    std::erase_if(wanted->second, [&](const Sender& known) { return known.id == writer.info.guid(); });
    if (writer.status == rtps::WriterDiscoveryInfo::REMOVED_WRITER || wanted->second.size() == kMostSenders) return;
    wanted->second.push_back({writer.info.guid(), writer.info.typeName().to_string(),
                              writer.info.m_qos.m_reliability.kind == fast::RELIABLE_RELIABILITY_QOS});
  }

  /// In the order in which they were found.
  [[nodiscard]] std::vector<Sender> sendersOf(const std::string& topic) {
    const std::scoped_lock locked(lock_);
    return found_[ddsTopic(topic)];
  }

 private:
  std::mutex lock_;
  std::map<std::string, std::vector<Sender>> found_;  ///< by DDS topics, of which there are two
};

}  // namespace

struct Participant::Impl {
  Impl(const ParticipantOptions& given, Receivers receivers)
      : options(given),
        clouds(given.cloud_topic, true,
               [to = std::move(receivers.scan)](bags::MessageKind kind, std::string_view cdr) {
                 to(scanFrom(kind, cdr));
               }),
        poses(given.pose_topic, false, [to = std::move(receivers.pose)](bags::MessageKind kind, std::string_view cdr) {
          to(poseFrom(kind, cdr));
        }) {}

  ~Impl() {
    if (participant == nullptr) return;
    participant->set_listener(nullptr);
    participant->delete_contained_entities();
    fast::DomainParticipantFactory::get_instance()->delete_participant(participant);
  }

  void join() {
    fast::Log::ClearConsumers();  // this program says what matters in its own words
    discovery.want(clouds.topic);
    discovery.want(poses.topic);
    participant = fast::DomainParticipantFactory::get_instance()->create_participant(
        static_cast<std::uint32_t>(options.domain), participantQos(options), &discovery, fast::StatusMask::none());
    if (participant == nullptr) fail("could not join the domain");
    publisher = participant->create_publisher(fast::PUBLISHER_QOS_DEFAULT);
    subscriber = participant->create_subscriber(fast::SUBSCRIBER_QOS_DEFAULT);
    if (publisher == nullptr || subscriber == nullptr) fail("could not make its topics");
    writers[0] = writer(Output::Points, kCloudType, /*latched=*/true, 1);
    writers[1] = writer(Output::Changes, kCloudType, /*latched=*/false, 16);
    writers[2] = writer(Output::Status, kTextType, /*latched=*/true, 1);
  }

  [[noreturn]] void fail(const std::string& problem) const {
    throw ResourceLimit("dds.participant", "domain " + std::to_string(options.domain), problem,
                        "Use another --domain, or end other programs that use DDS");
  }

  fast::Topic* topicOf(const std::string& ros_topic, const std::string& type, std::uint32_t most_bytes) {
    if (participant->find_type(type).empty() &&
        participant->register_type(fast::TypeSupport(new RawType(type, most_bytes))) != ReturnCode_t::RETCODE_OK)
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
    qos.reliable_writer_qos().times.heartbeatPeriod = {0, 100'000'000};
    qos.endpoint().history_memory_policy = rtps::DYNAMIC_RESERVE_MEMORY_MODE;
    fast::Topic* topic = topicOf(kOutputTopics[static_cast<int>(output)], type, options.most_message_bytes);
    fast::DataWriter* made = topic == nullptr ? nullptr : publisher->create_datawriter(topic, qos);
    if (made == nullptr) fail("could not publish " + std::string(kOutputTopics[static_cast<int>(output)]));
    return made;
  }

  /// What a reader that was made for one sender gets from another: the same type, and nothing less reliable.
  static bool hears(const Sender& heard, const Sender& other) {
    return heard.type == other.type && (other.reliable || !heard.reliable);
  }

  /// To the first who sends what is wanted; to another when none of those who send can be heard any more.
  void subscribe(Subscription& to, std::vector<std::string>& notices) {
    if (stopped) return;
    std::optional<Sender> first;
    bool heard = false, unheard = false;
    for (const Sender& sender : discovery.sendersOf(to.topic)) {
      const std::string type = rosType(sender.type);
      if (const auto kind = bags::kindOf(type); !kind || !to.isWanted(*kind)) {
        if (!std::exchange(to.said_type, true))
          notices.push_back(to.topic + " is of type " + type.substr(0, 100) + ", which is not read here");
        continue;
      }
      if (!first) first = sender;
      (to.reader != nullptr && hears(to.heard, sender) ? heard : unheard) = true;
    }
    if (heard && unheard && !std::exchange(to.said_other, true))
      notices.push_back(to.topic + " also comes as another type or best effort, which is not heard beside the first");
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
    qos.durability().kind = fast::VOLATILE_DURABILITY_QOS;
    qos.history().kind = fast::KEEP_LAST_HISTORY_QOS;
    qos.history().depth = kMessagePlaces;  // readers have no other places, whatever extra_samples says
    qos.resource_limits().max_samples = kMessagePlaces;
    qos.resource_limits().max_instances = 1;
    qos.resource_limits().max_samples_per_instance = kMessagePlaces;
    qos.resource_limits().allocated_samples = kHeldMessages;
    // What a sender announces is not what is allocated: messages have their places before they come.
    qos.endpoint().history_memory_policy = rtps::PREALLOCATED_MEMORY_MODE;
    fast::Topic* topic = topicOf(to.topic, sender.type, to.of_clouds ? options.most_message_bytes : kMostPoseBytes);
    if (topic == nullptr) fail("could not subscribe to " + to.topic);
    to.kind = *bags::kindOf(type);
    to.heard = sender;
    to.setType(type);
    to.reader = subscriber->create_datareader(topic, qos, &to);
    if (to.reader == nullptr) fail("could not subscribe to " + to.topic);
    notices.push_back((to.of_clouds ? "clouds from " : "poses from ") + to.topic + " (" + type + ", " +
                      (sender.reliable ? "reliable" : "best effort") + ")");
  }

  ParticipantOptions options;
  Discovery discovery;
  Subscription clouds, poses;
  fast::DomainParticipant* participant = nullptr;
  fast::Publisher* publisher = nullptr;
  fast::Subscriber* subscriber = nullptr;
  std::array<fast::DataWriter*, 3> writers = {};
  bool stopped = false;
};

Participant::Participant(const ParticipantOptions& options, Receivers receivers)
    : impl_(std::make_unique<Impl>(options, std::move(receivers))) {
  impl_->join();
}
Participant::~Participant() = default;

std::vector<std::string> Participant::poll() {
  std::vector<std::string> notices;
  impl_->subscribe(impl_->clouds, notices);
  impl_->subscribe(impl_->poses, notices);
  return notices;
}

void Participant::stopReceiving() {
  impl_->stopped = true;
  for (Subscription* subscription : {&impl_->clouds, &impl_->poses}) impl_->unsubscribe(*subscription);
}

bool Participant::publish(Output output, std::string cdr) {
  return impl_->writers[static_cast<std::size_t>(output)]->write(&cdr);
}

std::uint64_t Participant::subscribers(Output output) const {
  fast::PublicationMatchedStatus status;
  impl_->writers[static_cast<std::size_t>(output)]->get_publication_matched_status(status);
  return static_cast<std::uint64_t>(std::max(status.current_count, 0));
}

TopicState Participant::clouds() const { return impl_->clouds.state(); }
TopicState Participant::poses() const { return impl_->poses.state(); }

}  // namespace accessvdb::dds

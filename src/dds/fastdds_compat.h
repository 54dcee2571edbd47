// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What differs between the releases 2 and 3 of Fast DDS: names, and what a write returns. No other file asks for its
/// version.
#pragma once

// The build says which release it found: the headers that do have another name in each.
#if ACCESSVDB_FASTDDS_MAJOR >= 3
#include <fastdds/rtps/builtin/data/PublicationBuiltinTopicData.hpp>
#include <fastdds/rtps/common/Guid.hpp>
#include <fastdds/rtps/common/SampleIdentity.hpp>
#include <fastdds/rtps/common/SerializedPayload.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.hpp>
#include <fastdds/rtps/writer/WriterDiscoveryStatus.hpp>
#include <fastdds/utils/IPLocator.hpp>
#else
#include <fastdds/rtps/common/SerializedPayload.h>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>
#endif
#include <cstdint>
#include <fastdds/dds/domain/DomainParticipantListener.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/qos/DataWriterQos.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <functional>
#include <string>
#include <utility>

namespace accessvdb::dds {

namespace fast = eprosima::fastdds::dds;
#if ACCESSVDB_FASTDDS_MAJOR >= 3
namespace rtps = eprosima::fastdds::rtps;
#else
namespace rtps = eprosima::fastrtps::rtps;
#endif

#if ACCESSVDB_FASTDDS_MAJOR >= 3
inline constexpr fast::ReturnCode_t kDone = fast::RETCODE_OK;
#else
inline constexpr auto kDone = ReturnCode_t::RETCODE_OK;
#endif

/// Hands a sample over. @return whether it was taken
[[nodiscard]] inline bool write(fast::DataWriter& to, void* sample) {
#if ACCESSVDB_FASTDDS_MAJOR >= 3
  return to.write(sample) == kDone;
#else
  return to.write(sample);
#endif
}

/// @param period_ns  below a second
inline void setHeartbeatPeriod(fast::DataWriterQos& qos, std::uint32_t period_ns) {
#if ACCESSVDB_FASTDDS_MAJOR >= 3
  qos.reliable_writer_qos().times.heartbeat_period = {0, period_ns};
#else
  qos.reliable_writer_qos().times.heartbeatPeriod = {0, period_ns};
#endif
}

/// A type whose samples are std::string, in terms that do not change: what is derived says what the bytes are.
class StringType : public fast::TopicDataType {
 public:
  using Payload = rtps::SerializedPayload_t;

  /// @param name  as DDS has it  @param most_bytes  of one sample
  StringType(const std::string& name, std::uint32_t most_bytes) {
#if ACCESSVDB_FASTDDS_MAJOR >= 3
    set_name(name);
    max_serialized_type_size = most_bytes;
    is_compute_key_provided = false;
#else
    setName(name.c_str());
    m_typeSize = most_bytes;
    m_isGetKeyDefined = false;
    // ROS 2 does not send them, and the bytes speak for themselves.
    auto_fill_type_object(false);
    auto_fill_type_information(false);
#endif
  }

 protected:
  virtual bool pack(const std::string& sample, Payload& payload) const = 0;
  virtual void unpack(const Payload& payload, std::string& sample) const = 0;
  [[nodiscard]] virtual std::uint32_t packedBytes(const std::string& sample) const = 0;

 private:
#if ACCESSVDB_FASTDDS_MAJOR >= 3
  bool serialize(const void* data, Payload& payload, fast::DataRepresentationId_t) override {
    return pack(*static_cast<const std::string*>(data), payload);
  }
  bool deserialize(Payload& payload, void* data) override {
    unpack(payload, *static_cast<std::string*>(data));
    return true;
  }
  std::uint32_t calculate_serialized_size(const void* data, fast::DataRepresentationId_t) override {
    return packedBytes(*static_cast<const std::string*>(data));
  }
  void* create_data() override { return new std::string; }
  void delete_data(void* data) override { delete static_cast<std::string*>(data); }
  bool compute_key(Payload&, rtps::InstanceHandle_t&, bool) override { return false; }
  bool compute_key(const void*, rtps::InstanceHandle_t&, bool) override { return false; }
#else
  bool serialize(void* data, Payload* payload) override {
    return pack(*static_cast<const std::string*>(data), *payload);
  }
  bool deserialize(Payload* payload, void* data) override {
    unpack(*payload, *static_cast<std::string*>(data));
    return true;
  }
  std::function<std::uint32_t()> getSerializedSizeProvider(void* data) override {
    return [this, data] { return packedBytes(*static_cast<const std::string*>(data)); };
  }
  void* createData() override { return new std::string; }
  void deleteData(void* data) override { delete static_cast<std::string*>(data); }
  bool getKey(void*, rtps::InstanceHandle_t*, bool) override { return false; }
#endif
};

/// A writer that another participant announces, or that is gone.
struct AnnouncedWriter {
  rtps::GUID_t id;
  std::string topic, type;  ///< as DDS has them
  bool reliable = false, latched = false;
  bool is_gone = false;
};

/// Listens to what others announce, in terms that do not change.
class WriterListener : public fast::DomainParticipantListener {
 protected:
  virtual void onWriter(AnnouncedWriter writer) = 0;

 private:
#if ACCESSVDB_FASTDDS_MAJOR >= 3
  void on_data_writer_discovery(fast::DomainParticipant*, rtps::WriterDiscoveryStatus status,
                                const fast::PublicationBuiltinTopicData& writer, bool& should_be_ignored) override {
    should_be_ignored = false;
    onWriter({writer.guid, writer.topic_name.to_string(), writer.type_name.to_string(),
              writer.reliability.kind == fast::RELIABLE_RELIABILITY_QOS,
              writer.durability.kind != fast::VOLATILE_DURABILITY_QOS,
              status == rtps::WriterDiscoveryStatus::REMOVED_WRITER});
  }
#else
  void on_publisher_discovery(fast::DomainParticipant*, rtps::WriterDiscoveryInfo&& writer) override {
    onWriter({writer.info.guid(), writer.info.topicName().to_string(), writer.info.typeName().to_string(),
              writer.info.m_qos.m_reliability.kind == fast::RELIABLE_RELIABILITY_QOS,
              writer.info.m_qos.m_durability.kind != fast::VOLATILE_DURABILITY_QOS,
              writer.status == rtps::WriterDiscoveryInfo::REMOVED_WRITER});
  }
#endif
};

}  // namespace accessvdb::dds

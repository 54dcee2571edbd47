// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A type of DDS whose samples are bytes: the messages are written and read elsewhere.
#pragma once

#include <cstdint>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <string>

namespace accessvdb::dds {

class RawType : public eprosima::fastdds::dds::TopicDataType {
 public:
  using Payload = eprosima::fastrtps::rtps::SerializedPayload_t;

  /// @param name        as DDS has it, "sensor_msgs::msg::dds_::PointCloud2_"
  /// @param most_bytes  of one message; what Fast DDS reserves per message of a reader
  RawType(const std::string& name, std::uint32_t most_bytes);

  bool serialize(void* data, Payload* payload) override;
  bool deserialize(Payload* payload, void* data) override;
  std::function<std::uint32_t()> getSerializedSizeProvider(void* data) override;
  void* createData() override { return new std::string; }
  void deleteData(void* data) override { delete static_cast<std::string*>(data); }
  bool getKey(void*, eprosima::fastrtps::rtps::InstanceHandle_t*, bool) override { return false; }
};

}  // namespace accessvdb::dds

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A type of DDS whose samples are bytes: the messages are written and read elsewhere.
#pragma once

#include <cstdint>
#include <string>

#include "dds/fastdds_compat.h"

namespace accessvdb::dds {

class RawType : public StringType {
 public:
  /// @param name        as DDS has it, "sensor_msgs::msg::dds_::PointCloud2_"
  /// @param most_bytes  of one message; what Fast DDS reserves per message of a reader
  RawType(const std::string& name, std::uint32_t most_bytes) : StringType(name, most_bytes) {}

 private:
  bool pack(const std::string& sample, Payload& payload) const override;
  void unpack(const Payload& payload, std::string& sample) const override;
  [[nodiscard]] std::uint32_t packedBytes(const std::string& sample) const override;
};

}  // namespace accessvdb::dds

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "dds/raw_type.h"

#include <fastdds/rtps/common/SerializedPayload.h>
#include <cstring>

namespace accessvdb::dds {

RawType::RawType(const std::string& name, std::uint32_t most_bytes) {
  setName(name.c_str());
  m_typeSize = most_bytes;
  m_isGetKeyDefined = false;
  // ROS 2 does not send them, and the bytes speak for themselves.
  auto_fill_type_object(false);
  auto_fill_type_information(false);
}

bool RawType::serialize(void* data, Payload* payload) {
  const std::string& bytes = *static_cast<const std::string*>(data);
  if (bytes.size() > payload->max_size) return false;
  std::memcpy(payload->data, bytes.data(), bytes.size());
  payload->length = static_cast<std::uint32_t>(bytes.size());
  payload->encapsulation = CDR_LE;
  return true;
}

bool RawType::deserialize(Payload* payload, void* data) {
  static_cast<std::string*>(data)->assign(reinterpret_cast<const char*>(payload->data), payload->length);
  return true;
}

std::function<std::uint32_t()> RawType::getSerializedSizeProvider(void* data) {
  return [data] { return static_cast<std::uint32_t>(static_cast<const std::string*>(data)->size()); };
}

}  // namespace accessvdb::dds

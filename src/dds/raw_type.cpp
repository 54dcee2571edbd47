// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "dds/raw_type.h"

#include <cstring>

namespace accessvdb::dds {

bool RawType::pack(const std::string& sample, Payload& payload) const {
  if (sample.size() > payload.max_size) return false;
  std::memcpy(payload.data, sample.data(), sample.size());
  payload.length = static_cast<std::uint32_t>(sample.size());
  payload.encapsulation = CDR_LE;
  return true;
}

void RawType::unpack(const Payload& payload, std::string& sample) const {
  sample.assign(reinterpret_cast<const char*>(payload.data), payload.length);
}

std::uint32_t RawType::packedBytes(const std::string& sample) const {
  return static_cast<std::uint32_t>(sample.size());
}

}  // namespace accessvdb::dds

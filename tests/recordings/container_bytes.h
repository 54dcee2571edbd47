// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Records of containers, built by hand so that they can be wrong.
#pragma once

#include <string>

#include "unit/io/input_fixture.h"

namespace accessvdb::recordings_test {

using io::test::put;

inline const std::string kMcapMagic("\x89MCAP0\r\n", 8);

inline std::string mcapRecord(char opcode, const std::string& content) {
  std::string record(1, opcode);
  put(record, std::uint64_t{content.size()});
  return record + content;
}
inline std::string mcapText(const std::string& text) {
  std::string bytes;
  put(bytes, static_cast<std::uint32_t>(text.size()));
  return bytes + text;
}
/// @param declared  bytes that the chunk claims to have
inline std::string mcapChunk(const std::string& compression, const std::string& packed, std::uint64_t declared,
                             std::uint32_t crc = 0) {
  std::string content(16, '\0');
  put(content, declared);
  put(content, crc);
  content += mcapText(compression);
  put(content, std::uint64_t{packed.size()});
  return mcapRecord(6, content + packed);
}
inline std::string mcapSchema(std::uint16_t id, const std::string& name) {
  std::string content;
  put(content, id);
  return mcapRecord(3, content + mcapText(name) + mcapText("ros2msg") + mcapText(""));
}
inline std::string mcapChannel(std::uint16_t id, std::uint16_t schema, const std::string& topic,
                               const std::string& encoding = "cdr") {
  std::string content;
  put(content, id);
  put(content, schema);
  return mcapRecord(4, content + mcapText(topic) + mcapText(encoding) + mcapText(""));
}
inline std::string mcapMessage(std::uint16_t channel, const std::string& data) {
  std::string content;
  put(content, channel);
  content.append(20, '\0');
  return mcapRecord(5, content + data);
}

inline std::string rosField(const std::string& name, const std::string& value) { return mcapText(name + "=" + value); }
inline std::string rosRecord(const std::string& fields, const std::string& data) {
  return mcapText(fields) + mcapText(data);
}
template <typename T>
std::string bytesOf(T value) {
  std::string bytes;
  put(bytes, value);
  return bytes;
}

}  // namespace accessvdb::recordings_test

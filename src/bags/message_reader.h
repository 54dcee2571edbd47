// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Reads the fields of one message in order: CDR (ROS 2; numbers aligned to their size) or ROS 1 (packed).
#pragma once

#include <cstddef>
#include <cstring>
#include <string_view>

#include "bags/messages.h"

namespace accessvdb::bags {

class MessageReader {
 public:
  MessageReader(std::string_view bytes, Wire wire) : bytes_(bytes), wire_(wire) {
    if (wire == Wire::Cdr) readEncapsulation();
  }

  template <typename T>
  [[nodiscard]] T number() {
    align(sizeof(T));
    T value;
    std::memcpy(&value, take(sizeof(T)).data(), sizeof(T));
    return value;
  }

  [[nodiscard]] std::string_view text() {
    std::string_view text = take(number<std::uint32_t>());
    if (wire_ == Wire::Cdr && !text.empty() && text.back() == '\0') text.remove_suffix(1);
    return text;
  }

  /// The length of a sequence whose elements have at least that many bytes: more than there is room for is refused.
  [[nodiscard]] std::uint32_t count(std::size_t least_bytes) {
    const auto count = number<std::uint32_t>();
    if (count > (bytes_.size() - at_) / least_bytes) fail();
    return count;
  }

  [[nodiscard]] std::string_view take(std::size_t count) {
    if (bytes_.size() - at_ < count) fail();
    const std::string_view taken = bytes_.substr(at_, count);
    at_ += count;
    return taken;
  }

  /// To the next multiple of a size, as CDR counts it; nothing in ROS 1.
  void align(std::size_t size) {
    if (wire_ == Wire::Cdr) (void)take((size - at_ % size) % size);
  }

  [[nodiscard]] Wire wire() const { return wire_; }
  [[nodiscard]] std::size_t left() const { return bytes_.size() - at_; }

  [[noreturn]] static void fail() {
    throw MessageError("recording.message", "is shorter than its type says", "Copy the file again, or record it again");
  }

 private:
  void readEncapsulation() {
    const std::string_view head = take(4);
    if (head == std::string_view("\x28\xb5\x2f\xfd", 4))
      throw MessageError("recording.compression", "is compressed by itself (rosbag2's compression mode 'message')",
                         "Convert it: ros2 bag convert, with compression_mode none or file storage presets");
    if (head[0] != 0 || head[1] != 1)
      throw MessageError(head[0] == 0 && head[1] == 0 ? "recording.big_endian" : "recording.message",
                         head[0] == 0 && head[1] == 0 ? "is in big-endian CDR" : "is not in little-endian CDR",
                         "Convert it with ros2 bag convert on a little-endian machine");
    bytes_.remove_prefix(head.size());  // alignment counts from here
    at_ = 0;
  }

  std::string_view bytes_;
  std::size_t at_ = 0;
  Wire wire_;
};

}  // namespace accessvdb::bags

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Writes the fields of one message in order, as little-endian CDR of ROS 2: numbers aligned to their size, counted
/// from the end of the four bytes that say so.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <utility>

namespace accessvdb::dds {

class CdrWriter {
 public:
  template <typename T>
  void number(T value) {
    bytes_.resize(bytes_.size() + (sizeof(T) - (bytes_.size() - kHead) % sizeof(T)) % sizeof(T), '\0');
    append(&value, sizeof(T));
  }
  void text(std::string_view text) {
    number(static_cast<std::uint32_t>(text.size() + 1));
    append(text.data(), text.size());
    bytes_.push_back('\0');
  }
  /// A sequence of bytes: room for them. @return where it begins in bytes()
  std::size_t room(std::size_t count) {
    number(static_cast<std::uint32_t>(count));
    bytes_.resize(bytes_.size() + count, '\0');
    return bytes_.size() - count;
  }

  [[nodiscard]] std::string& bytes() { return bytes_; }
  [[nodiscard]] std::string take() { return std::move(bytes_); }

 private:
  static constexpr std::size_t kHead = 4;
  void append(const void* from, std::size_t count) { bytes_.append(static_cast<const char*>(from), count); }

  std::string bytes_ = std::string("\0\1\0\0", kHead);
};

}  // namespace accessvdb::dds

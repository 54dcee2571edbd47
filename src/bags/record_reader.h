// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Numbers and strings of container records, little-endian, with every length checked against what is there.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string_view>

namespace accessvdb::bags {

static_assert(std::endian::native == std::endian::little, "recordings are read as they are in memory");

/// Reads from the front. What is missing reads as 0 or empty, and good() says so at the end.
class RecordReader {
 public:
  explicit RecordReader(std::string_view bytes) : bytes_(bytes) {}

  template <typename T>
  [[nodiscard]] T number() {
    T value = 0;
    if (bytes_.size() < sizeof(T)) {
      fail();
    } else {
      std::memcpy(&value, bytes_.data(), sizeof(T));
      bytes_.remove_prefix(sizeof(T));
    }
    return value;
  }
  [[nodiscard]] std::string_view take(std::uint64_t count) {
    if (bytes_.size() < count) {
      fail();
      return {};
    }
    const std::string_view taken = bytes_.substr(0, static_cast<std::size_t>(count));
    bytes_.remove_prefix(static_cast<std::size_t>(count));
    return taken;
  }
  /// With its length in 4 bytes before it.
  [[nodiscard]] std::string_view text() { return take(number<std::uint32_t>()); }

  [[nodiscard]] bool good() const { return good_; }
  [[nodiscard]] std::string_view rest() const { return bytes_; }

 private:
  void fail() {
    good_ = false;
    bytes_ = {};
  }

  std::string_view bytes_;
  bool good_ = true;
};

}  // namespace accessvdb::bags

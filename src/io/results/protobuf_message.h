// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Messages in Protocol Buffers' encoding: https://protobuf.dev/programming-guides/encoding
#pragma once

#include <bit>
#include <cstdint>
#include <string>
#include <string_view>

namespace accessvdb::io {

class ProtobufMessage {
 public:
  ProtobufMessage& whole(int field, std::uint64_t value) {
    key(field, 0);
    varint(value);
    return *this;
  }
  ProtobufMessage& fixed32(int field, std::uint32_t value) {
    key(field, 5);
    little(value, sizeof value);
    return *this;
  }
  ProtobufMessage& real(int field, double value) {
    key(field, 1);
    little(std::bit_cast<std::uint64_t>(value), sizeof value);
    return *this;
  }
  /// Texts, bytes and messages.
  ProtobufMessage& bytes(int field, std::string_view value) {
    key(field, 2);
    varint(value.size());
    bytes_ += value;
    return *this;
  }
  ProtobufMessage& message(int field, const ProtobufMessage& value) { return bytes(field, value.bytes_); }
  [[nodiscard]] const std::string& encoded() const { return bytes_; }

 private:
  void key(int field, unsigned wire) { varint(static_cast<std::uint64_t>(field) << 3 | wire); }
  void varint(std::uint64_t value) {
    for (; value >= 128; value >>= 7) bytes_ += static_cast<char>((value & 127) | 128);
    bytes_ += static_cast<char>(value);
  }
  void little(std::uint64_t value, std::size_t size) {
    for (std::size_t n = 0; n < size; ++n) bytes_ += static_cast<char>(value >> (8 * n) & 255);
  }

  std::string bytes_;
};

}  // namespace accessvdb::io

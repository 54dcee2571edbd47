// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the reader and the writer of MCAP share: https://mcap.dev/spec.
#pragma once

#include <zlib.h>

#include <cstdint>
#include <string_view>

namespace accessvdb::bags::mcap {

inline constexpr std::string_view kMagic{"\x89MCAP0\r\n", 8};

enum Opcode : unsigned char {
  kHeader = 1,
  kFooter = 2,
  kSchema = 3,
  kChannel = 4,
  kMessage = 5,
  kChunk = 6,
  kMessageIndex = 7,
  kChunkIndex = 8,
  kStatistics = 11,
  kSummaryOffset = 14,
  kDataEnd = 15
};

/// @param before  of what stands before these bytes
[[nodiscard]] inline std::uint32_t crc32Of(std::string_view bytes, std::uint32_t before = 0) {
  return static_cast<std::uint32_t>(::crc32_z(before, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

}  // namespace accessvdb::bags::mcap

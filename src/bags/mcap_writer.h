// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Writes MCAP (version 0 of the format): https://mcap.dev/spec. Each message is a chunk of its own, not compressed,
/// with an index at the end.
#pragma once

#include <cstdint>
#include <iosfwd>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace accessvdb::bags {

class McapWriter {
 public:
  /// @param library  who writes
  McapWriter(std::ostream& out, std::string_view library);

  /// All schemas and channels before the first message. @return its number
  std::uint16_t addSchema(std::string_view name, std::string_view encoding, std::string_view data);
  std::uint16_t addChannel(std::uint16_t schema, std::string_view topic, std::string_view encoding);
  void add(std::uint16_t channel, std::uint64_t time_ns, std::string_view message);
  /// Writes the index; nothing may follow.
  void finish();

 private:
  struct Chunk {
    std::uint64_t begin = 0, bytes = 0, index_begin = 0, index_bytes = 0, records_bytes = 0, time_ns = 0;
    std::uint16_t channel = 0;
  };
  void write(std::string_view bytes);

  std::ostream& out_;
  std::uint64_t at_ = 0;
  std::uint32_t crc_ = 0;                        ///< of all that was written
  std::vector<std::string> schemas_, channels_;  ///< their records, once more for the index
  std::vector<Chunk> chunks_;
  std::map<std::uint16_t, std::uint64_t> messages_;  ///< by channel
};

}  // namespace accessvdb::bags

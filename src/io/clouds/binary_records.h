// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Records of one size, one behind the other.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "io/streams/byte_source.h"

namespace accessvdb::io {

struct BinaryRecords {
  std::uint64_t begin = 0;         ///< first byte
  std::uint64_t record_bytes = 1;  ///< > 0
  std::uint64_t count = 0;         ///< complete records; begin + count * record_bytes does not overflow

  /// How many of `wanted` records there are from `first` on.
  [[nodiscard]] std::size_t countFrom(std::uint64_t first, std::size_t wanted) const {
    return static_cast<std::size_t>(std::min<std::uint64_t>(wanted, count - std::min(count, first)));
  }

  /// Calls use(i, bytes of record i) for `wanted` records from `first` on, or as many as the source has.
  /// @return how many it had
  template <typename Use>
  std::size_t forEach(ByteSource& source, std::uint64_t first, std::size_t wanted, const Use& use) const {
    std::size_t done = 0;
    while (done < wanted) {
      const std::uint64_t at = first + done;
      const std::string_view bytes = source.view(begin + at * record_bytes, record_bytes);
      const auto here = static_cast<std::size_t>(std::min<std::uint64_t>(bytes.size() / record_bytes, wanted - done));
      if (here == 0) break;
      const char* record = bytes.data();
      for (std::size_t i = 0; i < here; ++i, record += record_bytes) use(at + i, record);
      done += here;
    }
    return done;
  }
};

}  // namespace accessvdb::io

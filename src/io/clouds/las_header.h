// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The header of a LAS file, 1.0 to 1.4, and the records behind it that say what its coordinates are.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "io/clouds/las_units.h"
#include "io/streams/byte_source.h"

namespace accessvdb::io {

inline constexpr std::uint64_t kLasHeaderBytes14 = 375;  ///< of version 1.4, the longest

struct LasFileHeader {
  std::uint64_t points = 0, data_offset = 0, record_bytes = 0;
  int format = 0;
  std::uint16_t year = 0, day = 0;          ///< when the file was made
  bool adjusted_gps_time = false;           ///< bit 0 of the global encoding
  Eigen::Vector3d scale, offset, min, max;  ///< in the file's units
};

/// @param file  the beginning: kLasHeaderBytes14, or all of a shorter input
/// @param size  bytes of the whole input, if known
/// @throws InputError
[[nodiscard]] LasFileHeader parseLasHeader(std::string_view file, std::optional<std::uint64_t> size,
                                           const std::string& subject);
/// Least bytes of a record; extra bytes are behind them. @param format  0 .. 10
[[nodiscard]] std::uint64_t lasFormatBytes(int format);
/// Where the GPS time is in a record, 0 = there is none. @param format  0 .. 10
[[nodiscard]] std::uint64_t lasTimeOffset(int format);
[[noreturn]] void refuseCutHeader(const std::string& subject, std::uint64_t bytes, std::uint64_t needed);

/// The records of the projection, before the points and, in a file of version 1.4, behind them. A file of LAZ has them
/// as a LAS has. Empty for what is not LAS.
[[nodiscard]] LasProjection readLasProjection(ByteSource& file);

}  // namespace accessvdb::io

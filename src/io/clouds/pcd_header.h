// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The header of a PCD file: the gate that every file passes before its body is touched.
///
/// More tolerant than PCL where real files need it (WIDTH 0 HEIGHT 0 with a correct POINTS line, no VIEWPOINT, no
/// COUNT), and stricter everywhere else (PCL 1.13 crashes on a text file or a Git LFS pointer named .pcd).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "io/clouds/scalar_type.h"

namespace accessvdb::io {

struct PcdField {
  std::string name;
  ScalarType type = ScalarType::Float32;
  std::uint64_t count = 1;         ///< values of this field in a record
  std::uint64_t first_value = 0;   ///< values of the record before it (ascii)
  std::uint64_t offset_bytes = 0;  ///< bytes of the record before it (binary)
};

struct PcdHeader {
  enum class Data { Ascii, Binary, BinaryCompressed };
  std::vector<PcdField> fields;
  std::array<std::size_t, 3> xyz = {};  ///< indices into fields
  std::uint64_t points = 0;
  std::uint64_t record_values = 0;
  std::uint64_t record_bytes = 0;  ///< at most kMaxPcdRecordBytes
  Data data = Data::Ascii;
  std::uint64_t data_offset = 0;
  std::optional<std::array<double, 7>> viewpoint;  ///< tx ty tz qw qx qy qz
};

inline constexpr std::uint64_t kMaxPcdRecordBytes = 1 << 16;
/// Maximum size of a header.
inline constexpr std::uint64_t kMaxPcdHeaderBytes = 1 << 17;

/// @throws InputError "input.malformed" naming the line
[[nodiscard]] PcdHeader parsePcdHeader(std::string_view file, const std::string& subject);

}  // namespace accessvdb::io

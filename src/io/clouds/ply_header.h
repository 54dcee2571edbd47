// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The header of a PLY file.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "io/clouds/scalar_type.h"
#include "io/streams/byte_source.h"

namespace accessvdb::io {

struct PlyProperty {
  std::string name;
  ScalarType type = ScalarType::Float32;       ///< type of the value, or of a list's entries
  std::optional<ScalarType> list_length_type;  ///< set for a list
};

struct PlyElement {
  std::string name;
  std::uint64_t count = 0;
  std::vector<PlyProperty> properties;

  [[nodiscard]] bool hasLists() const;
  [[nodiscard]] std::uint64_t recordBytes() const;  ///< without lists
  [[nodiscard]] std::optional<std::size_t> find(std::string_view property) const;
  /// Where there is none of that name, the one that has it in capitals or behind "scalar_", as CloudCompare writes
  /// them.
  [[nodiscard]] std::optional<std::size_t> findAlike(std::string_view property) const;
};

struct PlyHeader {
  enum class Format { Ascii, BinaryLittleEndian, BinaryBigEndian };
  Format format = Format::Ascii;
  std::vector<PlyElement> elements;
  std::size_t vertex = 0;  ///< index of the element "vertex"
  std::uint64_t data_offset = 0;
};

/// @throws InputError "input.malformed" naming the line
[[nodiscard]] PlyHeader parsePlyHeader(std::string_view file, const std::string& subject);
[[nodiscard]] PlyHeader parsePlyHeader(ByteSource& file, const std::string& subject);

}  // namespace accessvdb::io

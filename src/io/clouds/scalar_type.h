// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The numbers inside binary records of PCD and PLY files.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>

namespace accessvdb::io {

enum class ScalarType : std::uint8_t { Int8, Uint8, Int16, Uint16, Int32, Uint32, Int64, Uint64, Float32, Float64 };

constexpr std::size_t scalarBytes(ScalarType type) {
  constexpr std::array<std::size_t, 10> kBytes = {1, 1, 2, 2, 4, 4, 8, 8, 4, 8};
  return kBytes[static_cast<std::size_t>(type)];
}

template <typename T>
[[nodiscard]] T loadScalar(const char* bytes, bool big_endian = false) {
  std::array<char, sizeof(T)> raw;
  std::memcpy(raw.data(), bytes, sizeof(T));
  if (big_endian != (std::endian::native == std::endian::big)) std::reverse(raw.begin(), raw.end());
  return std::bit_cast<T>(raw);
}

[[nodiscard]] inline double loadScalar(const char* bytes, ScalarType type, bool big_endian) {
  switch (type) {
    case ScalarType::Int8:
      return loadScalar<std::int8_t>(bytes, big_endian);
    case ScalarType::Uint8:
      return loadScalar<std::uint8_t>(bytes, big_endian);
    case ScalarType::Int16:
      return loadScalar<std::int16_t>(bytes, big_endian);
    case ScalarType::Uint16:
      return loadScalar<std::uint16_t>(bytes, big_endian);
    case ScalarType::Int32:
      return loadScalar<std::int32_t>(bytes, big_endian);
    case ScalarType::Uint32:
      return loadScalar<std::uint32_t>(bytes, big_endian);
    case ScalarType::Int64:
      return static_cast<double>(loadScalar<std::int64_t>(bytes, big_endian));
    case ScalarType::Uint64:
      return static_cast<double>(loadScalar<std::uint64_t>(bytes, big_endian));
    case ScalarType::Float32:
      return loadScalar<float>(bytes, big_endian);
    case ScalarType::Float64:
      return loadScalar<double>(bytes, big_endian);
  }
  return 0;
}

}  // namespace accessvdb::io

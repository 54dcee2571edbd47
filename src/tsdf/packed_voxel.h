// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One voxel of the authored map in 32 bits: mean distance in 20 bits, weight in 12; 0 = unobserved.
#pragma once

#include <cstddef>
#include <cstdint>

namespace accessvdb::internal {

/// Steps of a distance sample: [clamp_min, tau] in 16 bits. Steps of the stored mean: 16 times finer, 20 bits.
inline constexpr std::uint32_t kSampleSteps = 65535;
inline constexpr std::uint32_t kMeanSteps = kSampleSteps * 16;
inline constexpr std::uint32_t kWeightBits = 12;
inline constexpr std::uint32_t kWeightMask = (1u << kWeightBits) - 1;

constexpr std::uint32_t packVoxel(std::uint32_t mean, std::uint32_t weight) { return mean << kWeightBits | weight; }
constexpr std::uint32_t meanOf(std::uint32_t packed) { return packed >> kWeightBits; }
constexpr std::uint32_t weightOf(std::uint32_t packed) { return packed & kWeightMask; }

/// Value type of the map's tree. A separate type, so that the buffers of leaves come from our pool (leaf_pool.cpp):
/// OpenVDB allocates them with new ValueType[512]. The operators are those that OpenVDB's trees require.
struct PackedVoxel {
  std::uint32_t bits;

  PackedVoxel() = default;  // leaves it uninitialised: buffers are zeroed once, by the code that allocates them
  explicit constexpr PackedVoxel(std::uint32_t b) : bits(b) {}
  explicit constexpr PackedVoxel(int b) : bits(static_cast<std::uint32_t>(b)) {}
  constexpr bool operator==(const PackedVoxel&) const = default;
  constexpr bool operator<(PackedVoxel other) const { return bits < other.bits; }
  constexpr bool operator>(PackedVoxel other) const { return bits > other.bits; }
  constexpr PackedVoxel operator+(PackedVoxel other) const { return PackedVoxel(bits + other.bits); }
  constexpr PackedVoxel operator-(PackedVoxel other) const { return PackedVoxel(bits - other.bits); }
  constexpr PackedVoxel operator-() const { return PackedVoxel(0u - bits); }

  static void* operator new[](std::size_t bytes);
  static void operator delete[](void* buffer) noexcept;
};
static_assert(sizeof(PackedVoxel) == sizeof(std::uint32_t));

/// Whether new PackedVoxel[512] is already zero: fresh pages are, and every buffer is cut from unused ones.
/// Writing zeros again would fetch 2 KB although a scan needs only a few lines.
[[nodiscard]] bool newPackedVoxelsAreZero();

/// Found by OpenVDB's isApproxEqual(), hence the name.
constexpr PackedVoxel Abs(PackedVoxel voxel) { return voxel; }

template <typename Stream>
Stream& operator<<(Stream& stream, PackedVoxel voxel) {
  stream << voxel.bits;
  return stream;
}

}  // namespace accessvdb::internal

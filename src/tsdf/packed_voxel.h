// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A voxel of the authored map (hostdev/packed_mean.h) as a value of its tree.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "hostdev/packed_mean.h"

namespace accessvdb::internal {

using kernels::kMeanSteps, kernels::kSampleSteps, kernels::kWeightBits, kernels::kWeightMask, kernels::meanOf,
    kernels::packVoxel, kernels::weightOf;

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
  /// Also of a compact leaf.
  static void operator delete[](void* buffer) noexcept;
  /// Buffers of leaves that became compact: for leaves to come, or back to the system.
  static void recycle(std::span<void* const> buffers) noexcept;
  /// What the next new PackedVoxel[512] of this thread gives: OpenVDB takes no buffer of others.
  static void giveNext(void* buffer) noexcept;
};
static_assert(sizeof(PackedVoxel) == sizeof(std::uint32_t));

/// Whether new PackedVoxel[512] is already zero: fresh pages are, and every buffer is cut from unused ones,
/// or was zeroed when a leaf gave it back.
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

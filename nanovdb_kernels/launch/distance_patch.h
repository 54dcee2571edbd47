// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Rows of distances of a mirrored leaf, written in place. A LeafPatch selects them: bit n of its mask is pair n of
/// rows, and its words are such pairs of 64 B each.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>

#include "hostdev/nanovdb_compat.h"

namespace accessvdb::kernels {

inline constexpr std::size_t kDistanceMaskBytes = offsetof(DistanceLeaf::DataType, mValueMask);
inline constexpr std::size_t kDistanceValuesBytes = offsetof(DistanceLeaf::DataType, mValues);
inline constexpr std::uint32_t kRowPairVoxels = 16, kRowPairBytes = kRowPairVoxels * sizeof(float);

/// NaN instead of a distance: the voxel is not observed and stays unchanged. Once observed, it stays observed.
inline constexpr float kKeepDistance = std::numeric_limits<float>::quiet_NaN();

/// Writes pair `pair` of a leaf's rows: distances other than NaN become its values, and their voxels active.
/// @param leaf  its bytes    @param distances_m  [16]
inline void setRowPair(std::byte* leaf, int pair, const float* distances_m) noexcept {
  // Both loops compile to a few vector instructions; shifts by n would not.
  static constexpr std::uint32_t kBits[kRowPairVoxels] = {1u << 0,  1u << 1,  1u << 2,  1u << 3, 1u << 4,  1u << 5,
                                                          1u << 6,  1u << 7,  1u << 8,  1u << 9, 1u << 10, 1u << 11,
                                                          1u << 12, 1u << 13, 1u << 14, 1u << 15};
  auto* values = reinterpret_cast<float*>(leaf + kDistanceValuesBytes) + static_cast<int>(kRowPairVoxels) * pair;
  for (std::uint32_t n = 0; n < kRowPairVoxels; ++n) {
    const float before = values[n], after = distances_m[n];
    values[n] = after == after ? after : before;
  }
  std::uint32_t observed = 0;
  for (std::uint32_t n = 0; n < kRowPairVoxels; ++n) {
    observed |= distances_m[n] == distances_m[n] ? kBits[n] : 0u;
  }
  std::uint16_t mask = 0;  // bit n of a value mask is voxel n: pair p has 16 bits of it
  std::memcpy(&mask, leaf + kDistanceMaskBytes + 2 * pair, sizeof(mask));
  mask = static_cast<std::uint16_t>(mask | observed);
  std::memcpy(leaf + kDistanceMaskBytes + 2 * pair, &mask, sizeof(mask));
}

}  // namespace accessvdb::kernels

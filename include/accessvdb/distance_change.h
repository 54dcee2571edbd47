// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// In which rows of one leaf of the map a scan changed distances, and where they stand.
#pragma once

#include <array>
#include <cstdint>

namespace accessvdb {

/// How the map packs a voxel into 32 bits: mean distance in steps, behind it the weight in the low bits.
struct DistanceCode {
  float low_m = 0;   ///< distance of mean 0
  float step_m = 0;  ///< one step
  std::uint32_t weight_bits = 0;

  [[nodiscard]] constexpr bool observed(std::uint32_t packed) const {
    return (packed & ((std::uint32_t{1} << weight_bits) - 1)) != 0;
  }
  [[nodiscard]] constexpr float distance_m(std::uint32_t packed) const {
    return low_m + static_cast<float>(static_cast<std::int32_t>(packed >> weight_bits)) * step_m;
  }
};

/// Two rows along z that lie behind each other, as the map stores and changes them: 16 voxels.
inline constexpr std::uint32_t kVoxelsPerRowPair = 16;

struct DistanceChange {
  std::array<std::int32_t, 3> origin_ijk = {};  ///< least voxel of the leaf, multiples of 8
  std::uint32_t row_pairs = 0;                  ///< bit n: some of voxels 16 n .. 16 n + 15, in the order of LeafBits
  const std::uint32_t* packed = nullptr;        ///< [512] the whole leaf, as it is now; until the map next changes
};

}  // namespace accessvdb

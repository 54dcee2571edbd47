// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The rows of one leaf of the map in which a scan changed distances, and where to read them.
#pragma once

#include <array>
#include <cstdint>

#include "accessvdb/leaf_change.h"

namespace accessvdb {

/// How the map packs a voxel into 32 bits: mean distance in steps in the high bits, weight in the low bits.
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

/// Two rows along z stored one after the other, the unit in which the map stores and changes them: 16 voxels.
inline constexpr std::uint32_t kVoxelsPerRowPair = 16;

struct DistanceChange {
  std::array<std::int32_t, 3> origin_ijk = {};  ///< lowest voxel of the leaf, multiples of 8
  std::uint32_t row_pairs = 0;                  ///< bit n: some of voxels 16 n .. 16 n + 15, in the order of LeafBits
  const std::uint32_t* packed = nullptr;        ///< [512] the whole leaf as it is now; valid until the map next changes
  LeafBits blocked = {};                        ///< voxels whose distance is 0 whatever `packed` says, as it is now
};

}  // namespace accessvdb

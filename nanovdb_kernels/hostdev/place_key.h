// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One number per position in the map, for hash look-ups.
#pragma once

#include <cstdint>

#include "hostdev/views.h"

namespace accessvdb::kernels {

/// 21 bits per axis: more than the leaves within 2^20 voxels in either direction.
ACCESSVDB_HOSTDEV inline std::uint64_t placeKey(std::int32_t x, std::int32_t y, std::int32_t z) {
  constexpr std::uint64_t kAxis = (std::uint64_t{1} << 21) - 1;
  return (static_cast<std::uint64_t>(x) & kAxis) << 42 | (static_cast<std::uint64_t>(y) & kAxis) << 21 |
         (static_cast<std::uint64_t>(z) & kAxis);
}

}  // namespace accessvdb::kernels

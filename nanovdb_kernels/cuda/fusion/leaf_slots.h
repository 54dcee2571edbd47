// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a leaf of the mirrored grid knows of its values on the device. NanoVDB leaves 16 bytes unused in a leaf: the
/// first eight are counts (hostdev/cell_counts.h), the others are these.
#pragma once

#include <cstddef>
#include <cstdint>

#include "hostdev/cell_counts.h"

namespace accessvdb::kernels {

/// Where values and votes of a leaf are. Fresh memory, zero, is a leaf without either.
struct LeafSlots {
  static constexpr std::uint32_t kOnHost = 0xffffffffu;  ///< it has values, which the device does not hold
  std::uint32_t values_plus_one, votes_plus_one;
};
inline constexpr std::size_t kLeafSlotsBytes = kCellCountsBytes + sizeof(std::uint64_t);
static_assert(kLeafSlotsBytes + sizeof(LeafSlots) <= sizeof(OccupancyLeaf::DataType), "NanoVDB: no room in leaves");

}  // namespace accessvdb::kernels

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Walks the bits of a leaf.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>

#include "accessvdb/leaf_change.h"

namespace accessvdb::internal {

/// Calls visit(number of the bit) for each one that is set, in their order.
template <typename Visit>
void forEachBit(const LeafBits& bits, const Visit& visit) {
  for (std::size_t word = 0; word < bits.size(); ++word) {
    for (std::uint64_t left = bits[word]; left != 0; left &= left - 1) {
      visit(64 * word + static_cast<std::size_t>(std::countr_zero(left)));
    }
  }
}

}  // namespace accessvdb::internal

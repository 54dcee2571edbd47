// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A hash of a scan's flips, by which the host's map and the one of a device are compared.
///
/// It is a sum over words, modulo 2^64, so it depends on no order, and each thread may add what it has.
#pragma once

#include <cstdint>

#include "hostdev/mixed_bits.h"

namespace accessvdb::kernels {

/// Words of 64 bits that say what flipped in a leaf: eight each of arm_free_on, collides_on, arm_free_off and
/// collides_off, in this order (as in launch/leaf_patch.h).
inline constexpr std::uint32_t kFlipWords = 32;

/// @param x, y, z  least voxel of the leaf
ACCESSVDB_HOSTDEV constexpr std::uint64_t flipsKey(std::int32_t x, std::int32_t y, std::int32_t z) {
  const std::uint64_t xy = static_cast<std::uint32_t>(x) | std::uint64_t{static_cast<std::uint32_t>(y)} << 32;
  // The constant keeps the leaf at 0 from having the key 0.
  return mixedBits(mixedBits(xy + 0x9e3779b97f4a7c15u) + static_cast<std::uint32_t>(z));
}

/// What one word adds. @param number  of the word, below kFlipWords  @param key  flipsKey() of its leaf
ACCESSVDB_HOSTDEV constexpr std::uint64_t flipsHashOfWord(std::uint64_t word, std::uint32_t number, std::uint64_t key) {
  return word == 0 ? 0 : mixedBits(word ^ (key + number * 0x9e3779b97f4a7c15u));
}

/// What a leaf adds. @tparam Change  as LeafChange, with words of 64 bits
template <typename Change>
ACCESSVDB_HOSTDEV constexpr std::uint64_t flipsHash(const Change& change) {
  const auto& least = change.origin_ijk;
  const std::uint64_t key = flipsKey(least[0], least[1], least[2]);
  std::uint64_t sum = 0;
  for (std::uint32_t n = 0; n < 8; ++n) {
    sum += flipsHashOfWord(change.arm_free_on[n], n, key) + flipsHashOfWord(change.collides_on[n], n + 8, key) +
           flipsHashOfWord(change.arm_free_off[n], n + 16, key) + flipsHashOfWord(change.collides_off[n], n + 24, key);
  }
  return sum;
}

}  // namespace accessvdb::kernels

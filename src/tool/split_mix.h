// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// splitmix64 (public domain, S. Vigna). The standard distributions differ between libraries; this does not.
#pragma once

#include <cstdint>

namespace accessvdb::internal {

/// Its finaliser: every bit of the argument changes about half of the bits.
constexpr std::uint64_t mixedBits(std::uint64_t x) {
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

struct SplitMix {
  std::uint64_t state;

  double uniform() {  ///< [0, 1), 53 bits
    return static_cast<double>(mixedBits(state += 0x9e3779b97f4a7c15u) >> 11) * 0x1p-53;
  }
};

}  // namespace accessvdb::internal

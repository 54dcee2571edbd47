// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Packs bytes of 0 or 1, which loops write fast, into bits.
#pragma once

#include <cstdint>

namespace accessvdb::internal {

/// Bit n of the lowest eight equals byte n, which is 0 or 1.
inline std::uint64_t bitsOfBytes(const std::uint8_t* bytes) {
  std::uint64_t all = 0;
  for (int n = 0; n < 8; ++n) all |= std::uint64_t{bytes[n]} << (8 * n);
  return all * 0x0102040810204080u >> 56;  // byte n is multiplied by 2^(56 - 7 n), and no two products share a bit
}

}  // namespace accessvdb::internal

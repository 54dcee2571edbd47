// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The finaliser of splitmix64 (public domain, S. Vigna).
#pragma once

#include <cstdint>

#include "hostdev/nanovdb_compat.h"

namespace accessvdb::kernels {

/// Every bit of the argument changes about half of the bits. No two arguments have the same result; that of 0 is 0.
ACCESSVDB_HOSTDEV constexpr std::uint64_t mixedBits(std::uint64_t x) {
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

}  // namespace accessvdb::kernels

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// splitmix64 (public domain, S. Vigna). The standard distributions differ between libraries; this does not.
#pragma once

#include <cstdint>

#include "hostdev/mixed_bits.h"

namespace accessvdb::internal {

struct SplitMix {
  std::uint64_t state;

  double uniform() {  ///< [0, 1), 53 bits
    return static_cast<double>(kernels::mixedBits(state += 0x9e3779b97f4a7c15u) >> 11) * 0x1p-53;
  }
};

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One voxel of the authored map in 32 bits: mean distance in 20 bits, weight in 12; 0 = unobserved.
#pragma once

#include <cstdint>

#include "hostdev/nanovdb_compat.h"

namespace accessvdb::kernels {

/// Steps of a distance sample: [clamp_min, tau] in 16 bits. Steps of the stored mean: 16 times finer, 20 bits.
inline constexpr std::uint32_t kSampleSteps = 65535;
inline constexpr std::uint32_t kMeanSteps = kSampleSteps * 16;
inline constexpr std::uint32_t kWeightBits = 12;
inline constexpr std::uint32_t kWeightMask = (1u << kWeightBits) - 1;

ACCESSVDB_HOSTDEV constexpr std::uint32_t packVoxel(std::uint32_t mean, std::uint32_t weight) {
  return mean << kWeightBits | weight;
}
ACCESSVDB_HOSTDEV constexpr std::uint32_t meanOf(std::uint32_t packed) { return packed >> kWeightBits; }
ACCESSVDB_HOSTDEV constexpr std::uint32_t weightOf(std::uint32_t packed) { return packed & kWeightMask; }

}  // namespace accessvdb::kernels

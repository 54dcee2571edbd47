// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Helpers for the lanes of a warp.
#pragma once

namespace accessvdb::kernels {

inline constexpr unsigned kWarp = 32, kAllLanes = 0xffffffffu;

#if defined(__CUDACC__)
/// Sum of the values of the lanes up to this one. All lanes call it.
template <typename T>
__device__ inline T sumUpTo(T value, int lane) {
  for (int step = 1; step < static_cast<int>(kWarp); step *= 2) {
    const T below = __shfl_up_sync(kAllLanes, value, step);
    if (lane >= step) value += below;
  }
  return value;
}
#endif

}  // namespace accessvdb::kernels

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The masks of one group while a warp finds them.
#pragma once

#include <cstdint>

#include "cuda/search/warp.cuh"
#include "cuda/update/known_collisions.cuh"
#include "hostdev/due_rule.h"

namespace accessvdb::kernels {

/// The masks of a group, spread over a warp to save registers: lane n holds the n-th 32 bits of a GroupMasks.
class MasksOfWarp {
 public:
  enum Mask : int { kBetterTool, kBetterArm, kWorseTool, kWorseArm };  ///< in the order of GroupMasks

  explicit __device__ MasksOfWarp(int lane) : lane_(lane) {}

  /// Each lane adds directions to one mask, two or none. All lanes call it.
  __device__ void add(Mask better, bool is_better, Mask worse, bool is_worse, const DirectionMask& directions) {
    if (!__any_sync(kAllLanes, is_better || is_worse)) return;
#pragma unroll
    for (int n = 0; n < kDirectionWords32; ++n) {
      std::uint32_t some = 0;
      if (is_better || is_worse) some = static_cast<std::uint32_t>(directions.word[n / 2] >> (32 * (n & 1)));
      const std::uint32_t all_better = __reduce_or_sync(kAllLanes, is_better ? some : 0u);
      const std::uint32_t all_worse = __reduce_or_sync(kAllLanes, is_worse ? some : 0u);
      if (lane_ == better * kDirectionWords32 + n) bits_ |= all_better;
      if (lane_ == worse * kDirectionWords32 + n) bits_ |= all_worse;
    }
  }
  /// Each lane adds its own directions to two masks. All lanes call it. @param is_any  whether this lane has any
  __device__ void add(Mask better, const DirectionMask& for_better, Mask worse, const DirectionMask& for_worse,
                      bool is_any) {
    if (!__any_sync(kAllLanes, is_any)) return;
#pragma unroll
    for (int n = 0; n < kDirectionWords32; ++n) {
      const auto wordOf = [n](const DirectionMask& mask) {
        return static_cast<std::uint32_t>(mask.word[n / 2] >> (32 * (n & 1)));
      };
      const std::uint32_t all_better = __reduce_or_sync(kAllLanes, wordOf(for_better));
      const std::uint32_t all_worse = __reduce_or_sync(kAllLanes, wordOf(for_worse));
      if (lane_ == better * kDirectionWords32 + n) bits_ |= all_better;
      if (lane_ == worse * kDirectionWords32 + n) bits_ |= all_worse;
    }
  }
  /// @return word n of a mask. All lanes call it, each with its own n
  [[nodiscard]] __device__ std::uint32_t word(Mask mask, int n) const {
    return __shfl_sync(kAllLanes, bits_, mask * kDirectionWords32 + n);
  }
  /// Leaves only these in the better masks. All lanes call it.
  __device__ void limitBetter(const Improvable& improvable) {
    std::uint32_t arm = 0;  // word lane_ % kDirectionWords32
#pragma unroll
    for (int byte = 0; byte < 4; ++byte) {
      arm |= __shfl_sync(kAllLanes, improvable.arm, (4 * lane_ + byte) & 31) << (8 * byte);
    }
    if (lane_ / kDirectionWords32 == kBetterTool) bits_ &= improvable.tool;
    if (lane_ / kDirectionWords32 == kBetterArm) bits_ &= arm;
  }
  /// Whether the first `masks` of them hold any direction. All lanes call it.
  [[nodiscard]] __device__ bool any(int masks) const {
    return __any_sync(kAllLanes, bits_ != 0 && lane_ < masks * kDirectionWords32) != 0;
  }
  /// Whether a mask holds any direction. All lanes call it.
  [[nodiscard]] __device__ bool any(Mask mask) const {
    return __any_sync(kAllLanes, bits_ != 0 && lane_ / kDirectionWords32 == mask) != 0;
  }
  /// All lanes.
  __device__ void store(GroupMasks& masks) const {
    static_assert(sizeof(GroupMasks) == kWarp * sizeof(std::uint32_t));
    reinterpret_cast<std::uint32_t*>(&masks)[lane_] = bits_;
  }

 private:
  int lane_;
  std::uint32_t bits_ = 0;
};

}  // namespace accessvdb::kernels

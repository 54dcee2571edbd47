// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The flips of an update on the device: by place, and what they mean for groups of blocks.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <span>

#include "cuda/memory/staging.h"
#include "cuda/update/device_counters.h"
#include "cuda/update/update_views.cuh"
#include "launch/device_array.h"

namespace accessvdb::kernels {

class FlipTables {
 public:
  explicit FlipTables(DeviceMemory& memory) : memory_(memory) {}

  /// Finds which directions they may have changed for the points of each group, and ages what is known of them. Waits
  /// for the device, and returns while it is still at work.
  /// @param view  in: groups, index, footprint, covering, known; out: flips, masks, and affected, which is null without
  /// flips
  void take(std::span<const std::span<const LeafFlips>> flips, UpdateView& view, DeviceCounters& counters,
            cudaStream_t stream);
  /// Groups that came since take(): nothing is known of their points that flips could change.
  void addGroups(UpdateView& view, cudaStream_t stream);

 private:
  DeviceMemory& memory_;
  Staging<LeafFlips> list_;
  DeviceArray<std::uint64_t> keys_, occupied_, kinds_;
  DeviceArray<std::uint32_t> heads_, next_, tiles_;
  DeviceArray<GroupMasks> masks_;
  DeviceArray<std::uint8_t> affected_;
  std::uint32_t masked_groups_ = 0;
};

}  // namespace accessvdb::kernels

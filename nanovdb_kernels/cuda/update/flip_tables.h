// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The flips of an update on the device: by place, and what they mean for groups of blocks.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

#include "cuda/memory/staging.h"
#include "cuda/update/device_counters.h"
#include "cuda/update/update_kernels.h"
#include "launch/device_array.h"

namespace accessvdb::kernels {

class FlipTables {
 public:
  explicit FlipTables(DeviceMemory& memory) : memory_(memory) {}

  /// Directions that the flips may have changed for the points of each group. Empty if there were no flips.
  [[nodiscard]] const GroupMasksView& masks() const { return view_; }

  /// Finds those directions, and ages what is known about them. Waits for the device, but returns before it is done.
  void take(FlipLists flips, const FlipContext& context, DeviceCounters& counters, cudaStream_t stream);
  /// Adds groups that are new since take(): nothing is known about their points that flips could change.
  void addGroups(std::uint32_t groups, cudaStream_t stream);

 private:
  DeviceMemory& memory_;
  GroupMasksView view_;
  Staging<LeafFlips> list_;
  DeviceArray<std::uint64_t> keys_, occupied_, kinds_;
  DeviceArray<std::uint32_t> heads_, next_, tiles_;
  DeviceArray<GroupMasks> masks_;
  DeviceArray<std::uint8_t> affected_;
  std::uint32_t masked_groups_ = 0;
};

}  // namespace accessvdb::kernels

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The flips of an update on the device, by place: the same for all tools.
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

  /// Takes the flips, of which there is at least one. Waits for the device, but returns before it is done.
  /// @return valid for work queued before the next call
  [[nodiscard]] FlipsView take(const FlipLists& flips, DeviceCounters& counters, cudaStream_t stream);

 private:
  DeviceMemory& memory_;
  Staging<LeafFlips> list_;
  Staging<std::uint16_t> voxels_;
  DeviceArray<std::uint32_t> by_layer_, layer_begin_;
  DeviceArray<std::uint64_t> keys_, occupied_, kinds_;
  DeviceArray<std::uint32_t> heads_, arm_heads_, tiles_;
  DeviceArray<FlipLink> links_, arm_links_;
};

}  // namespace accessvdb::kernels

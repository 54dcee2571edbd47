// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Counters that the kernels of an update add to.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstring>

#include "accessvdb/error.h"
#include "cuda/memory/cuda_check.h"
#include "cuda/memory/growing.h"
#include "cuda/memory/pinned_buffer.h"
#include "cuda/update/update_views.cuh"
#include "launch/device_array.h"

namespace accessvdb::kernels {

/// @throw InternalError  some neighbours were not found
inline void requireNeighbours(const MovedCounters& counters) {
  if (counters.failed == 0) return;
  throw InternalError("update.neighbours", "cuda", "more points at the same distance than the search has room for",
                      "Please report this, and use BackendKind::Cpu");
}

class DeviceCounters {
 public:
  DeviceCounters(DeviceMemory& memory, cudaStream_t stream) : on_device_(memory, 1) {
    on_host_.reserve(sizeof(UpdateCounters));
    clear(stream);
  }

  [[nodiscard]] UpdateCounters* data() const { return on_device_.data(); }
  void clear(cudaStream_t stream) { fillBytes(data(), 0, sizeof(UpdateCounters), stream); }
  /// Waits for the device.
  [[nodiscard]] UpdateCounters read(cudaStream_t stream) {
    ACCESSVDB_CUDA(cudaMemcpyAsync(on_host_.data(), data(), sizeof(UpdateCounters), cudaMemcpyDeviceToHost, stream));
    ACCESSVDB_CUDA(cudaStreamSynchronize(stream));
    UpdateCounters counters;
    std::memcpy(&counters, on_host_.data(), sizeof(counters));
    return counters;
  }

 private:
  DeviceArray<UpdateCounters> on_device_;
  PinnedBuffer on_host_;
};

}  // namespace accessvdb::kernels

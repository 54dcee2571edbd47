// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Counters that kernels add to, and that the host reads.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstring>
#include <type_traits>

#include "cuda/memory/cuda_check.h"
#include "cuda/memory/growing.h"
#include "cuda/memory/pinned_buffer.h"
#include "launch/device_array.h"

namespace accessvdb::kernels {

template <typename Counters>
class CountersOnDevice {
  static_assert(std::is_trivially_copyable_v<Counters>);

 public:
  CountersOnDevice(DeviceMemory& memory, cudaStream_t stream) : on_device_(memory, 1) {
    on_host_.reserve(sizeof(Counters));
    clear(stream);
  }

  [[nodiscard]] Counters* data() const { return on_device_.data(); }
  void clear(cudaStream_t stream) { fillBytes(data(), 0, sizeof(Counters), stream); }
  /// Waits for the device.
  [[nodiscard]] Counters read(cudaStream_t stream) {
    ACCESSVDB_CUDA(cudaMemcpyAsync(on_host_.data(), data(), sizeof(Counters), cudaMemcpyDeviceToHost, stream));
    ACCESSVDB_CUDA(cudaStreamSynchronize(stream));
    Counters counters;
    std::memcpy(&counters, on_host_.data(), sizeof(counters));
    return counters;
  }

 private:
  DeviceArray<Counters> on_device_;
  PinnedBuffer on_host_;
};

}  // namespace accessvdb::kernels

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A list on its way to the device, through pinned memory; the host does not wait.
#pragma once

#include <cuda_runtime_api.h>

#include <cstring>
#include <span>

#include "cuda/cuda_check.h"
#include "cuda/pinned_buffer.h"
#include "launch/device_array.h"

namespace accessvdb::kernels {

template <typename T>
class Staging {
 public:
  Staging() { ACCESSVDB_CUDA(cudaEventCreateWithFlags(&sent_, cudaEventDisableTiming)); }
  ~Staging() { (void)cudaEventDestroy(sent_); }
  Staging(const Staging&) = delete;
  Staging& operator=(const Staging&) = delete;

  /// @return the list on the device, valid for what is queued on the stream before the next send
  T* send(std::span<const T> list, DeviceMemory& memory, cudaStream_t stream) {
    if (list.empty()) return device_.data();
    ACCESSVDB_CUDA(cudaEventSynchronize(sent_));  // the last one has left the pinned memory
    host_.reserve(list.size_bytes());
    // What still reads the old list is done when its memory is given back: the driver waits for it.
    device_.growWithRoom(memory, list.size(), list.size() + list.size() / 2, 0);
    std::memcpy(host_.data(), list.data(), list.size_bytes());
    ACCESSVDB_CUDA(cudaMemcpyAsync(device_.data(), host_.data(), list.size_bytes(), cudaMemcpyHostToDevice, stream));
    ACCESSVDB_CUDA(cudaEventRecord(sent_, stream));
    return device_.data();
  }
  [[nodiscard]] std::size_t bytes() const { return device_.bytes(); }

 private:
  cudaEvent_t sent_ = nullptr;
  PinnedBuffer host_;
  DeviceArray<T> device_;
};

}  // namespace accessvdb::kernels

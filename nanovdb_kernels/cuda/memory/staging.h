// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Sends lists to the device through pinned memory; the host does not wait.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstring>
#include <span>

#include "cuda/memory/cuda_check.h"
#include "cuda/memory/device_list.h"
#include "cuda/memory/pinned_buffer.h"
#include "launch/device_array.h"
#include "launch/lists.h"

namespace accessvdb::kernels {

template <typename T>
class Staging {
 public:
  Staging() { ACCESSVDB_CUDA(cudaEventCreateWithFlags(&sent_, cudaEventDisableTiming)); }
  ~Staging() { (void)cudaEventDestroy(sent_); }
  Staging(const Staging&) = delete;
  Staging& operator=(const Staging&) = delete;

  /// @return the device list, valid for work queued on the stream before the next send
  DeviceList<T> send(std::span<const T> list, DeviceMemory& memory, cudaStream_t stream) {
    return send(std::span(&list, 1), memory, stream);
  }
  /// The same for several lists, concatenated.
  DeviceList<T> send(std::span<const std::span<const T>> lists, DeviceMemory& memory, cudaStream_t stream) {
    const std::size_t size = totalSize(lists);
    if (size == 0) return {device_.data(), 0};
    ACCESSVDB_CUDA(cudaEventSynchronize(sent_));  // the previous list has left pinned memory
    host_.reserve(size * sizeof(T));
    // Kernels may still read the old array: the driver waits for them before it frees the memory.
    device_.growWithRoom(memory, size, size + size / 2, 0);
    auto* to = static_cast<std::byte*>(host_.data());
    for (const std::span<const T>& list : lists) {
      if (!list.empty()) std::memcpy(to, list.data(), list.size_bytes());
      to += list.size_bytes();
    }
    ACCESSVDB_CUDA(cudaMemcpyAsync(device_.data(), host_.data(), size * sizeof(T), cudaMemcpyHostToDevice, stream));
    ACCESSVDB_CUDA(cudaEventRecord(sent_, stream));
    return {device_.data(), static_cast<std::uint32_t>(size)};
  }

 private:
  cudaEvent_t sent_ = nullptr;
  PinnedBuffer host_;
  DeviceArray<T> device_;
};

}  // namespace accessvdb::kernels

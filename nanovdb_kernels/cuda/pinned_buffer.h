// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Host memory that the device can copy from and to by itself. Only grows; what it held is lost when it does.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>

#include "cuda/cuda_check.h"

namespace accessvdb::kernels {

class PinnedBuffer {
 public:
  PinnedBuffer() = default;
  ~PinnedBuffer() { reset(); }
  PinnedBuffer(const PinnedBuffer&) = delete;
  PinnedBuffer& operator=(const PinnedBuffer&) = delete;

  [[nodiscard]] std::byte* data() const { return data_; }
  [[nodiscard]] std::size_t size() const { return size_; }

  /// @throw ResourceLimit  no memory that can be pinned
  void reserve(std::size_t bytes) {
    if (bytes <= size_) return;
    reset();
    void* address = nullptr;
    const std::size_t wanted = bytes + bytes / 2;
    if (const cudaError_t status = cudaHostAlloc(&address, wanted, cudaHostAllocDefault); status != cudaSuccess) {
      (void)cudaGetLastError();
      if (status != cudaErrorMemoryAllocation) checkCuda(status, "cudaHostAlloc");
      throw ResourceLimit("memory.pinned", "cuda", "no host memory left for transfers to the GPU",
                          "Free memory, or use --device cpu");
    }
    data_ = static_cast<std::byte*>(address);
    size_ = wanted;
  }

 private:
  void reset() noexcept {
    if (data_ != nullptr && cudaFreeHost(data_) != cudaSuccess) (void)cudaGetLastError();
    data_ = nullptr;
    size_ = 0;
  }
  std::byte* data_ = nullptr;
  std::size_t size_ = 0;
};

}  // namespace accessvdb::kernels

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Pinned host memory, which the device copies to and from directly. Only grows; growing discards its contents.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>

#include "cuda/memory/cuda_check.h"

namespace accessvdb::kernels {

class PinnedBuffer {
 public:
  PinnedBuffer() = default;
  ~PinnedBuffer() { reset(); }
  PinnedBuffer(const PinnedBuffer&) = delete;
  PinnedBuffer& operator=(const PinnedBuffer&) = delete;

  [[nodiscard]] std::byte* data() const { return data_; }
  [[nodiscard]] std::size_t size() const { return size_; }

  /// Reserves half as much again so that it rarely grows, or just `bytes` if memory is short.
  /// @throw ResourceLimit  no memory left to pin
  void reserve(std::size_t bytes) {
    if (bytes <= size_) return;
    reset();
    if (!allocate(bytes + bytes / 2)) reserveExactly(bytes);
  }
  /// @throw ResourceLimit  no memory left to pin
  void reserveExactly(std::size_t bytes) {
    if (bytes <= size_) return;
    reset();
    if (!allocate(bytes)) {
      throw ResourceLimit("memory.pinned", "cuda", "no host memory left for transfers to the GPU",
                          "Free memory, or use BackendKind::Cpu");
    }
  }

 private:
  /// @return false if there is no memory
  bool allocate(std::size_t bytes) {
    void* address = nullptr;
    if (const cudaError_t status = cudaHostAlloc(&address, bytes, cudaHostAllocDefault); status != cudaSuccess) {
      (void)cudaGetLastError();
      if (status != cudaErrorMemoryAllocation) checkCuda(status, "cudaHostAlloc");
      return false;
    }
    data_ = static_cast<std::byte*>(address);
    size_ = bytes;
    return true;
  }
  void reset() noexcept {
    if (data_ != nullptr && cudaFreeHost(data_) != cudaSuccess) (void)cudaGetLastError();
    data_ = nullptr;
    size_ = 0;
  }
  std::byte* data_ = nullptr;
  std::size_t size_ = 0;
};

}  // namespace accessvdb::kernels

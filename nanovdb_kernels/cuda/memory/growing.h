// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How the arrays of an update grow, and how new elements are initialised.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>

#include "cuda/memory/cuda_check.h"
#include "launch/device_array.h"

namespace accessvdb::kernels {

/// A quarter more than requested, so that arrays rarely grow.
inline std::size_t roomFor(std::size_t size) { return size + size / 4 + 4096; }

inline void fillBytes(void* to, int byte, std::size_t bytes, cudaStream_t stream) {
  if (bytes > 0) ACCESSVDB_CUDA(cudaMemsetAsync(to, byte, bytes, stream));
}

/// Grows an array, keeps its contents and fills the new part.
template <typename T>
void growFilled(DeviceArray<T>& array, DeviceMemory& memory, std::size_t size, int byte, cudaStream_t stream) {
  if (size <= array.size()) return;
  const std::size_t before = array.size();
  array.growWithRoom(memory, size, roomFor(size), before);
  fillBytes(array.data() + before, byte, (array.size() - before) * sizeof(T), stream);
}

}  // namespace accessvdb::kernels

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How arrays of an update grow, and what is in them at first.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>

#include "cuda/cuda_check.h"

namespace accessvdb::kernels {

/// A quarter more than asked for, so that arrays grow seldom.
inline std::size_t roomFor(std::size_t size) { return size + size / 4 + 4096; }

inline void fillBytes(void* to, int byte, std::size_t bytes, cudaStream_t stream) {
  if (bytes > 0) ACCESSVDB_CUDA(cudaMemsetAsync(to, byte, bytes, stream));
}

}  // namespace accessvdb::kernels

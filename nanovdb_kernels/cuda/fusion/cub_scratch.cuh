// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Memory for CUB's algorithms, which say how much they need when they are called without any.
#pragma once

#include <cstddef>

#include "cuda/fusion/fusion_views.h"
#include "cuda/memory/cuda_check.h"
#include "cuda/memory/growing.h"

namespace accessvdb::kernels {

/// @param run  (memory, bytes) -> cudaError_t
template <typename Run>
void withScratch(CubScratch& scratch, const Run& run) {
  std::size_t bytes = 0;
  ACCESSVDB_CUDA(run(nullptr, bytes));
  scratch.bytes.growWithRoom(scratch.memory, bytes, roomFor(bytes), 0);
  ACCESSVDB_CUDA(run(scratch.bytes.data(), bytes));
}

}  // namespace accessvdb::kernels

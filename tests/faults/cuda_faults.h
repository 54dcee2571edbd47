// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Makes calls of the CUDA runtime fail when a test says so. Every such call of a program that is linked with
/// cuda_faults.cpp goes through here first (the linker's --wrap), whichever runtime answers it then: the real one on a
/// GPU, or fake_cudart.cpp. The product itself knows nothing of it.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <string>

namespace accessvdb::test {

/// What is to fail.
struct CudaFault {
  cudaError_t error = cudaSuccess;  ///< cudaSuccess: nothing
  std::uint64_t nth = 0;            ///< the nth call from now that `call` names, from 1
  std::string call;                 ///< for example "cudaMalloc"; empty = any
  bool lost = false;                ///< from then on every call fails, as after a sticky error
};

void setFault(const CudaFault& fault);
/// True once the fault was met.
[[nodiscard]] bool faultMet();
/// Its call.
[[nodiscard]] std::string faultyCall();

/// Calls since setFault(), those that can fail.
[[nodiscard]] std::uint64_t callsMade();

/// What is held at the moment: pieces of memory, streams, events, address ranges.
struct CudaObjects {
  std::int64_t memory = 0, pinned = 0, streams = 0, events = 0, ranges = 0, mapped = 0;
  bool operator==(const CudaObjects&) const = default;
};
[[nodiscard]] CudaObjects cudaObjects();
[[nodiscard]] std::string inWords(const CudaObjects& objects);

}  // namespace accessvdb::test

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Makes calls of the CUDA runtime fail when a test requests it. Every such call of a program linked with
/// cuda_faults.cpp goes through here first (the linker's --wrap), whichever runtime then answers it: the real one on a
/// GPU, or fake_cudart.cpp. The product itself knows nothing about it.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <string>

namespace accessvdb::test {

/// Which call has to fail.
struct CudaFault {
  cudaError_t error = cudaSuccess;  ///< cudaSuccess: nothing
  std::uint64_t nth = 0;            ///< the nth call from now that `call` names, from 1
  std::string call;                 ///< for example "cudaMalloc"; empty = any
  bool lost = false;                ///< every later call fails too, as after a sticky error
};

void setFault(const CudaFault& fault);
/// Whether the fault has occurred.
[[nodiscard]] bool faultMet();
/// The call that failed.
[[nodiscard]] std::string faultyCall();

/// Number of calls since setFault() that can fail.
[[nodiscard]] std::uint64_t callsMade();

/// What is currently held: pieces of memory, streams, events, address ranges.
struct CudaObjects {
  std::int64_t memory = 0, pinned = 0, streams = 0, events = 0, ranges = 0, mapped = 0;
  bool operator==(const CudaObjects&) const = default;
};
[[nodiscard]] CudaObjects cudaObjects();
[[nodiscard]] std::string inWords(const CudaObjects& objects);

}  // namespace accessvdb::test

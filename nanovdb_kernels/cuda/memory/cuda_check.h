// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Every call of the CUDA runtime goes through here: a failure is an exception that names the call, never an exit,
/// never ignored.
#pragma once

#include <cuda_runtime_api.h>

#include <string>

#include "accessvdb/error.h"

namespace accessvdb::kernels {

/// No memory left on the device. A caller that can do with less may try again.
[[noreturn]] inline void throwDeviceMemory(const std::string& what) {
  throw ResourceLimit("memory.device", "cuda", what,
                      "Use a larger voxel size, free the GPU of other work, or --device cpu");
}

/// @throw ResourceLimit  no device memory; the device can still be used
/// @throw DeviceError    anything else: most of these leave the context unusable
inline void checkCuda(cudaError_t status, const char* call) {
  if (status == cudaSuccess) return;
  (void)cudaGetLastError();  // the error is reported here, not by the next call
  if (status == cudaErrorMemoryAllocation) throwDeviceMemory(std::string("no device memory left (") + call + ")");
  throw DeviceError("device.failed", "cuda",
                    std::string(call) + " failed: " + cudaGetErrorName(status) + ", " + cudaGetErrorString(status),
                    "Check the GPU (nvidia-smi), or use --device cpu");
}

/// Launch errors of the kernel before.
inline void checkLaunch(const char* kernel) { checkCuda(cudaGetLastError(), kernel); }

#define ACCESSVDB_CUDA(call) ::accessvdb::kernels::checkCuda((call), #call)

}  // namespace accessvdb::kernels

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Every CUDA runtime call goes through here. A failure throws an exception that names the call: it never exits and is
/// never ignored.
#pragma once

#include <cuda_runtime_api.h>

#include <string>

#include "accessvdb/error.h"

namespace accessvdb::kernels {

/// Reports that device memory ran out. A caller that can manage with less may retry.
[[noreturn]] inline void throwDeviceMemory(const std::string& what) {
  throw ResourceLimit("memory.device", "cuda", what,
                      "Use a larger voxel size, free the GPU of other work, or BackendKind::Cpu");
}

/// @throw ResourceLimit  out of device memory; the device is still usable
/// @throw DeviceError    anything else; most of these leave the context unusable
inline void checkCuda(cudaError_t status, const char* call) {
  if (status == cudaSuccess) return;
  (void)cudaGetLastError();  // the error is reported here, not by the next call
  if (status == cudaErrorMemoryAllocation) throwDeviceMemory(std::string("no device memory left (") + call + ")");
  throw DeviceError("device.failed", "cuda",
                    std::string(call) + " failed: " + cudaGetErrorName(status) + ", " + cudaGetErrorString(status),
                    "Check the GPU (nvidia-smi), or use BackendKind::Cpu");
}

/// Reports launch errors of the preceding kernel.
inline void checkLaunch(const char* kernel) { checkCuda(cudaGetLastError(), kernel); }

#define ACCESSVDB_CUDA(call) ::accessvdb::kernels::checkCuda((call), #call)

}  // namespace accessvdb::kernels

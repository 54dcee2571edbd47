// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/backend_choice.h"

namespace accessvdb::internal {

bool isOfDevice(const Error& error) {
  return error.code() == ErrorCode::Device || (error.code() == ErrorCode::Resource && error.subject() == "cuda");
}

ChosenBackend cudaBackend() {
#ifdef ACCESSVDB_HAS_CUDA
  return {kernels::makeCudaBackend(), "", ""};
#else
  throw DeviceError("device.not_built", "cuda", "this build has no CUDA backend", "Use BackendKind::Cpu");
#endif
}

ChosenBackend cpuBackend() { return {kernels::makeCpuBackend(), "", ""}; }

}  // namespace accessvdb::internal

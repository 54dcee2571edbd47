// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/backend_choice.h"

#include "accessvdb/error.h"

namespace accessvdb::internal {
namespace {

std::unique_ptr<kernels::Backend> makeCuda() {
#ifdef ACCESSVDB_HAS_CUDA
  return kernels::makeCudaBackend();
#else
  throw DeviceError("device.missing", "cuda", "this build has no CUDA backend", "Use --device cpu");
#endif
}

}  // namespace

ChosenBackend chooseBackend(BackendKind kind) {
  if (kind == BackendKind::Cuda) return {makeCuda(), ""};
  if (kind == BackendKind::Cpu) return {kernels::makeCpuBackend(), ""};
  try {
    return {makeCuda(), ""};
  } catch (const DeviceError& error) {
    return {kernels::makeCpuBackend(), error.problem()};
  }
}

}  // namespace accessvdb::internal

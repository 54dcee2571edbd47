// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The kernel. Only this file needs nvcc, and it needs only device_view.h from AccessVDB.
#include "own_kernel/wrist_check.h"

#include <cuda_runtime.h>

#include <stdexcept>

namespace {

__global__ void judgeAll(accessvdb::DeviceView view, unsigned char* verdicts) {
  const std::uint32_t id = blockIdx.x * blockDim.x + threadIdx.x;
  if (id < view.points.count) verdicts[id] = judge(view, id);
}

void check(cudaError_t status) {
  if (status != cudaSuccess) throw std::runtime_error(cudaGetErrorString(status));
}

}  // namespace

std::vector<unsigned char> judgeOnGpu(const accessvdb::DeviceView& view) {
  std::vector<unsigned char> verdicts(view.points.count);
  if (verdicts.empty()) return verdicts;
  cudaStream_t stream = nullptr;  // any stream will do: the view is complete
  check(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking));
  unsigned char* d_verdicts = nullptr;
  check(cudaMalloc(&d_verdicts, verdicts.size()));
  judgeAll<<<(view.points.count + 127) / 128, 128, 0, stream>>>(view, d_verdicts);
  check(cudaGetLastError());
  check(cudaMemcpyAsync(verdicts.data(), d_verdicts, verdicts.size(), cudaMemcpyDeviceToHost, stream));
  check(cudaStreamSynchronize(stream));  // before the field changes again
  check(cudaFree(d_verdicts));
  check(cudaStreamDestroy(stream));
  return verdicts;
}

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "parity/view_reads.h"

#include <stdexcept>

namespace accessvdb::test {
namespace {

__global__ void ask(DeviceView view, const ViewQuestion* questions, ViewAnswer* answers, std::size_t count) {
  const std::size_t n = blockIdx.x * std::size_t(blockDim.x) + threadIdx.x;
  if (n >= count) return;
  answers[n].at_a = view.occupancyAt(questions[n].a_W);
  answers[n].distance_m = view.distanceAt(questions[n].a_W);
  answers[n].interpolated_m = view.distanceInterpolatedAt(questions[n].a_W);
  answers[n].along = view.along(questions[n].a_W, questions[n].b_W, questions[n].radius_m);
}

}  // namespace

std::vector<ViewAnswer> askOnDevice(kernels::DeviceMemory& memory, const DeviceView& view,
                                    const std::vector<ViewQuestion>& questions) {
  kernels::DeviceArray<ViewQuestion> d_questions(memory, questions.size());
  d_questions.upload(questions.data(), questions.size());
  kernels::DeviceArray<ViewAnswer> d_answers(memory, questions.size());
  cudaStream_t stream = nullptr;
  if (cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking) != cudaSuccess) throw std::runtime_error("no stream");
  ask<<<static_cast<unsigned>((questions.size() + 127) / 128), 128, 0, stream>>>(view, d_questions.data(),
                                                                                 d_answers.data(), questions.size());
  if (cudaStreamSynchronize(stream) != cudaSuccess) throw std::runtime_error("asking the view on the device failed");
  (void)cudaStreamDestroy(stream);
  std::vector<ViewAnswer> answers(questions.size());
  memory.download(answers.data(), d_answers.data(), answers.size() * sizeof(ViewAnswer));
  return answers;
}

}  // namespace accessvdb::test

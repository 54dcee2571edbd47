// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "parity/view_reads.h"

#include <cstddef>
#include <stdexcept>

#include "cuda/fusion/leaf_slots.h"
#include "hostdev/position_voxel.h"

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

__global__ void swapValues(DeviceView view, const ViewQuestion* positions, std::uint32_t* swapped, std::size_t count) {
  if (blockIdx.x != 0 || threadIdx.x != 0) return;
  kernels::LeafSlots* before = nullptr;
  for (std::size_t n = 0; n < count; ++n) {
    double p_L[3];
    for (int axis = 0; axis < 3; ++axis) p_L[axis] = positions[n].a_W[axis] - view.origin_W[axis];
    const auto ijk = kernels::voxelOfPosition(p_L, static_cast<double>(view.map.inverse_voxel_size));
    const auto* const leaf = view.map.grid->tree().root().probeLeaf(nanovdb::Coord(ijk[0], ijk[1], ijk[2]));
    if (leaf == nullptr) continue;
    auto* const bytes = reinterpret_cast<std::byte*>(const_cast<void*>(static_cast<const void*>(leaf)));
    auto* const slots = reinterpret_cast<kernels::LeafSlots*>(bytes + kernels::kLeafSlotsBytes);
    if (slots->values_plus_one == 0 || slots->values_plus_one == kernels::LeafSlots::kOnHost || slots == before)
      continue;
    if (before == nullptr) {
      before = slots;
      continue;
    }
    const std::uint32_t of_one = slots->values_plus_one;
    slots->values_plus_one = before->values_plus_one;
    before->values_plus_one = of_one;
    before = nullptr;
    *swapped += 2;
  }
}

}  // namespace

std::uint32_t swapValuesOnDevice(kernels::DeviceMemory& memory, const DeviceView& view,
                                 const std::vector<ViewQuestion>& positions) {
  kernels::DeviceArray<ViewQuestion> d_positions(memory, positions.size());
  d_positions.upload(positions.data(), positions.size());
  kernels::DeviceArray<std::uint32_t> d_swapped(memory, 1);
  std::uint32_t swapped = 0;
  d_swapped.upload(&swapped, 1);
  swapValues<<<1, 1>>>(view, d_positions.data(), d_swapped.data(), positions.size());
  if (cudaDeviceSynchronize() != cudaSuccess) throw std::runtime_error("swapping values on the device failed");
  memory.download(&swapped, d_swapped.data(), sizeof swapped);
  return swapped;
}

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

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <thrust/iterator/counting_iterator.h>

#include <cstring>
#include <cub/device/device_select.cuh>
#include <utility>

#include "cuda/memory/cuda_check.h"
#include "cuda/memory/growing.h"
#include "cuda/update/work_queue.h"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kThreads = 256;

/// A WorkQueue::Rule with the flags that it tests.
struct Wanted {
  const std::uint8_t* flags;
  WorkQueue::Rule rule;

  __device__ bool operator()(std::uint32_t id) const {
    if ((flags[id] & rule.mask) != rule.value) return false;
    return rule.label == nullptr || rule.label[id] != PointLabel::Accessible;
  }
};

__global__ void setWaiting(std::uint8_t* flags, const std::uint32_t* ids, std::uint32_t count) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= count) return;
  std::uint8_t& flag = flags[ids[n]];
  flag = static_cast<std::uint8_t>((flag & ~kAsked) | kWaiting);
}

__global__ void countAccessible(const PointLabel* label, const std::uint32_t* ids, std::uint32_t count,
                                std::uint32_t* accessible) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  const unsigned all = __ballot_sync(~0u, n < count && label[ids[n]] == PointLabel::Accessible);
  if (threadIdx.x % 32 == 0 && all != 0) atomicAdd(accessible, static_cast<std::uint32_t>(__popc(all)));
}

}  // namespace

WorkQueue::WorkQueue(DeviceMemory& memory) : memory_(memory), selected_(memory, 1) {
  selected_on_host_.reserve(sizeof(std::uint32_t));
}

void WorkQueue::grow(std::uint32_t points, cudaStream_t stream) {
  growFilled(flags_, memory_, points, 0, stream);
  ids_.growWithRoom(memory_, points, roomFor(points), size_);
}

template <typename Input>
void WorkQueue::select(Input input, std::uint32_t count, const Rule& rule, cudaStream_t stream) {
  if (count == 0) return;
  const Wanted wanted = {flags_.data(), rule};
  std::uint32_t* const end = ids_.data() + size_;
  const auto run = [&](void* scratch, std::size_t& bytes) {
    ACCESSVDB_CUDA(CUB_NS_QUALIFIER::DeviceSelect::If(scratch, bytes, input, end, selected_.data(),
                                                      static_cast<int>(count), wanted, stream));
  };
  std::size_t bytes = 0;
  run(nullptr, bytes);
  scratch_.growWithRoom(memory_, bytes, roomFor(bytes), 0);
  run(scratch_.data(), bytes);
  ACCESSVDB_CUDA(cudaMemcpyAsync(selected_on_host_.data(), selected_.data(), sizeof(std::uint32_t),
                                 cudaMemcpyDeviceToHost, stream));
  ACCESSVDB_CUDA(cudaStreamSynchronize(stream));
  std::uint32_t added = 0;
  std::memcpy(&added, selected_on_host_.data(), sizeof(added));
  if (added == 0) return;
  setWaiting<<<(added + kThreads - 1) / kThreads, kThreads, 0, stream>>>(flags_.data(), end, added);
  checkLaunch("setWaiting");
  size_ += added;
}

void WorkQueue::addFrom(std::uint32_t points, const Rule& rule, cudaStream_t stream) {
  select(THRUST_NS_QUALIFIER::counting_iterator<std::uint32_t>(0), points, rule, stream);
}

void WorkQueue::addFromList(DeviceList<std::uint32_t> ids, const Rule& rule, cudaStream_t stream) {
  select(ids.data, ids.count, rule, stream);
}

void WorkQueue::drop(std::uint32_t count, cudaStream_t stream) {
  const std::uint32_t left = size_ - count;
  if (left > 0 && count > 0) {
    rest_.grow(memory_, ids_.size(), 0);  // not smaller: it becomes the queue
    ACCESSVDB_CUDA(cudaMemcpyAsync(rest_.data(), ids_.data() + count, left * sizeof(std::uint32_t),
                                   cudaMemcpyDeviceToDevice, stream));
    std::swap(ids_, rest_);
  }
  size_ = left;
}

WorkQueue::Left WorkQueue::left(const PointLabel* label, cudaStream_t stream) {
  Left left;
  if (size_ == 0) return left;
  left.ids.resize(size_);
  fillBytes(selected_.data(), 0, sizeof(std::uint32_t), stream);
  countAccessible<<<(size_ + kThreads - 1) / kThreads, kThreads, 0, stream>>>(label, ids(), size_, selected_.data());
  checkLaunch("countAccessible");
  ACCESSVDB_CUDA(cudaMemcpyAsync(selected_on_host_.data(), selected_.data(), sizeof(std::uint32_t),
                                 cudaMemcpyDeviceToHost, stream));
  ACCESSVDB_CUDA(
      cudaMemcpyAsync(left.ids.data(), ids(), size_ * sizeof(std::uint32_t), cudaMemcpyDeviceToHost, stream));
  ACCESSVDB_CUDA(cudaStreamSynchronize(stream));
  std::memcpy(&left.accessible, selected_on_host_.data(), sizeof(left.accessible));
  return left;
}

}  // namespace accessvdb::kernels

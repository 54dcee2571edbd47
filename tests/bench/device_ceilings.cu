// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "bench/device_ceilings.h"

#include <cstdint>
#include <functional>

#include "cuda/memory/cuda_check.h"

namespace accessvdb {
namespace {

constexpr unsigned kThreads = 256, kBlocks = 132 * 8;
/// A leaf of the mirror: 160 bytes, of which a search reads the 64 of *collides*. About as many leaves as the map of
/// the flight through pines has at 10 mm and 3.2 million points.
constexpr std::uint32_t kLeaves = 5u << 20, kWordsOfLeaf = 20;
constexpr int kReadsEach = 256, kCountsEach = 4096;

/// Eight lanes per leaf, random leaves: the reads of counting a tool.
__global__ void readLeaves(const std::uint64_t* leaves, std::uint32_t seed, unsigned long long* out) {
  const std::uint32_t own = blockIdx.x * kThreads + threadIdx.x;
  std::uint32_t state = (own / 8 + 1) * 2654435761u + seed;
  std::uint64_t sum = 0;
#pragma unroll 4
  for (int n = 0; n < kReadsEach; ++n) {
    state = state * 1664525u + 1013904223u;
    const auto leaf = static_cast<std::uint32_t>(std::uint64_t{state} * kLeaves >> 32);
    sum += leaves[std::uint64_t{leaf} * kWordsOfLeaf + own % 8];
  }
  if (sum == seed) *out = sum;  // never true, but the compiler does not know
}

/// Words of 64 voxels combined with words of 64 voxels, from registers: the arithmetic of counting a tool.
__global__ void countVoxels(std::uint64_t seed, unsigned long long* out) {
  std::uint64_t words[4], tool = seed + threadIdx.x;
  for (int i = 0; i < 4; ++i) words[i] = seed * static_cast<std::uint64_t>(2 * i + 3) + blockIdx.x;
  int count = 0;
#pragma unroll 8
  for (int n = 0; n < kCountsEach; ++n) {
    for (int i = 0; i < 4; ++i) count += __popcll(static_cast<long long>(words[i] & tool));
    tool += words[n & 3];
  }
  if (count == -1) *out = static_cast<unsigned long long>(count);
}

class Events {
 public:
  Events() {
    ACCESSVDB_CUDA(cudaEventCreate(&begin_));
    ACCESSVDB_CUDA(cudaEventCreate(&end_));
  }
  ~Events() {
    (void)cudaEventDestroy(begin_);
    (void)cudaEventDestroy(end_);
  }
  Events(const Events&) = delete;
  Events& operator=(const Events&) = delete;

  double secondsOf(const std::function<void()>& work) {
    ACCESSVDB_CUDA(cudaEventRecord(begin_));
    work();
    ACCESSVDB_CUDA(cudaEventRecord(end_));
    ACCESSVDB_CUDA(cudaEventSynchronize(end_));
    float milliseconds = 0;
    ACCESSVDB_CUDA(cudaEventElapsedTime(&milliseconds, begin_, end_));
    return milliseconds / 1e3;
  }

 private:
  cudaEvent_t begin_ = nullptr, end_ = nullptr;
};

/// Freed with the process.
void* onDevice(std::size_t bytes) {
  void* data = nullptr;
  ACCESSVDB_CUDA(cudaMalloc(&data, bytes));
  ACCESSVDB_CUDA(cudaMemset(data, 1, bytes));
  return data;
}

}  // namespace

std::vector<Rate> deviceCeilings(int repeats) {
  Events events;
  std::vector<Rate> rates;
  const auto measure = [&](const char* name, const char* unit, double amount, const std::function<void()>& work) {
    Rate rate = {name, unit, amount, {}};
    work();  // warms up
    for (int n = 0; n < repeats; ++n) rate.seconds.push_back(events.secondsOf(work));
    rates.push_back(rate);
  };
  constexpr std::size_t kCopied = std::size_t{1} << 30, kSent = std::size_t{256} << 20;
  auto* from = static_cast<std::byte*>(onDevice(kCopied));
  auto* to = static_cast<std::byte*>(onDevice(kCopied));
  measure("device copy, read and written", "GB/s", 2e-9 * kCopied,
          [&] { ACCESSVDB_CUDA(cudaMemcpyAsync(to, from, kCopied, cudaMemcpyDeviceToDevice)); });
  void* pinned = nullptr;
  ACCESSVDB_CUDA(cudaMallocHost(&pinned, kSent));
  measure("host to device, pinned", "GB/s", 1e-9 * kSent,
          [&] { ACCESSVDB_CUDA(cudaMemcpyAsync(to, pinned, kSent, cudaMemcpyHostToDevice)); });
  auto* leaves = static_cast<std::uint64_t*>(onDevice(std::size_t{kLeaves} * kWordsOfLeaf * sizeof(std::uint64_t)));
  auto* out = static_cast<unsigned long long*>(onDevice(sizeof(unsigned long long)));
  std::uint32_t seed = 1;
  measure("leaves read anywhere on the device", "million leaves/s", 1e-6 * kReadsEach * kBlocks * kThreads / 8, [&] {
    readLeaves<<<kBlocks, kThreads>>>(leaves, ++seed, out);
    kernels::checkLaunch("readLeaves");
  });
  measure("words of 64 voxels counted", "billion words/s", 1e-9 * 4 * kCountsEach * kBlocks * kThreads, [&] {
    countVoxels<<<kBlocks, kThreads>>>(++seed, out);
    kernels::checkLaunch("countVoxels");
  });
  return rates;
}

}  // namespace accessvdb

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The order in which a wide set is searched (hostdev/wide_search.h), computed by a whole block: directions are put
/// into bins of the cosine to the normal, and then sorted within their bin.
#pragma once

#include <cstdint>

#include "cuda/search/warp.cuh"
#include "hostdev/wide_search.h"

namespace accessvdb::kernels {

/// A block that searches one point.
struct WideBlock {
  static constexpr int kWarps = 4, kThreads = kWarps * static_cast<int>(kWarp);

  __device__ static int thread() { return static_cast<int>(threadIdx.x); }
  __device__ static int lane() { return static_cast<int>(threadIdx.x % kWarp); }
  __device__ static int warp() { return static_cast<int>(threadIdx.x / kWarp); }
};

/// What a block keeps in shared memory of the directions of its point.
struct WideScratch {
  static constexpr int kBins = CosineBins::kCount;

  std::uint32_t* bin_end;  ///< [kBins] while bins are filled: where the next one goes; then the end of each
  std::uint16_t* order;    ///< [directions] those that were seen and lie in the normal cone

  [[nodiscard]] static ACCESSVDB_HOSTDEV std::uint32_t words(int num_directions) {
    return kBins + static_cast<std::uint32_t>(num_directions + 1) / 2;
  }
  __device__ explicit WideScratch(std::uint32_t* memory)
      : bin_end(memory), order(reinterpret_cast<std::uint16_t*>(memory + kBins)) {}
};

/// Sorts the directions that were seen and lie in the normal cone.
class WideOrder {
 public:
  __device__ WideOrder(const ApproachView& approach, const float* normal, const WideScratch& scratch)
      : approach_(approach), normal_(normal), scratch_(scratch), bins_(approach) {}

  /// All threads of the block call it. @param seen  [words of the set]  @param in_cone  out: whether any direction,
  /// seen or not, is in the cone
  /// @return how many are in scratch.order, best first
  __device__ int make(const std::uint64_t* seen, bool& in_cone) {
    for (int bin = WideBlock::thread(); bin < WideScratch::kBins; bin += WideBlock::kThreads) scratch_.bin_end[bin] = 0;
    __syncthreads();
    bool any = false;
    forEachWanted(seen, any, [&](int, int bin) { atomicAdd(&scratch_.bin_end[bin], 1u); });
    in_cone = __syncthreads_or(any) != 0;
    if (WideBlock::warp() == 0) startBins();
    __syncthreads();
    forEachWanted(seen, any, [&](int d, int bin) {
      scratch_.order[atomicAdd(&scratch_.bin_end[bin], 1u)] = static_cast<std::uint16_t>(d);
    });
    __syncthreads();
    sortBins();
    __syncthreads();
    return beginOf(WideScratch::kBins);
  }

 private:
  /// Places of a batch of whole bins, which the lanes keep while they overwrite it.
  static constexpr int kEach = 4, kBatch = kEach * static_cast<int>(kWarp);

  [[nodiscard]] __device__ float cosine(int d) const { return cosToNormal(approach_, d, normal_); }
  [[nodiscard]] __device__ int beginOf(int bin) const {
    return bin == 0 ? 0 : static_cast<int>(scratch_.bin_end[bin - 1]);
  }

  /// @param any  set if one is in the cone, seen or not  @param visit  (direction, its bin)
  template <class Visit>
  __device__ void forEachWanted(const std::uint64_t* seen, bool& any, const Visit& visit) const {
#pragma unroll 1
    for (int d = WideBlock::thread(); d < approach_.num_directions; d += WideBlock::kThreads) {
      const float c = cosine(d);
      if (!(c >= approach_.normal_cos_min)) continue;
      any = true;
      if ((seen[d >> 6] >> (d & 63) & 1u) != 0) visit(d, bins_.binOf(c));
    }
  }

  /// Turns counts into where each bin begins; one warp calls it.
  __device__ void startBins() const {
    constexpr int kBinsEach = WideScratch::kBins / static_cast<int>(kWarp);
    const int lane = WideBlock::lane();
    std::uint32_t sizes[kBinsEach], sum = 0;
    for (int n = 0; n < kBinsEach; ++n) {
      sizes[n] = scratch_.bin_end[kBinsEach * lane + n];
      sum += sizes[n];
    }
    std::uint32_t begin = static_cast<std::uint32_t>(sumUpTo(static_cast<int>(sum), lane)) - sum;
    for (int n = 0; n < kBinsEach; ++n) {
      scratch_.bin_end[kBinsEach * lane + n] = begin;
      begin += sizes[n];
    }
  }

  /// Each warp sorts its share of the bins.
  __device__ void sortBins() const {
    constexpr int kBinsEach = WideScratch::kBins / WideBlock::kWarps;
    const int end_bin = (WideBlock::warp() + 1) * kBinsEach, last = beginOf(end_bin);
#pragma unroll 1
    for (int first = beginOf(end_bin - kBinsEach); first < last;) {
      const int first_bin = bins_.binOf(cosine(scratch_.order[first]));
      int end = first;
      for (int bin = first_bin; bin < end_bin; ++bin) {
        const int bin_end = beginOf(bin + 1);
        if (bin_end - first > kBatch) break;
        end = bin_end;
      }
      if (end > first) {
        sortBatch(first, end);
      } else {
        end = beginOf(first_bin + 1);
        sortLarge(first, end);
      }
      first = end;
    }
  }

  /// Sorts whole bins: each direction goes behind those of its bin that come before it.
  __device__ void sortBatch(int first, int end) const {
    int direction[kEach], place[kEach];
#pragma unroll
    for (int n = 0; n < kEach; ++n) {
      const int at = first + n * static_cast<int>(kWarp) + WideBlock::lane();
      if (at >= end) continue;
      const int d = direction[n] = scratch_.order[at];
      const float c = cosine(d);
      const int bin = bins_.binOf(c), begin = beginOf(bin), bin_end = beginOf(bin + 1);
      place[n] = begin;
#pragma unroll 1
      for (int m = begin; m < bin_end; ++m) {
        const int other = scratch_.order[m];
        if (ranksBefore(cosine(other), other, c, d)) ++place[n];
      }
    }
    __syncwarp();
#pragma unroll
    for (int n = 0; n < kEach; ++n) {
      if (first + n * static_cast<int>(kWarp) + WideBlock::lane() < end) {
        scratch_.order[place[n]] = static_cast<std::uint16_t>(direction[n]);
      }
    }
    __syncwarp();
  }

  /// A bin with more than a batch: neighbours change places, at even and at odd places in turn.
  __device__ void sortLarge(int first, int end) const {
#pragma unroll 1
    for (int round = 0; round < end - first; ++round) {
#pragma unroll 1
      for (int at = first + (round & 1) + 2 * WideBlock::lane(); at + 1 < end; at += 2 * static_cast<int>(kWarp)) {
        const std::uint16_t a = scratch_.order[at], b = scratch_.order[at + 1];
        if (!ranksBefore(cosine(b), b, cosine(a), a)) continue;
        scratch_.order[at] = b;
        scratch_.order[at + 1] = a;
      }
      __syncwarp();
    }
  }

  const ApproachView& approach_;
  const float* normal_;
  const WideScratch& scratch_;
  CosineBins bins_;
};

}  // namespace accessvdb::kernels

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The order in which a wide set is searched (hostdev/wide_search.h), computed by a whole warp: directions are put into
/// bins of the cosine to the normal, and then sorted within their bin.
#pragma once

#include <cstdint>

#include "cuda/search/warp.cuh"
#include "hostdev/direction_filter.h"

namespace accessvdb::kernels {

/// What a warp keeps in shared memory of the directions of its point. One list, so that many warps find room.
struct WideScratch {
  static constexpr int kBins = 128;

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
  __device__ WideOrder(const ApproachView& approach, const float* normal, const WideScratch& scratch, int lane)
      : approach_(approach),
        normal_(normal),
        scratch_(scratch),
        bins_per_cosine_(static_cast<float>(WideScratch::kBins) / (1.0f - approach.normal_cos_min + 1e-3f)),
        lane_(lane) {}

  /// All lanes call it. @param seen  [words of the set]  @param in_cone  out: whether any direction, seen or not, is in
  /// the cone
  /// @return how many are in scratch.order, best first
  __device__ int make(const std::uint64_t* seen, bool& in_cone) {
    for (int bin = lane_; bin < WideScratch::kBins; bin += static_cast<int>(kWarp)) scratch_.bin_end[bin] = 0;
    __syncwarp();
    bool any = false;
    forEachWanted(seen, any, [&](int, int bin) { atomicAdd(&scratch_.bin_end[bin], 1u); });
    in_cone = __any_sync(kAllLanes, any) != 0;
    __syncwarp();
    const int count = startBins();
    __syncwarp();
    forEachWanted(seen, any, [&](int d, int bin) {
      scratch_.order[atomicAdd(&scratch_.bin_end[bin], 1u)] = static_cast<std::uint16_t>(d);
    });
    __syncwarp();
    sortBins(count);
    return count;
  }

 private:
  /// Places of a batch of whole bins, which the lanes keep while they overwrite it.
  static constexpr int kEach = 4, kBatch = kEach * static_cast<int>(kWarp);

  [[nodiscard]] __device__ float cosine(int d) const { return cosToNormal(approach_, d, normal_); }
  /// Never falls as the cosine falls, however it is rounded.
  [[nodiscard]] __device__ int binOf(float cosine) const {
    const int bin = static_cast<int>((1.0f - cosine) * bins_per_cosine_);
    return min(max(bin, 0), WideScratch::kBins - 1);
  }
  [[nodiscard]] __device__ int beginOf(int bin) const {
    return bin == 0 ? 0 : static_cast<int>(scratch_.bin_end[bin - 1]);
  }

  /// @param any  set if one is in the cone, seen or not  @param visit  (direction, its bin)
  template <class Visit>
  __device__ void forEachWanted(const std::uint64_t* seen, bool& any, const Visit& visit) const {
#pragma unroll 1
    for (int d = lane_; d < approach_.num_directions; d += static_cast<int>(kWarp)) {
      const float c = cosine(d);
      if (!(c >= approach_.normal_cos_min)) continue;
      any = true;
      if ((seen[d >> 6] >> (d & 63) & 1u) != 0) visit(d, binOf(c));
    }
  }

  /// Turns counts into where each bin begins. @return their sum
  __device__ int startBins() const {
    constexpr int kBinsEach = WideScratch::kBins / static_cast<int>(kWarp);
    std::uint32_t sizes[kBinsEach], sum = 0;
    for (int n = 0; n < kBinsEach; ++n) {
      sizes[n] = scratch_.bin_end[kBinsEach * lane_ + n];
      sum += sizes[n];
    }
    const auto end = static_cast<std::uint32_t>(sumUpTo(static_cast<int>(sum), lane_));
    std::uint32_t begin = end - sum;
    for (int n = 0; n < kBinsEach; ++n) {
      scratch_.bin_end[kBinsEach * lane_ + n] = begin;
      begin += sizes[n];
    }
    return static_cast<int>(__shfl_sync(kAllLanes, end, static_cast<int>(kWarp) - 1));
  }

  __device__ void sortBins(int count) const {
#pragma unroll 1
    for (int first = 0; first < count;) {
      const int first_bin = binOf(cosine(scratch_.order[first]));
      int end = first;
      for (int bin = first_bin; bin < WideScratch::kBins; ++bin) {
        const auto bin_end = static_cast<int>(scratch_.bin_end[bin]);
        if (bin_end - first > kBatch) break;
        end = bin_end;
      }
      if (end > first) {
        sortBatch(first, end);
      } else {
        end = static_cast<int>(scratch_.bin_end[first_bin]);
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
      const int at = first + n * static_cast<int>(kWarp) + lane_;
      if (at >= end) continue;
      const int d = direction[n] = scratch_.order[at];
      const float c = cosine(d);
      const int bin = binOf(c), begin = beginOf(bin);
      const auto bin_end = static_cast<int>(scratch_.bin_end[bin]);
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
      if (first + n * static_cast<int>(kWarp) + lane_ < end) {
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
      for (int at = first + (round & 1) + 2 * lane_; at + 1 < end; at += 2 * static_cast<int>(kWarp)) {
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
  float bins_per_cosine_;
  int lane_;
};

}  // namespace accessvdb::kernels

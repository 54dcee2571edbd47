// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cpu/window_kernels.h"

#include "hostdev/occupancy_query.h"

// No standard library code inside the regions: an inline function compiled there could end up being used everywhere.
#define ACCESSVDB_X86_WINDOWS 0
#define ACCESSVDB_NEON_WINDOWS 0
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#undef ACCESSVDB_X86_WINDOWS
#define ACCESSVDB_X86_WINDOWS 1
#include <immintrin.h>
#elif defined(__aarch64__) && defined(__ARM_NEON) && !defined(__AARCH64EB__)
#undef ACCESSVDB_NEON_WINDOWS
#define ACCESSVDB_NEON_WINDOWS 1  // every such processor has it
#include <arm_neon.h>
#endif

#if ACCESSVDB_X86_WINDOWS
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"  // in GCC 12's own intrinsics (its bug 105593)
#pragma GCC push_options
#pragma GCC target("avx512f,avx512vl,avx512dq,avx512bw,avx512vpopcntdq,avx2,bmi,bmi2,popcnt")
namespace accessvdb::kernels::window_avx512 {

/// Runs after which the count is compared with its bound.
constexpr int kRunsAtATime = 4;

template <bool kTwo>
inline int countRuns(const WindowRun* run, const WindowRun* end, const std::uint64_t* tool, const std::uint64_t* map,
                     const std::uint64_t* above, unsigned shift, int stop_above) {
  const __m128i down = _mm_cvtsi32_si128(static_cast<int>(shift)), up = _mm_cvtsi32_si128(static_cast<int>(63 - shift));
  __m512i sum = _mm512_setzero_si512();
  for (int runs = 1; run != end; ++run, ++runs) {
    const std::uint64_t *own = tool + run->first, *low = map + run->offset;
    const std::uint64_t* high = kTwo ? above + run->offset : nullptr;
    for (std::uint32_t n = 0; n < run->count; n += 8) {
      const std::uint32_t left = run->count - n;
      const auto lanes = static_cast<__mmask8>(left < 8 ? (1u << left) - 1 : 0xffu);
      __m512i bits = _mm512_srl_epi64(_mm512_maskz_loadu_epi64(lanes, low + n), down);
      if constexpr (kTwo) {
        const __m512i next = _mm512_maskz_loadu_epi64(lanes, high + n);
        bits = _mm512_or_si512(bits, _mm512_sll_epi64(_mm512_slli_epi64(next, 1), up));
      }
      bits = _mm512_and_si512(bits, _mm512_maskz_loadu_epi64(lanes, own + n));
      sum = _mm512_add_epi64(sum, _mm512_popcnt_epi64(bits));
    }
    if (runs % kRunsAtATime == 0) {
      const auto count = static_cast<int>(_mm512_reduce_add_epi64(sum));
      if (count > stop_above) return count;
    }
  }
  return static_cast<int>(_mm512_reduce_add_epi64(sum));
}

int count(const WindowRun* run, const WindowRun* end, const std::uint64_t* tool, const std::uint64_t* map,
          unsigned shift, int stop_above) {
  return countRuns<false>(run, end, tool, map, nullptr, shift, stop_above);
}
int countTwo(const WindowRun* run, const WindowRun* end, const std::uint64_t* tool, const std::uint64_t* map,
             const std::uint64_t* above, unsigned shift, int stop_above) {
  return countRuns<true>(run, end, tool, map, above, shift, stop_above);
}

void stack(const std::uint64_t* const* leaves, int count, std::uint64_t* columns, std::size_t stride) {
  for (int x = 0; x < 8; ++x) {
    __m512i bits = _mm512_setzero_si512();
    for (int n = 0; n < count; ++n) {
      if (leaves[n] == nullptr) continue;
      const __m128i rows = _mm_loadl_epi64(reinterpret_cast<const __m128i*>(leaves[n] + x));
      bits = _mm512_or_si512(bits, _mm512_sll_epi64(_mm512_cvtepu8_epi64(rows), _mm_cvtsi32_si128(8 * n)));
    }
    _mm512_storeu_si512(columns + static_cast<std::size_t>(x) * stride, bits);
  }
}

}  // namespace accessvdb::kernels::window_avx512
#pragma GCC pop_options
#pragma GCC diagnostic pop

#pragma GCC push_options
#pragma GCC target("avx2,bmi,bmi2,popcnt")
namespace accessvdb::kernels::window_avx2 {

/// Set bits of each word: of each half byte by table, then summed.
inline __m256i bitsOfWords(__m256i words) {
  const __m256i of_half = _mm256_setr_epi8(0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4,  //
                                           0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4);
  const __m256i low = _mm256_set1_epi8(0x0f);
  const __m256i bytes =
      _mm256_add_epi8(_mm256_shuffle_epi8(of_half, _mm256_and_si256(words, low)),
                      _mm256_shuffle_epi8(of_half, _mm256_and_si256(_mm256_srli_epi64(words, 4), low)));
  return _mm256_sad_epu8(bytes, _mm256_setzero_si256());
}
inline int total(__m256i sums) {
  const __m128i two = _mm_add_epi64(_mm256_castsi256_si128(sums), _mm256_extracti128_si256(sums, 1));
  return static_cast<int>(_mm_cvtsi128_si64(_mm_add_epi64(two, _mm_unpackhi_epi64(two, two))));
}

template <bool kTwo>
inline int countRuns(const WindowRun* run, const WindowRun* end, const std::uint64_t* tool, const std::uint64_t* map,
                     const std::uint64_t* above, unsigned shift, int stop_above) {
  const __m128i down = _mm_cvtsi32_si128(static_cast<int>(shift)), up = _mm_cvtsi32_si128(static_cast<int>(63 - shift));
  const auto meet = [&](__m256i low, __m256i high, __m256i own) {
    __m256i bits = _mm256_srl_epi64(low, down);
    if constexpr (kTwo) bits = _mm256_or_si256(bits, _mm256_sll_epi64(_mm256_slli_epi64(high, 1), up));
    return _mm256_and_si256(bits, own);
  };
  __m256i sum = _mm256_setzero_si256();
  for (int runs = 1; run != end; ++run, ++runs) {
    const std::uint64_t *own = tool + run->first, *low = map + run->offset;
    const std::uint64_t* high = kTwo ? above + run->offset : low;
    std::uint32_t n = 0;
    for (; n + 4 <= run->count; n += 4) {
      const auto load = [n](const std::uint64_t* words) {
        return _mm256_loadu_si256(reinterpret_cast<const __m256i*>(words + n));
      };
      sum = _mm256_add_epi64(sum, bitsOfWords(meet(load(low), load(high), load(own))));
    }
    if (n < run->count) {
      const __m256i lanes = _mm256_cmpgt_epi64(_mm256_set1_epi64x(run->count - n), _mm256_setr_epi64x(0, 1, 2, 3));
      const auto load = [n, lanes](const std::uint64_t* words) {
        return _mm256_maskload_epi64(reinterpret_cast<const long long*>(words + n), lanes);
      };
      sum = _mm256_add_epi64(sum, bitsOfWords(meet(load(low), load(high), load(own))));
    }
    if (runs % 4 == 0) {
      const int count = total(sum);
      if (count > stop_above) return count;
    }
  }
  return total(sum);
}

int count(const WindowRun* run, const WindowRun* end, const std::uint64_t* tool, const std::uint64_t* map,
          unsigned shift, int stop_above) {
  return countRuns<false>(run, end, tool, map, nullptr, shift, stop_above);
}
int countTwo(const WindowRun* run, const WindowRun* end, const std::uint64_t* tool, const std::uint64_t* map,
             const std::uint64_t* above, unsigned shift, int stop_above) {
  return countRuns<true>(run, end, tool, map, above, shift, stop_above);
}

void stack(const std::uint64_t* const* leaves, int count, std::uint64_t* columns, std::size_t stride) {
  for (int x = 0; x < 8; ++x) {
    __m256i low = _mm256_setzero_si256(), high = _mm256_setzero_si256();
    for (int n = 0; n < count; ++n) {
      if (leaves[n] == nullptr) continue;
      const __m128i rows = _mm_loadl_epi64(reinterpret_cast<const __m128i*>(leaves[n] + x));
      const __m128i up = _mm_cvtsi32_si128(8 * n);
      low = _mm256_or_si256(low, _mm256_sll_epi64(_mm256_cvtepu8_epi64(rows), up));
      high = _mm256_or_si256(high, _mm256_sll_epi64(_mm256_cvtepu8_epi64(_mm_srli_si128(rows, 4)), up));
    }
    auto* const to = reinterpret_cast<__m256i*>(columns + static_cast<std::size_t>(x) * stride);
    _mm256_storeu_si256(to, low);
    _mm256_storeu_si256(to + 1, high);
  }
}

SampleBits lookUp(const SampleWindow& window, const FlatSamples& samples) {
  const __m128 inverse = _mm_set1_ps(window.inverse_voxel_size), half = _mm_set1_ps(0.5f);
  const auto voxel = [&](float at_m, const float* offsets) {
    const __m128 sum = _mm_add_ps(_mm_set1_ps(at_m), _mm_loadu_ps(offsets));
    return _mm_cvttps_epi32(_mm_floor_ps(_mm_add_ps(_mm_mul_ps(sum, inverse), half)));
  };
  const __m128i x = _mm_sub_epi32(voxel(window.x_m, samples.x), _mm_set1_epi32(window.low_x));
  const __m128i y = _mm_sub_epi32(voxel(window.y_m, samples.y), _mm_set1_epi32(window.low_y));
  const auto below = [](__m128i i, std::uint32_t size) {
    const __m128i most = _mm_set1_epi32(static_cast<int>(size - 1));
    return _mm_cmpeq_epi32(_mm_min_epu32(i, most), i);
  };
  const __m128i inside = _mm_and_si128(below(x, window.size_x), below(y, window.size_y));
  const __m128i column = _mm_add_epi32(_mm_mullo_epi32(x, _mm_set1_epi32(static_cast<int>(window.stride))), y);
  alignas(16) std::uint32_t columns[FlatSamples::kLanes];
  _mm_store_si128(reinterpret_cast<__m128i*>(columns), _mm_and_si128(column, inside));
  SampleBits bits = {static_cast<unsigned>(_mm_movemask_ps(_mm_castsi128_ps(inside))), 0};
  for (unsigned n = 0; n < FlatSamples::kLanes; ++n) {
    bits.set |= static_cast<unsigned>(window.words[columns[n]] >> window.bit & 1u) << n;
  }
  return bits;
}

}  // namespace accessvdb::kernels::window_avx2
#pragma GCC pop_options
#endif

#if ACCESSVDB_NEON_WINDOWS
namespace accessvdb::kernels::window_neon {

/// Set bits of each word.
inline uint64x2_t bitsOfWords(uint64x2_t words) {
  return vpaddlq_u32(vpaddlq_u16(vpaddlq_u8(vcntq_u8(vreinterpretq_u8_u64(words)))));
}

template <bool kTwo>
inline int countRuns(const WindowRun* run, const WindowRun* end, const std::uint64_t* tool, const std::uint64_t* map,
                     const std::uint64_t* above, unsigned shift, int stop_above) {
  const int64x2_t down = vdupq_n_s64(-static_cast<std::int64_t>(shift)), up = vdupq_n_s64(63 - shift);
  const auto meet = [&](uint64x2_t low, uint64x2_t high, uint64x2_t own) {
    uint64x2_t bits = vshlq_u64(low, down);
    if constexpr (kTwo) bits = vorrq_u64(bits, vshlq_u64(vshlq_n_u64(high, 1), up));
    return vandq_u64(bits, own);
  };
  uint64x2_t sum = vdupq_n_u64(0);
  for (int runs = 1; run != end; ++run, ++runs) {
    const std::uint64_t *own = tool + run->first, *low = map + run->offset;
    const std::uint64_t* high = kTwo ? above + run->offset : low;
    std::uint32_t n = 0;
    for (; n + 2 <= run->count; n += 2) {
      sum = vaddq_u64(sum, bitsOfWords(meet(vld1q_u64(low + n), vld1q_u64(high + n), vld1q_u64(own + n))));
    }
    if (n < run->count) {
      const auto load = [n](const std::uint64_t* words) { return vsetq_lane_u64(words[n], vdupq_n_u64(0), 0); };
      sum = vaddq_u64(sum, bitsOfWords(meet(load(low), load(high), load(own))));
    }
    if (runs % 4 == 0) {
      const int count = static_cast<int>(vaddvq_u64(sum));
      if (count > stop_above) return count;
    }
  }
  return static_cast<int>(vaddvq_u64(sum));
}

int count(const WindowRun* run, const WindowRun* end, const std::uint64_t* tool, const std::uint64_t* map,
          unsigned shift, int stop_above) {
  return countRuns<false>(run, end, tool, map, nullptr, shift, stop_above);
}
int countTwo(const WindowRun* run, const WindowRun* end, const std::uint64_t* tool, const std::uint64_t* map,
             const std::uint64_t* above, unsigned shift, int stop_above) {
  return countRuns<true>(run, end, tool, map, above, shift, stop_above);
}

/// Eight leaves of eight rows: their bytes are a matrix, and the columns the matrix turned.
void stack(const std::uint64_t* const* leaves, int count, std::uint64_t* columns, std::size_t stride) {
  for (std::size_t x = 0; x < 8; ++x) {
    uint8x8_t rows[8];
    for (int n = 0; n < 8; ++n) rows[n] = vcreate_u8(n < count && leaves[n] != nullptr ? leaves[n][x] : 0);
    const auto pairs = [](uint16x4x2_t of) {
      return uint32x2x2_t{{vreinterpret_u32_u16(of.val[0]), vreinterpret_u32_u16(of.val[1])}};
    };
    uint16x4x2_t bytes[4];  // of rows 2n and 2n + 1: even columns, odd columns
    for (int n = 0; n < 4; ++n) {
      const uint8x8x2_t turned = vtrn_u8(rows[2 * n], rows[2 * n + 1]);
      bytes[n] = {{vreinterpret_u16_u8(turned.val[0]), vreinterpret_u16_u8(turned.val[1])}};
    }
    for (int odd = 0; odd < 2; ++odd) {
      const uint32x2x2_t low = pairs(vtrn_u16(bytes[0].val[odd], bytes[1].val[odd]));
      const uint32x2x2_t high = pairs(vtrn_u16(bytes[2].val[odd], bytes[3].val[odd]));
      for (int two = 0; two < 2; ++two) {
        const uint32x2x2_t whole = vtrn_u32(low.val[two], high.val[two]);
        for (int four = 0; four < 2; ++four) {
          const auto y = static_cast<std::size_t>(4 * four + 2 * two + odd);
          columns[x * stride + y] = vget_lane_u64(vreinterpret_u64_u32(whole.val[four]), 0);
        }
      }
    }
  }
}

SampleBits lookUp(const SampleWindow& window, const FlatSamples& samples) {
  const float32x4_t inverse = vdupq_n_f32(window.inverse_voxel_size), half = vdupq_n_f32(0.5f);
  const auto voxel = [&](float at_m, const float* offsets, std::int32_t low) {
    const float32x4_t sum = vaddq_f32(vdupq_n_f32(at_m), vld1q_f32(offsets));
    const int32x4_t index = vcvtq_s32_f32(vrndmq_f32(vaddq_f32(vmulq_f32(sum, inverse), half)));
    return vreinterpretq_u32_s32(vsubq_s32(index, vdupq_n_s32(low)));
  };
  const uint32x4_t x = voxel(window.x_m, samples.x, window.low_x), y = voxel(window.y_m, samples.y, window.low_y);
  const uint32x4_t inside =
      vandq_u32(vcltq_u32(x, vdupq_n_u32(window.size_x)), vcltq_u32(y, vdupq_n_u32(window.size_y)));
  const uint32x4_t column = vaddq_u32(vmulq_u32(x, vdupq_n_u32(window.stride)), y);
  std::uint32_t columns[FlatSamples::kLanes], is_inside[FlatSamples::kLanes];
  vst1q_u32(columns, vandq_u32(column, inside));
  vst1q_u32(is_inside, inside);
  SampleBits bits = {0, 0};
  for (unsigned n = 0; n < FlatSamples::kLanes; ++n) {
    bits.inside |= (is_inside[n] & 1u) << n;
    bits.set |= static_cast<unsigned>(window.words[columns[n]] >> window.bit & 1u) << n;
  }
  return bits;
}

}  // namespace accessvdb::kernels::window_neon
#endif

namespace accessvdb::kernels {
namespace {

int bitsOf(std::uint64_t word) {
  word -= word >> 1 & 0x5555555555555555u;
  word = (word & 0x3333333333333333u) + (word >> 2 & 0x3333333333333333u);
  return static_cast<int>(((word + (word >> 4)) & 0x0f0f0f0f0f0f0f0fu) * 0x0101010101010101u >> 56);
}

template <bool kTwo>
int plainRuns(const WindowRun* run, const WindowRun* end, const std::uint64_t* tool, const std::uint64_t* map,
              const std::uint64_t* above, unsigned shift, int stop_above) {
  int count = 0;
  for (; run != end; ++run) {
    const std::uint64_t *own = tool + run->first, *low = map + run->offset;
    for (std::uint32_t n = 0; n < run->count; ++n) {
      std::uint64_t bits = low[n] >> shift;
      if constexpr (kTwo) bits |= above[run->offset + static_cast<std::int32_t>(n)] << 1 << (63 - shift);
      bits &= own[n];
      if (bits != 0) count += bitsOf(bits);
    }
    if (count > stop_above) return count;
  }
  return count;
}

int plainCount(const WindowRun* run, const WindowRun* end, const std::uint64_t* tool, const std::uint64_t* map,
               unsigned shift, int stop_above) {
  return plainRuns<false>(run, end, tool, map, nullptr, shift, stop_above);
}
int plainCountTwo(const WindowRun* run, const WindowRun* end, const std::uint64_t* tool, const std::uint64_t* map,
                  const std::uint64_t* above, unsigned shift, int stop_above) {
  return plainRuns<true>(run, end, tool, map, above, shift, stop_above);
}

void plainStack(const std::uint64_t* const* leaves, int count, std::uint64_t* columns, std::size_t stride) {
  for (std::size_t x = 0; x < 8; ++x) {
    for (std::size_t y = 0; y < 8; ++y) {
      std::uint64_t bits = 0;
      for (int n = 0; n < count; ++n) {
        if (leaves[n] != nullptr) bits |= (leaves[n][x] >> (8 * y) & 0xffu) << (8 * n);
      }
      columns[x * stride + y] = bits;
    }
  }
}

SampleBits plainLookUp(const SampleWindow& window, const FlatSamples& samples) {
  SampleBits bits = {0, 0};
  for (int n = 0; n < FlatSamples::kLanes; ++n) {
    const auto voxel = [&](float at_m, float offset) { return voxelIndex(at_m + offset, window.inverse_voxel_size); };
    const auto x = static_cast<std::uint32_t>(voxel(window.x_m, samples.x[n]) - window.low_x);
    const auto y = static_cast<std::uint32_t>(voxel(window.y_m, samples.y[n]) - window.low_y);
    if (x >= window.size_x || y >= window.size_y) continue;
    bits.inside |= 1u << n;
    const std::uint64_t word = window.words[std::size_t{x} * window.stride + y];
    bits.set |= static_cast<unsigned>(word >> window.bit & 1u) << n;
  }
  return bits;
}

constexpr WindowKernels kPlain = {"plain", plainCount, plainCountTwo, plainStack, plainLookUp};
#if ACCESSVDB_X86_WINDOWS
constexpr WindowKernels kAvx512 = {"avx512", window_avx512::count, window_avx512::countTwo, window_avx512::stack,
                                   window_avx2::lookUp};
constexpr WindowKernels kAvx2 = {"avx2", window_avx2::count, window_avx2::countTwo, window_avx2::stack,
                                 window_avx2::lookUp};
#elif ACCESSVDB_NEON_WINDOWS
constexpr WindowKernels kNeon = {"neon", window_neon::count, window_neon::countTwo, window_neon::stack,
                                 window_neon::lookUp};
#endif

}  // namespace

WindowKernelList runnableWindowKernels() {
#if ACCESSVDB_X86_WINDOWS
  const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2") &&
                    __builtin_cpu_supports("popcnt");
  const bool avx512 = avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
                      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw") &&
                      __builtin_cpu_supports("avx512vpopcntdq");
  if (avx512) return {{&kAvx512, &kAvx2, &kPlain}, 3};
  if (avx2) return {{&kAvx2, &kPlain, nullptr}, 2};
  return {{&kPlain, nullptr, nullptr}, 1};
#elif ACCESSVDB_NEON_WINDOWS
  return {{&kNeon, &kPlain, nullptr}, 2};
#else
  return {{&kPlain, nullptr, nullptr}, 1};
#endif
}

const WindowKernels& windowKernels() {
  static const WindowKernels& best = *runnableWindowKernels().kernels[0];
  return best;
}

}  // namespace accessvdb::kernels

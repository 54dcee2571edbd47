// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The rules of hostdev/known_levels.h for whole rows of levels: sixteen directions at a time on x86-64 and 64-bit ARM.
#pragma once

#if defined(__SSE2__)
#include <immintrin.h>
#elif defined(__aarch64__) && defined(__ARM_NEON)
#include <arm_neon.h>
#define ACCESSVDB_KNOWN_ROWS_NEON
#endif

#include <cstddef>
#include <cstdint>

#include "hostdev/known_levels.h"

namespace accessvdb::internal::known_rows {

/// A row is a multiple of this many words long. They hold the 64 directions of one word of a mask, and fill a cache
/// line.
inline constexpr std::size_t kWords = 8;

/// known_word::worse() of 64 directions. @param levels, lowest  [kWords]
[[nodiscard]] inline std::uint64_t worse(const std::uint64_t* levels, const std::uint64_t* lowest) {
  std::uint64_t bits = 0;
#if defined(__SSE2__)
  for (std::size_t w = 0; w < kWords; w += 2) {
    const __m128i known = _mm_loadu_si128(reinterpret_cast<const __m128i*>(levels + w));
    const __m128i least = _mm_loadu_si128(reinterpret_cast<const __m128i*>(lowest + w));
    // A blocked corridor is the highest bit, which makes a byte as large as any lowest level.
    const __m128i not_less = _mm_cmpeq_epi8(_mm_max_epu8(known, least), known);
    bits |= std::uint64_t{static_cast<std::uint32_t>(_mm_movemask_epi8(not_less))} << (8 * w);
  }
#elif defined(ACCESSVDB_KNOWN_ROWS_NEON)
  static const std::uint8_t kBit[16] = {1, 2, 4, 8, 16, 32, 64, 128, 1, 2, 4, 8, 16, 32, 64, 128};
  const uint8x16_t bit = vld1q_u8(kBit);
  for (std::size_t w = 0; w < kWords; w += 2) {
    const uint8x16_t known = vreinterpretq_u8_u64(vld1q_u64(levels + w));
    const uint8x16_t least = vreinterpretq_u8_u64(vld1q_u64(lowest + w));
    const uint8x16_t not_less = vandq_u8(vcgeq_u8(known, least), bit);  // as above
    bits |= std::uint64_t{vaddv_u8(vget_low_u8(not_less))} << (8 * w);
    bits |= std::uint64_t{vaddv_u8(vget_high_u8(not_less))} << (8 * (w + 1));
  }
#else
  for (std::size_t w = 0; w < kWords; ++w) {
    bits |= std::uint64_t{kernels::known_word::worse(levels[w], lowest[w])} << (8 * w);
  }
#endif
  return bits;
}

/// known_word::lowered() of 64 directions. @param levels, steps  [kWords]
inline void lower(std::uint64_t* levels, const std::uint64_t* steps) {
#if defined(__SSE2__)
  const __m128i arms = _mm_set1_epi8(static_cast<char>(0x80));
  for (std::size_t w = 0; w < kWords; w += 2) {
    auto* const at = reinterpret_cast<__m128i*>(levels + w);
    const __m128i known = _mm_loadu_si128(at), less = _mm_loadu_si128(reinterpret_cast<const __m128i*>(steps + w));
    _mm_storeu_si128(at, _mm_or_si128(_mm_subs_epu8(_mm_andnot_si128(arms, known), less), _mm_and_si128(arms, known)));
  }
#elif defined(ACCESSVDB_KNOWN_ROWS_NEON)
  const uint8x16_t arms = vdupq_n_u8(0x80);
  for (std::size_t w = 0; w < kWords; w += 2) {
    const uint8x16_t known = vreinterpretq_u8_u64(vld1q_u64(levels + w));
    const uint8x16_t less = vreinterpretq_u8_u64(vld1q_u64(steps + w));
    const uint8x16_t lowered = vorrq_u8(vqsubq_u8(vbicq_u8(known, arms), less), vandq_u8(known, arms));
    vst1q_u64(levels + w, vreinterpretq_u64_u8(lowered));
  }
#else
  for (std::size_t w = 0; w < kWords; ++w) levels[w] = kernels::known_word::lowered(levels[w], steps[w]);
#endif
}

}  // namespace accessvdb::internal::known_rows

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/near_kernels.h"

#include <cmath>

#include "hostdev/surface_normal.h"
#include "processor/instruction_sets.h"

#if ACCESSVDB_X86_KERNELS
#pragma GCC push_options
#pragma GCC target("avx512f,avx512vl,avx512dq,avx512bw,avx2,bmi,bmi2,lzcnt,popcnt")
namespace accessvdb::internal::near_avx512 {

inline __mmask16 closer(const float* x, const float* y, const float* z, __m512 cx, __m512 cy, __m512 cz,
                        __m512 squared) {
  const __m512 dx = _mm512_sub_ps(_mm512_loadu_ps(x), cx), dy = _mm512_sub_ps(_mm512_loadu_ps(y), cy);
  const __m512 dz = _mm512_sub_ps(_mm512_loadu_ps(z), cz);
  const __m512 sum = _mm512_add_ps(_mm512_add_ps(_mm512_mul_ps(dx, dx), _mm512_mul_ps(dy, dy)), _mm512_mul_ps(dz, dz));
  return _mm512_cmp_ps_mask(sum, squared, _CMP_LE_OQ);
}

std::size_t within(const float* x, const float* y, const float* z, std::size_t lanes, const float* c, float squared,
                   std::uint32_t* found) {
  const __m512 cx = _mm512_set1_ps(c[0]), cy = _mm512_set1_ps(c[1]), cz = _mm512_set1_ps(c[2]);
  const __m512 bound = _mm512_set1_ps(squared);
  __m512i index = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
  std::size_t count = 0;
  for (std::size_t n = 0; n < lanes; n += 16) {
    const __mmask16 mask = closer(x + n, y + n, z + n, cx, cy, cz, bound);
    _mm512_storeu_si512(found + count, _mm512_maskz_compress_epi32(mask, index));
    count += static_cast<std::size_t>(__builtin_popcount(mask));
    index = _mm512_add_epi32(index, _mm512_set1_epi32(16));
  }
  return count;
}

bool anyWithin(const float* x, const float* y, const float* z, std::size_t lanes, const float* c, float squared) {
  const __m512 cx = _mm512_set1_ps(c[0]), cy = _mm512_set1_ps(c[1]), cz = _mm512_set1_ps(c[2]);
  const __m512 bound = _mm512_set1_ps(squared);
  for (std::size_t n = 0; n < lanes; n += 16) {
    if (closer(x + n, y + n, z + n, cx, cy, cz, bound) != 0) return true;
  }
  return false;
}

#include "points/real_avx512.h"
// Uses what is defined above.
#include "points/near_kernels_body.h"

}  // namespace accessvdb::internal::near_avx512
#pragma GCC pop_options

#pragma GCC push_options
#pragma GCC target("avx2,bmi,bmi2,lzcnt,popcnt")
namespace accessvdb::internal::near_avx2 {

inline unsigned closer(const float* x, const float* y, const float* z, __m256 cx, __m256 cy, __m256 cz,
                       __m256 squared) {
  const __m256 dx = _mm256_sub_ps(_mm256_loadu_ps(x), cx), dy = _mm256_sub_ps(_mm256_loadu_ps(y), cy);
  const __m256 dz = _mm256_sub_ps(_mm256_loadu_ps(z), cz);
  const __m256 sum = _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(dx, dx), _mm256_mul_ps(dy, dy)), _mm256_mul_ps(dz, dz));
  return static_cast<unsigned>(_mm256_movemask_ps(_mm256_cmp_ps(sum, squared, _CMP_LE_OQ)));
}

std::size_t within(const float* x, const float* y, const float* z, std::size_t lanes, const float* c, float squared,
                   std::uint32_t* found) {
  const __m256 cx = _mm256_set1_ps(c[0]), cy = _mm256_set1_ps(c[1]), cz = _mm256_set1_ps(c[2]);
  const __m256 bound = _mm256_set1_ps(squared);
  std::size_t count = 0;
  for (std::size_t n = 0; n < lanes; n += 8) {
    for (unsigned mask = closer(x + n, y + n, z + n, cx, cy, cz, bound); mask != 0; mask &= mask - 1) {
      found[count++] = static_cast<std::uint32_t>(n) + static_cast<std::uint32_t>(__builtin_ctz(mask));
    }
  }
  return count;
}

bool anyWithin(const float* x, const float* y, const float* z, std::size_t lanes, const float* c, float squared) {
  const __m256 cx = _mm256_set1_ps(c[0]), cy = _mm256_set1_ps(c[1]), cz = _mm256_set1_ps(c[2]);
  const __m256 bound = _mm256_set1_ps(squared);
  for (std::size_t n = 0; n < lanes; n += 8) {
    if (closer(x + n, y + n, z + n, cx, cy, cz, bound) != 0) return true;
  }
  return false;
}

#include "points/real_avx2.h"
// Uses what is defined above.
#include "points/near_kernels_body.h"

}  // namespace accessvdb::internal::near_avx2
#pragma GCC pop_options
#endif

#if ACCESSVDB_NEON_KERNELS
namespace accessvdb::internal::near_neon {

inline unsigned closer(const float* x, const float* y, const float* z, float32x4_t cx, float32x4_t cy, float32x4_t cz,
                       float32x4_t squared) {
  const float32x4_t dx = vsubq_f32(vld1q_f32(x), cx), dy = vsubq_f32(vld1q_f32(y), cy);
  const float32x4_t dz = vsubq_f32(vld1q_f32(z), cz);
  const float32x4_t sum = vaddq_f32(vaddq_f32(vmulq_f32(dx, dx), vmulq_f32(dy, dy)), vmulq_f32(dz, dz));
  static const std::uint32_t kBit[4] = {1, 2, 4, 8};
  return vaddvq_u32(vandq_u32(vcleq_f32(sum, squared), vld1q_u32(kBit)));
}

std::size_t within(const float* x, const float* y, const float* z, std::size_t lanes, const float* c, float squared,
                   std::uint32_t* found) {
  const float32x4_t cx = vdupq_n_f32(c[0]), cy = vdupq_n_f32(c[1]), cz = vdupq_n_f32(c[2]);
  const float32x4_t bound = vdupq_n_f32(squared);
  std::size_t count = 0;
  for (std::size_t n = 0; n < lanes; n += 4) {
    for (unsigned mask = closer(x + n, y + n, z + n, cx, cy, cz, bound); mask != 0; mask &= mask - 1) {
      found[count++] = static_cast<std::uint32_t>(n) + static_cast<std::uint32_t>(__builtin_ctz(mask));
    }
  }
  return count;
}

bool anyWithin(const float* x, const float* y, const float* z, std::size_t lanes, const float* c, float squared) {
  const float32x4_t cx = vdupq_n_f32(c[0]), cy = vdupq_n_f32(c[1]), cz = vdupq_n_f32(c[2]);
  const float32x4_t bound = vdupq_n_f32(squared);
  for (std::size_t n = 0; n < lanes; n += 4) {
    if (closer(x + n, y + n, z + n, cx, cy, cz, bound) != 0) return true;
  }
  return false;
}

#include "points/real_neon.h"
// Uses what is defined above.
#include "points/near_kernels_body.h"

}  // namespace accessvdb::internal::near_neon
#endif

namespace accessvdb::internal::near_plain {

#include "points/real_plain.h"
// Uses what is defined above.
#include "points/near_kernels_body.h"

}  // namespace accessvdb::internal::near_plain

namespace accessvdb::internal {
namespace {

float squaredDistance(const float* x, const float* y, const float* z, std::size_t n, const float* c) {
  const float dx = x[n] - c[0], dy = y[n] - c[1], dz = z[n] - c[2];
  return (dx * dx + dy * dy) + dz * dz;
}

std::size_t plainWithin(const float* x, const float* y, const float* z, std::size_t lanes, const float* c,
                        float squared, std::uint32_t* found) {
  std::size_t count = 0;
  for (std::size_t n = 0; n < lanes; ++n) {
    found[count] = static_cast<std::uint32_t>(n);
    count += squaredDistance(x, y, z, n, c) <= squared ? 1u : 0u;
  }
  return count;
}

bool plainAnyWithin(const float* x, const float* y, const float* z, std::size_t lanes, const float* c, float squared) {
  for (std::size_t n = 0; n < lanes; ++n) {
    if (squaredDistance(x, y, z, n, c) <= squared) return true;
  }
  return false;
}

constexpr NearKernels kPlain = {"plain",
                                plainWithin,
                                plainAnyWithin,
                                near_plain::measure,
                                near_plain::countWithin,
                                near_plain::listWithin,
                                near_plain::sumsWithin};
#if ACCESSVDB_X86_KERNELS
constexpr NearKernels kAvx512 = {"avx512",
                                 near_avx512::within,
                                 near_avx512::anyWithin,
                                 near_avx512::measure,
                                 near_avx512::countWithin,
                                 near_avx512::listWithin,
                                 near_avx512::sumsWithin};
constexpr NearKernels kAvx2 = {"avx2",
                               near_avx2::within,
                               near_avx2::anyWithin,
                               near_avx2::measure,
                               near_avx2::countWithin,
                               near_avx2::listWithin,
                               near_avx2::sumsWithin};
#elif ACCESSVDB_NEON_KERNELS
constexpr NearKernels kNeon = {"neon",
                               near_neon::within,
                               near_neon::anyWithin,
                               near_neon::measure,
                               near_neon::countWithin,
                               near_neon::listWithin,
                               near_neon::sumsWithin};
#endif

}  // namespace

KernelList<NearKernels> runnableNearKernels() {
#if ACCESSVDB_X86_KERNELS
  return runnableKernels(kAvx512, kAvx2, kPlain);
#elif ACCESSVDB_NEON_KERNELS
  return {{&kNeon, &kPlain, nullptr}, 2};
#else
  return {{&kPlain, nullptr, nullptr}, 1};
#endif
}

const NearKernels& nearKernels() {
  static const NearKernels& best = *runnableNearKernels().kernels[0];
  return best;
}

}  // namespace accessvdb::internal

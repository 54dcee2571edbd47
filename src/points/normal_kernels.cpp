// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/normal_kernels.h"

// No standard library code inside the regions: an inline function compiled there could end up being used everywhere.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define ACCESSVDB_X86_KERNELS 1
#include <immintrin.h>
#else
#define ACCESSVDB_X86_KERNELS 0
#endif

#if ACCESSVDB_X86_KERNELS
#pragma GCC push_options
#pragma GCC target("avx512f,avx512vl,avx512dq,avx512bw,avx2,bmi,bmi2,lzcnt,popcnt")
namespace accessvdb::internal::normals_avx512 {

using Real = __m512d;
using Flag = __mmask8;
constexpr int kLanes = 8;
inline Real real(double value) { return _mm512_set1_pd(value); }
inline Real load(const double* from) { return _mm512_loadu_pd(from); }
inline void storeFloats(float* to, Real x) { _mm256_storeu_ps(to, _mm512_cvtpd_ps(x)); }
inline Real plus(Real x, Real y) { return _mm512_add_pd(x, y); }
inline Real minus(Real x, Real y) { return _mm512_sub_pd(x, y); }
inline Real times(Real x, Real y) { return _mm512_mul_pd(x, y); }
inline Real over(Real x, Real y) { return _mm512_div_pd(x, y); }
inline Real root(Real x) { return _mm512_sqrt_pd(x); }
inline Real negative(Real x) { return _mm512_xor_pd(x, _mm512_set1_pd(-0.0)); }
inline Real magnitude(Real x) { return _mm512_abs_pd(x); }
inline Real lower(Real x, Real y) { return _mm512_min_pd(x, y); }
inline Real higher(Real x, Real y) { return _mm512_max_pd(x, y); }
inline Flag isBelow(Real x, Real y) { return _mm512_cmp_pd_mask(x, y, _CMP_LT_OQ); }
inline Flag atMost(Real x, Real y) { return _mm512_cmp_pd_mask(x, y, _CMP_LE_OQ); }
inline Flag differ(Real x, Real y) { return _mm512_cmp_pd_mask(x, y, _CMP_NEQ_UQ); }
inline Real choose(Flag flag, Real yes, Real no) { return _mm512_mask_blend_pd(flag, no, yes); }
inline bool areAll(Flag flag) { return flag == 0xff; }
inline bool areNone(Flag flag) { return flag == 0; }
// What it is in terms of comes first.
#include "hostdev/surface_normal_body.h"
#include "points/normal_kernels_body.h"

}  // namespace accessvdb::internal::normals_avx512
#pragma GCC pop_options

#pragma GCC push_options
#pragma GCC target("avx2,bmi,bmi2,lzcnt,popcnt")
namespace accessvdb::internal::normals_avx2 {

using Real = __m256d;
using Flag = __m256d;
constexpr int kLanes = 4;
inline Real real(double value) { return _mm256_set1_pd(value); }
inline Real load(const double* from) { return _mm256_loadu_pd(from); }
inline void storeFloats(float* to, Real x) { _mm_storeu_ps(to, _mm256_cvtpd_ps(x)); }
inline Real plus(Real x, Real y) { return _mm256_add_pd(x, y); }
inline Real minus(Real x, Real y) { return _mm256_sub_pd(x, y); }
inline Real times(Real x, Real y) { return _mm256_mul_pd(x, y); }
inline Real over(Real x, Real y) { return _mm256_div_pd(x, y); }
inline Real root(Real x) { return _mm256_sqrt_pd(x); }
inline Real negative(Real x) { return _mm256_xor_pd(x, _mm256_set1_pd(-0.0)); }
inline Real magnitude(Real x) { return _mm256_andnot_pd(_mm256_set1_pd(-0.0), x); }
inline Real lower(Real x, Real y) { return _mm256_min_pd(x, y); }
inline Real higher(Real x, Real y) { return _mm256_max_pd(x, y); }
inline Flag isBelow(Real x, Real y) { return _mm256_cmp_pd(x, y, _CMP_LT_OQ); }
inline Flag atMost(Real x, Real y) { return _mm256_cmp_pd(x, y, _CMP_LE_OQ); }
inline Flag differ(Real x, Real y) { return _mm256_cmp_pd(x, y, _CMP_NEQ_UQ); }
inline Real choose(Flag flag, Real yes, Real no) { return _mm256_blendv_pd(no, yes, flag); }
inline bool areAll(Flag flag) { return _mm256_movemask_pd(flag) == 0xf; }
inline bool areNone(Flag flag) { return _mm256_movemask_pd(flag) == 0; }
// What it is in terms of comes first.
#include "hostdev/surface_normal_body.h"
#include "points/normal_kernels_body.h"

}  // namespace accessvdb::internal::normals_avx2
#pragma GCC pop_options
#endif

namespace accessvdb::internal {
namespace {

void oneByOne(const kernels::Covariance* covariances, std::size_t count, float* normals) {
  for (std::size_t n = 0; n < count; ++n) kernels::smallestEigenvector(covariances[n], normals + 3 * n);
}

constexpr NormalKernels kPlain = {"plain", oneByOne};
#if ACCESSVDB_X86_KERNELS
constexpr NormalKernels kAvx512 = {"avx512", normals_avx512::smallestEigenvectors};
constexpr NormalKernels kAvx2 = {"avx2", normals_avx2::smallestEigenvectors};
#endif

}  // namespace

NormalKernelList runnableNormalKernels() {
#if ACCESSVDB_X86_KERNELS
  const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2");
  const bool avx512 = avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
                      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw");
  if (avx512) return {{&kAvx512, &kAvx2, &kPlain}, 3};
  if (avx2) return {{&kAvx2, &kPlain, nullptr}, 2};
#endif
  return {{&kPlain, nullptr, nullptr}, 1};
}

const NormalKernels& normalKernels() {
  static const NormalKernels& best = *runnableNormalKernels().kernels[0];
  return best;
}

}  // namespace accessvdb::internal

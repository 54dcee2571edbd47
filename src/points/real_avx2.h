// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Four doubles at a time. Included inside a namespace, in a region compiled for AVX2; hence no include guard.

using Real = __m256d;
using Flag = __m256d;
constexpr int kLanes = 4;
inline Real real(double value) { return _mm256_set1_pd(value); }
inline Real load(const double* from) { return _mm256_loadu_pd(from); }
inline Real loadFloats(const float* from) { return _mm256_cvtps_pd(_mm_loadu_ps(from)); }
inline void store(double* to, Real x) { _mm256_storeu_pd(to, x); }
inline void storeFloats(float* to, Real x) { _mm_storeu_ps(to, _mm256_cvtpd_ps(x)); }
inline Real plus(Real x, Real y) { return _mm256_add_pd(x, y); }
inline Real minus(Real x, Real y) { return _mm256_sub_pd(x, y); }
inline Real times(Real x, Real y) { return _mm256_mul_pd(x, y); }
inline Real over(Real x, Real y) { return _mm256_div_pd(x, y); }
inline Real root(Real x) { return _mm256_sqrt_pd(x); }
inline Real roundedDown(Real x) { return _mm256_floor_pd(x); }
inline Real negative(Real x) { return _mm256_xor_pd(x, _mm256_set1_pd(-0.0)); }
inline Real magnitude(Real x) { return _mm256_andnot_pd(_mm256_set1_pd(-0.0), x); }
inline Real lower(Real x, Real y) { return _mm256_min_pd(x, y); }
inline Real higher(Real x, Real y) { return _mm256_max_pd(x, y); }
inline Flag isBelow(Real x, Real y) { return _mm256_cmp_pd(x, y, _CMP_LT_OQ); }
inline Flag atMost(Real x, Real y) { return _mm256_cmp_pd(x, y, _CMP_LE_OQ); }
inline Flag differ(Real x, Real y) { return _mm256_cmp_pd(x, y, _CMP_NEQ_UQ); }
inline Real choose(Flag flag, Real yes, Real no) { return _mm256_blendv_pd(no, yes, flag); }
inline unsigned bitsOf(Flag flag) { return static_cast<unsigned>(_mm256_movemask_pd(flag)); }
inline bool areAll(Flag flag) { return _mm256_movemask_pd(flag) == 0xf; }
inline bool areNone(Flag flag) { return _mm256_movemask_pd(flag) == 0; }

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Eight doubles at a time. Included inside a namespace, in a region compiled for AVX-512; hence no include guard.

using Real = __m512d;
using Flag = __mmask8;
constexpr int kLanes = 8;
inline Real real(double value) { return _mm512_set1_pd(value); }
inline Real load(const double* from) { return _mm512_loadu_pd(from); }
inline Real loadFloats(const float* from) { return _mm512_cvtps_pd(_mm256_loadu_ps(from)); }
inline void store(double* to, Real x) { _mm512_storeu_pd(to, x); }
inline void storeFloats(float* to, Real x) { _mm256_storeu_ps(to, _mm512_cvtpd_ps(x)); }
inline Real plus(Real x, Real y) { return _mm512_add_pd(x, y); }
inline Real minus(Real x, Real y) { return _mm512_sub_pd(x, y); }
inline Real times(Real x, Real y) { return _mm512_mul_pd(x, y); }
inline Real over(Real x, Real y) { return _mm512_div_pd(x, y); }
inline Real root(Real x) { return _mm512_sqrt_pd(x); }
inline Real roundedDown(Real x) { return _mm512_floor_pd(x); }
inline Real negative(Real x) { return _mm512_xor_pd(x, _mm512_set1_pd(-0.0)); }
inline Real magnitude(Real x) { return _mm512_abs_pd(x); }
inline Real lower(Real x, Real y) { return _mm512_min_pd(x, y); }
inline Real higher(Real x, Real y) { return _mm512_max_pd(x, y); }
inline Flag isBelow(Real x, Real y) { return _mm512_cmp_pd_mask(x, y, _CMP_LT_OQ); }
inline Flag atMost(Real x, Real y) { return _mm512_cmp_pd_mask(x, y, _CMP_LE_OQ); }
inline Flag differ(Real x, Real y) { return _mm512_cmp_pd_mask(x, y, _CMP_NEQ_UQ); }
inline Real choose(Flag flag, Real yes, Real no) { return _mm512_mask_blend_pd(flag, no, yes); }
inline unsigned bitsOf(Flag flag) { return flag; }
inline bool areAll(Flag flag) { return flag == 0xff; }
inline bool areNone(Flag flag) { return flag == 0; }

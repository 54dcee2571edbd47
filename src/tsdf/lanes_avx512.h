// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Sixteen lanes in one register. Included inside a namespace by leaf_kernels.cpp, hence no include guard.
using Floats = __m512;
using Ints = __m512i;
using Mask = __mmask16;

inline Floats all(float value) { return _mm512_set1_ps(value); }
inline Ints allInts(std::int32_t value) { return _mm512_set1_epi32(value); }
inline Floats loadFloats(const float* from) { return _mm512_load_ps(from); }
inline Ints loadInts(const std::uint32_t* from) { return _mm512_loadu_si512(from); }
inline void store(std::uint32_t* to, Ints a) { _mm512_storeu_si512(to, a); }
inline Floats add(Floats a, Floats b) { return _mm512_add_ps(a, b); }
inline Floats sub(Floats a, Floats b) { return _mm512_sub_ps(a, b); }
inline Floats mul(Floats a, Floats b) { return _mm512_mul_ps(a, b); }
inline Floats div(Floats a, Floats b) { return _mm512_div_ps(a, b); }
inline Floats squareRoot(Floats a) { return _mm512_sqrt_ps(a); }
inline Floats least(Floats a, Floats b) { return _mm512_min_ps(a, b); }
inline Floats most(Floats a, Floats b) { return _mm512_max_ps(a, b); }
inline Floats absolute(Floats a) { return _mm512_abs_ps(a); }
inline Mask greater(Floats a, Floats b) { return _mm512_cmp_ps_mask(a, b, _CMP_GT_OQ); }
inline Mask atMost(Floats a, Floats b) { return _mm512_cmp_ps_mask(a, b, _CMP_LE_OQ); }
inline Mask either(Mask a, Mask b) { return _kor_mask16(a, b); }
inline Mask both(Mask a, Mask b) { return _kand_mask16(a, b); }
inline Ints truncate(Floats a) { return _mm512_cvttps_epi32(a); }
inline Ints addInts(Ints a, Ints b) { return _mm512_add_epi32(a, b); }
inline Ints leastInts(Ints a, Ints b) { return _mm512_min_epi32(a, b); }
inline Ints mostInts(Ints a, Ints b) { return _mm512_max_epi32(a, b); }
inline Ints bitAnd(Ints a, Ints b) { return _mm512_and_si512(a, b); }
inline Ints bitOr(Ints a, Ints b) { return _mm512_or_si512(a, b); }
inline Ints shiftLeft(Ints a, unsigned n) { return _mm512_slli_epi32(a, n); }
inline Ints shiftRight(Ints a, unsigned n) { return _mm512_srli_epi32(a, n); }
inline Mask lessInts(Ints a, Ints b) { return _mm512_cmplt_epi32_mask(a, b); }
inline Ints choose(std::uint32_t mask, Ints yes, Ints no) {
  return _mm512_mask_blend_epi32(static_cast<__mmask16>(mask), no, yes);
}
/// Pairs of rows with any bit set.
inline std::uint32_t pairsOf(const LeafBits& bits) {
  const __m512i all_bits = _mm512_loadu_si512(bits.data());
  return _mm512_test_epi16_mask(all_bits, all_bits);
}
inline std::uint32_t sumOf(Ints a) { return static_cast<std::uint32_t>(_mm512_reduce_add_epi32(a)); }

/// 1 / x to 50 bits and more; a division of eight doubles takes the divider 16 cycles.
inline __m512d reciprocalOf(__m512d x) {
  const __m512d one = _mm512_set1_pd(1.0);
  __m512d r = _mm512_rcp14_pd(x);
  r = _mm512_fmadd_pd(r, _mm512_fnmadd_pd(x, r, one), r);
  return _mm512_fmadd_pd(r, _mm512_fnmadd_pd(x, r, one), r);
}
/// Exact, though the quotient is not: it lies below 2^20, so that it is wrong by less than 2^-28. A total has 16 bits,
/// so a quotient that is no half and rounds down lies 2^-17 or more below the half. The 2^-24 brings halves over and no
/// other.
inline __m256i meanOfHalf(__m256i mean, __m256i weight, __m256i sum, __m256i total) {
  const __m512d product = _mm512_mul_pd(_mm512_cvtepi32_pd(mean), _mm512_cvtepi32_pd(weight));
  const __m512d numerator = _mm512_fmadd_pd(_mm512_set1_pd(16.0), _mm512_cvtepi32_pd(sum), product);
  const __m512d quotient = _mm512_mul_pd(numerator, reciprocalOf(_mm512_cvtepi32_pd(total)));
  return _mm512_cvttpd_epi32(_mm512_add_pd(quotient, _mm512_set1_pd(0.5 + 0x1p-24)));
}
/// (mean * weight + 16 * sum) / total, rounded to nearest.
inline Ints foldedMean(Ints mean, Ints weight, Ints sum, Ints total) {
  const __m256i low = meanOfHalf(_mm512_castsi512_si256(mean), _mm512_castsi512_si256(weight),
                                 _mm512_castsi512_si256(sum), _mm512_castsi512_si256(total));
  const __m256i high = meanOfHalf(_mm512_extracti64x4_epi64(mean, 1), _mm512_extracti64x4_epi64(weight, 1),
                                  _mm512_extracti64x4_epi64(sum, 1), _mm512_extracti64x4_epi64(total, 1));
  return _mm512_inserti64x4(_mm512_castsi256_si512(low), high, 1);
}

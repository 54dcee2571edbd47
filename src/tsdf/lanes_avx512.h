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
inline Ints truncate(Floats a) { return _mm512_cvttps_epi32(a); }
/// The same where `among` is set, and zero elsewhere.
inline Mask greater(Mask among, Floats a, Floats b) { return _mm512_mask_cmp_ps_mask(among, a, b, _CMP_GT_OQ); }
inline Mask atMost(Mask among, Floats a, Floats b) { return _mm512_mask_cmp_ps_mask(among, a, b, _CMP_LE_OQ); }
inline Floats toFloats(Ints a) { return _mm512_cvtepi32_ps(a); }
inline Ints addInts(Ints a, Ints b) { return _mm512_add_epi32(a, b); }
inline Ints subInts(Ints a, Ints b) { return _mm512_sub_epi32(a, b); }
inline Ints mulInts(Ints a, Ints b) { return _mm512_mullo_epi32(a, b); }
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

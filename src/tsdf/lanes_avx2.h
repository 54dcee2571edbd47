// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Sixteen lanes in two registers. Included inside a namespace by leaf_kernels.cpp, hence no include guard.
struct Floats {
  __m256 a, b;
};
struct Ints {
  __m256i a, b;
};
using Mask = std::uint32_t;

inline Floats all(float value) { return {_mm256_set1_ps(value), _mm256_set1_ps(value)}; }
inline Ints allInts(std::int32_t value) { return {_mm256_set1_epi32(value), _mm256_set1_epi32(value)}; }
inline Floats loadFloats(const float* from) { return {_mm256_load_ps(from), _mm256_load_ps(from + 8)}; }
inline Ints loadInts(const std::uint32_t* from) {
  return {_mm256_loadu_si256(reinterpret_cast<const __m256i*>(from)),
          _mm256_loadu_si256(reinterpret_cast<const __m256i*>(from + 8))};
}
inline void store(std::uint32_t* to, Ints x) {
  _mm256_storeu_si256(reinterpret_cast<__m256i*>(to), x.a);
  _mm256_storeu_si256(reinterpret_cast<__m256i*>(to + 8), x.b);
}
inline Floats add(Floats x, Floats y) { return {_mm256_add_ps(x.a, y.a), _mm256_add_ps(x.b, y.b)}; }
inline Floats sub(Floats x, Floats y) { return {_mm256_sub_ps(x.a, y.a), _mm256_sub_ps(x.b, y.b)}; }
inline Floats mul(Floats x, Floats y) { return {_mm256_mul_ps(x.a, y.a), _mm256_mul_ps(x.b, y.b)}; }
inline Floats div(Floats x, Floats y) { return {_mm256_div_ps(x.a, y.a), _mm256_div_ps(x.b, y.b)}; }
inline Floats squareRoot(Floats x) { return {_mm256_sqrt_ps(x.a), _mm256_sqrt_ps(x.b)}; }
inline Floats least(Floats x, Floats y) { return {_mm256_min_ps(x.a, y.a), _mm256_min_ps(x.b, y.b)}; }
inline Floats most(Floats x, Floats y) { return {_mm256_max_ps(x.a, y.a), _mm256_max_ps(x.b, y.b)}; }
inline Floats absolute(Floats x) {
  const __m256 sign = _mm256_set1_ps(-0.0f);
  return {_mm256_andnot_ps(sign, x.a), _mm256_andnot_ps(sign, x.b)};
}
inline std::uint32_t bitsOf(__m256 a, __m256 b) {
  return static_cast<std::uint32_t>(_mm256_movemask_ps(a)) | static_cast<std::uint32_t>(_mm256_movemask_ps(b)) << 8;
}
inline Mask greater(Floats x, Floats y) {
  return bitsOf(_mm256_cmp_ps(x.a, y.a, _CMP_GT_OQ), _mm256_cmp_ps(x.b, y.b, _CMP_GT_OQ));
}
inline Mask atMost(Floats x, Floats y) {
  return bitsOf(_mm256_cmp_ps(x.a, y.a, _CMP_LE_OQ), _mm256_cmp_ps(x.b, y.b, _CMP_LE_OQ));
}
inline Ints truncate(Floats x) { return {_mm256_cvttps_epi32(x.a), _mm256_cvttps_epi32(x.b)}; }
/// The same where `among` is set, and zero elsewhere.
inline Mask greater(Mask among, Floats x, Floats y) { return among & greater(x, y); }
inline Mask atMost(Mask among, Floats x, Floats y) { return among & atMost(x, y); }
inline Floats toFloats(Ints x) { return {_mm256_cvtepi32_ps(x.a), _mm256_cvtepi32_ps(x.b)}; }
inline Ints addInts(Ints x, Ints y) { return {_mm256_add_epi32(x.a, y.a), _mm256_add_epi32(x.b, y.b)}; }
inline Ints subInts(Ints x, Ints y) { return {_mm256_sub_epi32(x.a, y.a), _mm256_sub_epi32(x.b, y.b)}; }
inline Ints mulInts(Ints x, Ints y) { return {_mm256_mullo_epi32(x.a, y.a), _mm256_mullo_epi32(x.b, y.b)}; }
inline Ints leastInts(Ints x, Ints y) { return {_mm256_min_epi32(x.a, y.a), _mm256_min_epi32(x.b, y.b)}; }
inline Ints mostInts(Ints x, Ints y) { return {_mm256_max_epi32(x.a, y.a), _mm256_max_epi32(x.b, y.b)}; }
inline Ints bitAnd(Ints x, Ints y) { return {_mm256_and_si256(x.a, y.a), _mm256_and_si256(x.b, y.b)}; }
inline Ints bitOr(Ints x, Ints y) { return {_mm256_or_si256(x.a, y.a), _mm256_or_si256(x.b, y.b)}; }
inline Ints shiftLeft(Ints x, unsigned n) {
  return {_mm256_slli_epi32(x.a, static_cast<int>(n)), _mm256_slli_epi32(x.b, static_cast<int>(n))};
}
inline Ints shiftRight(Ints x, unsigned n) {
  return {_mm256_srli_epi32(x.a, static_cast<int>(n)), _mm256_srli_epi32(x.b, static_cast<int>(n))};
}
inline Mask lessInts(Ints x, Ints y) {
  return bitsOf(_mm256_castsi256_ps(_mm256_cmpgt_epi32(y.a, x.a)), _mm256_castsi256_ps(_mm256_cmpgt_epi32(y.b, x.b)));
}
inline __m256i lanesOf(std::uint32_t bits) {
  const __m256i each = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
  return _mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32(static_cast<int>(bits)), each), each);
}
inline Ints choose(std::uint32_t mask, Ints yes, Ints no) {
  return {_mm256_blendv_epi8(no.a, yes.a, lanesOf(mask)), _mm256_blendv_epi8(no.b, yes.b, lanesOf(mask >> 8))};
}
/// Pairs of rows with any bit set.
inline std::uint32_t pairsOf(const LeafBits& bits) {
  const __m256i zero = _mm256_setzero_si256();
  const __m256i low = _mm256_cmpeq_epi16(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(bits.data())), zero);
  const __m256i high = _mm256_cmpeq_epi16(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(bits.data() + 4)), zero);
  const __m256i bytes = _mm256_permute4x64_epi64(_mm256_packs_epi16(low, high), 0xd8);  // packs works in halves
  return ~static_cast<std::uint32_t>(_mm256_movemask_epi8(bytes));
}
inline std::uint32_t sumOf(Ints x) {
  const __m256i pairs = _mm256_add_epi32(x.a, x.b);
  __m128i four = _mm_add_epi32(_mm256_castsi256_si128(pairs), _mm256_extracti128_si256(pairs, 1));
  four = _mm_add_epi32(four, _mm_shuffle_epi32(four, 0x4e));
  four = _mm_add_epi32(four, _mm_shuffle_epi32(four, 0xb1));
  return static_cast<std::uint32_t>(_mm_cvtsi128_si32(four));
}

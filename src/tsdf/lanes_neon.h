// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Sixteen lanes in four registers of 64-bit ARM. Included inside a namespace by leaf_kernels.cpp, hence no include
// guard.
struct Floats {
  float32x4_t a, b, c, d;
};
struct Ints {
  int32x4_t a, b, c, d;
};
using Mask = std::uint32_t;

// One instruction over the four registers.
#define ACCESSVDB_LANES(Type, name, instruction)                                                         \
  inline Type name(const Type& x, const Type& y) {                                                       \
    return {instruction(x.a, y.a), instruction(x.b, y.b), instruction(x.c, y.c), instruction(x.d, y.d)}; \
  }
#define ACCESSVDB_LANES_OF_ONE(Type, From, name, instruction) \
  inline Type name(const From& x) { return {instruction(x.a), instruction(x.b), instruction(x.c), instruction(x.d)}; }

inline Floats all(float value) {
  const float32x4_t four = vdupq_n_f32(value);
  return {four, four, four, four};
}
inline Ints allInts(std::int32_t value) {
  const int32x4_t four = vdupq_n_s32(value);
  return {four, four, four, four};
}
inline Floats loadFloats(const float* from) {
  return {vld1q_f32(from), vld1q_f32(from + 4), vld1q_f32(from + 8), vld1q_f32(from + 12)};
}
inline int32x4_t loadFour(const std::uint32_t* from) { return vreinterpretq_s32_u32(vld1q_u32(from)); }
inline Ints loadInts(const std::uint32_t* from) {
  return {loadFour(from), loadFour(from + 4), loadFour(from + 8), loadFour(from + 12)};
}
inline void store(std::uint32_t* to, const Ints& x) {
  vst1q_u32(to, vreinterpretq_u32_s32(x.a));
  vst1q_u32(to + 4, vreinterpretq_u32_s32(x.b));
  vst1q_u32(to + 8, vreinterpretq_u32_s32(x.c));
  vst1q_u32(to + 12, vreinterpretq_u32_s32(x.d));
}
// Like the other sets, and unlike vminq and vmaxq, the second where the two do not compare.
inline float32x4_t leastOfFour(float32x4_t x, float32x4_t y) { return vbslq_f32(vcltq_f32(x, y), x, y); }
inline float32x4_t mostOfFour(float32x4_t x, float32x4_t y) { return vbslq_f32(vcgtq_f32(x, y), x, y); }
ACCESSVDB_LANES(Floats, add, vaddq_f32)
ACCESSVDB_LANES(Floats, sub, vsubq_f32)
ACCESSVDB_LANES(Floats, mul, vmulq_f32)
ACCESSVDB_LANES(Floats, div, vdivq_f32)
ACCESSVDB_LANES(Floats, least, leastOfFour)
ACCESSVDB_LANES(Floats, most, mostOfFour)
ACCESSVDB_LANES(Ints, addInts, vaddq_s32)
ACCESSVDB_LANES(Ints, subInts, vsubq_s32)
ACCESSVDB_LANES(Ints, mulInts, vmulq_s32)
ACCESSVDB_LANES(Ints, leastInts, vminq_s32)
ACCESSVDB_LANES(Ints, mostInts, vmaxq_s32)
ACCESSVDB_LANES(Ints, bitAnd, vandq_s32)
ACCESSVDB_LANES(Ints, bitOr, vorrq_s32)
ACCESSVDB_LANES_OF_ONE(Floats, Floats, squareRoot, vsqrtq_f32)
ACCESSVDB_LANES_OF_ONE(Floats, Floats, absolute, vabsq_f32)
ACCESSVDB_LANES_OF_ONE(Ints, Floats, truncate, vcvtq_s32_f32)
ACCESSVDB_LANES_OF_ONE(Floats, Ints, toFloats, vcvtq_f32_s32)
#undef ACCESSVDB_LANES
#undef ACCESSVDB_LANES_OF_ONE

/// One bit per byte of a vector of flags.
inline std::uint32_t bitsOfBytes(uint8x16_t flags) {
  static const std::uint8_t kBit[16] = {1, 2, 4, 8, 16, 32, 64, 128, 1, 2, 4, 8, 16, 32, 64, 128};
  const uint8x16_t bits = vandq_u8(flags, vld1q_u8(kBit));
  return std::uint32_t{vaddv_u8(vget_low_u8(bits))} | std::uint32_t{vaddv_u8(vget_high_u8(bits))} << 8;
}
inline std::uint32_t bitsOf(uint32x4_t a, uint32x4_t b, uint32x4_t c, uint32x4_t d) {
  const uint16x8_t low = vcombine_u16(vmovn_u32(a), vmovn_u32(b)), high = vcombine_u16(vmovn_u32(c), vmovn_u32(d));
  return bitsOfBytes(vcombine_u8(vmovn_u16(low), vmovn_u16(high)));
}
inline Mask greater(const Floats& x, const Floats& y) {
  return bitsOf(vcgtq_f32(x.a, y.a), vcgtq_f32(x.b, y.b), vcgtq_f32(x.c, y.c), vcgtq_f32(x.d, y.d));
}
inline Mask atMost(const Floats& x, const Floats& y) {
  return bitsOf(vcleq_f32(x.a, y.a), vcleq_f32(x.b, y.b), vcleq_f32(x.c, y.c), vcleq_f32(x.d, y.d));
}
/// The same where `among` is set, and zero elsewhere.
inline Mask greater(Mask among, const Floats& x, const Floats& y) { return among & greater(x, y); }
inline Mask atMost(Mask among, const Floats& x, const Floats& y) { return among & atMost(x, y); }
inline Mask lessInts(const Ints& x, const Ints& y) {
  return bitsOf(vcltq_s32(x.a, y.a), vcltq_s32(x.b, y.b), vcltq_s32(x.c, y.c), vcltq_s32(x.d, y.d));
}
inline Ints shiftLeft(const Ints& x, unsigned n) {
  const int32x4_t by = vdupq_n_s32(static_cast<int>(n));
  return {vshlq_s32(x.a, by), vshlq_s32(x.b, by), vshlq_s32(x.c, by), vshlq_s32(x.d, by)};
}
inline int32x4_t shiftedRight(int32x4_t x, int32x4_t by) {
  return vreinterpretq_s32_u32(vshlq_u32(vreinterpretq_u32_s32(x), by));
}
inline Ints shiftRight(const Ints& x, unsigned n) {
  const int32x4_t by = vdupq_n_s32(-static_cast<int>(n));  // to the left by less than nothing
  return {shiftedRight(x.a, by), shiftedRight(x.b, by), shiftedRight(x.c, by), shiftedRight(x.d, by)};
}
inline Ints choose(std::uint32_t mask, const Ints& yes, const Ints& no) {
  static const std::uint32_t kBit[16] = {1u << 0, 1u << 1, 1u << 2,  1u << 3,  1u << 4,  1u << 5,  1u << 6,  1u << 7,
                                         1u << 8, 1u << 9, 1u << 10, 1u << 11, 1u << 12, 1u << 13, 1u << 14, 1u << 15};
  const uint32x4_t bits = vdupq_n_u32(mask);
  return {vbslq_s32(vtstq_u32(bits, vld1q_u32(kBit)), yes.a, no.a),
          vbslq_s32(vtstq_u32(bits, vld1q_u32(kBit + 4)), yes.b, no.b),
          vbslq_s32(vtstq_u32(bits, vld1q_u32(kBit + 8)), yes.c, no.c),
          vbslq_s32(vtstq_u32(bits, vld1q_u32(kBit + 12)), yes.d, no.d)};
}
/// Eight pairs of rows, each with all bits set if any is. @param words  [2]
inline uint8x8_t pairsOfWords(const std::uint64_t* words) {
  const uint16x8_t pairs = vreinterpretq_u16_u64(vld1q_u64(words));
  return vmovn_u16(vtstq_u16(pairs, pairs));
}
/// Pairs of rows with any bit set.
inline std::uint32_t pairsOf(const LeafBits& bits) {
  return bitsOfBytes(vcombine_u8(pairsOfWords(bits.data()), pairsOfWords(bits.data() + 2))) |
         bitsOfBytes(vcombine_u8(pairsOfWords(bits.data() + 4), pairsOfWords(bits.data() + 6))) << 16;
}
inline std::uint32_t sumOf(const Ints& x) {
  return static_cast<std::uint32_t>(vaddvq_s32(vaddq_s32(vaddq_s32(x.a, x.b), vaddq_s32(x.c, x.d))));
}

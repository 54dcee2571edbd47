// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Sixteen lanes in plain C++, for every other machine. Included inside a namespace by leaf_kernels.cpp, hence no
// include guard.
struct Floats {
  float v[16];
};
struct Ints {
  std::int32_t v[16];
};
using Mask = std::uint32_t;

inline Floats all(float value) {
  Floats r;
  for (float& lane : r.v) lane = value;
  return r;
}
inline Ints allInts(std::int32_t value) {
  Ints r;
  for (std::int32_t& lane : r.v) lane = value;
  return r;
}
inline Floats loadFloats(const float* from) {
  Floats r;
  for (int n = 0; n < 16; ++n) r.v[n] = from[n];
  return r;
}
inline Ints loadInts(const std::uint32_t* from) {
  Ints r;
  for (int n = 0; n < 16; ++n) r.v[n] = static_cast<std::int32_t>(from[n]);
  return r;
}
inline void store(std::uint32_t* to, const Ints& a) {
  for (int n = 0; n < 16; ++n) to[n] = static_cast<std::uint32_t>(a.v[n]);
}
// One operation over the lanes; the lanes are independent, so a compiler may use whatever registers there are.
#define ACCESSVDB_LANES(Type, name, expression)    \
  inline Type name(const Type& a, const Type& b) { \
    Type r;                                        \
    for (int n = 0; n < 16; ++n) {                 \
      const auto x = a.v[n], y = b.v[n];           \
      r.v[n] = expression;                         \
    }                                              \
    return r;                                      \
  }
ACCESSVDB_LANES(Floats, add, x + y)
ACCESSVDB_LANES(Floats, sub, x - y)
ACCESSVDB_LANES(Floats, mul, x* y)
ACCESSVDB_LANES(Floats, div, x / y)
ACCESSVDB_LANES(Floats, least, x < y ? x : y)
ACCESSVDB_LANES(Floats, most, x > y ? x : y)
ACCESSVDB_LANES(Ints, addInts, x + y)
ACCESSVDB_LANES(Ints, subInts, x - y)
ACCESSVDB_LANES(Ints, mulInts, x* y)
ACCESSVDB_LANES(Ints, leastInts, x < y ? x : y)
ACCESSVDB_LANES(Ints, mostInts, x > y ? x : y)
ACCESSVDB_LANES(Ints, bitAnd, x& y)
ACCESSVDB_LANES(Ints, bitOr, x | y)
#undef ACCESSVDB_LANES
inline Floats squareRoot(const Floats& a) {
  Floats r;
  for (int n = 0; n < 16; ++n) r.v[n] = std::sqrt(a.v[n]);
  return r;
}
inline Floats absolute(const Floats& a) {
  Floats r;
  for (int n = 0; n < 16; ++n) r.v[n] = std::fabs(a.v[n]);
  return r;
}
inline Mask greater(const Floats& a, const Floats& b) {
  std::uint32_t bits = 0;
  for (unsigned n = 0; n < 16; ++n) bits |= (a.v[n] > b.v[n] ? 1u : 0u) << n;
  return bits;
}
inline Mask atMost(const Floats& a, const Floats& b) {
  std::uint32_t bits = 0;
  for (unsigned n = 0; n < 16; ++n) bits |= (a.v[n] <= b.v[n] ? 1u : 0u) << n;
  return bits;
}
/// The same where `among` is set, and zero elsewhere.
inline Mask greater(Mask among, const Floats& a, const Floats& b) { return among & greater(a, b); }
inline Mask atMost(Mask among, const Floats& a, const Floats& b) { return among & atMost(a, b); }
inline Mask lessInts(const Ints& a, const Ints& b) {
  std::uint32_t bits = 0;
  for (unsigned n = 0; n < 16; ++n) bits |= (a.v[n] < b.v[n] ? 1u : 0u) << n;
  return bits;
}
inline Ints truncate(const Floats& a) {
  Ints r;
  for (int n = 0; n < 16; ++n) r.v[n] = static_cast<std::int32_t>(a.v[n]);
  return r;
}
inline Floats toFloats(const Ints& a) {
  Floats r;
  for (int n = 0; n < 16; ++n) r.v[n] = static_cast<float>(a.v[n]);
  return r;
}
inline Ints shiftLeft(const Ints& a, unsigned count) {
  Ints r;
  for (int n = 0; n < 16; ++n) r.v[n] = static_cast<std::int32_t>(static_cast<std::uint32_t>(a.v[n]) << count);
  return r;
}
inline Ints shiftRight(const Ints& a, unsigned count) {
  Ints r;
  for (int n = 0; n < 16; ++n) r.v[n] = static_cast<std::int32_t>(static_cast<std::uint32_t>(a.v[n]) >> count);
  return r;
}
inline Ints choose(std::uint32_t mask, const Ints& yes, const Ints& no) {
  Ints r;
  for (unsigned n = 0; n < 16; ++n) r.v[n] = (mask >> n & 1u) != 0 ? yes.v[n] : no.v[n];
  return r;
}
/// Pairs of rows with any bit set.
inline std::uint32_t pairsOf(const LeafBits& bits) {
  std::uint32_t pairs = 0;
  for (unsigned n = 0; n < 32; ++n) pairs |= ((bits[n >> 2] >> (16 * (n & 3)) & 0xffff) != 0 ? 1u : 0u) << n;
  return pairs;
}
inline std::uint32_t sumOf(const Ints& a) {
  std::uint32_t sum = 0;
  for (const std::int32_t lane : a.v) sum += static_cast<std::uint32_t>(lane);
  return sum;
}

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// The 32 lanes of a warp one after the other, in the terms of hostdev/leaf_kernels_body.h: the strips and flags of
// cuda/fusion/lanes_cuda.cuh, for machines without a GPU. Included inside a namespace, hence no include guard.
constexpr int kLanes = 32, kSlabStrips = 2;
constexpr bool kKeepsSlabTerms = false;
constexpr std::size_t kLaneCount = 32;
struct Floats {
  float v[kLaneCount];
};
struct Ints {
  std::int32_t v[kLaneCount];
};
struct Flags {
  std::uint32_t on;  ///< a bit per lane
};
using Mask = Flags;
using Rows = Flags;
using BitWord = std::uint32_t;  ///< of one lane: a bit per strip
using Slab = std::uint64_t;     ///< of all lanes: the strips of the slab
constexpr std::size_t kBitWords = kLaneCount;
struct Bits {
  BitWord of_lane[kLaneCount] = {};
  BitWord& operator[](std::size_t lane) { return of_lane[lane]; }
  const BitWord& operator[](std::size_t lane) const { return of_lane[lane]; }
};
struct Votes {
  Bits bit[3];
};
struct Flips {
  Bits collides_on, collides_off, arm_free_on, arm_free_off;
};
using ScanVerdict = kernels::VerdictOf<Bits>;
using LeafTarget = kernels::LeafTargetOf<Bits, BitWord, Votes>;
using AgedFacts = kernels::AgedFactsOf<Bits>;

template <typename Lanes, typename Of>
Lanes each(const Of& of) {
  Lanes lanes;
  for (std::size_t n = 0; n < kLaneCount; ++n) lanes.v[n] = of(n);
  return lanes;
}
template <typename Of>
Flags flags(const Of& of) {
  Flags lanes = {0};
  for (std::size_t n = 0; n < kLaneCount; ++n) lanes.on |= (of(n) ? 1u : 0u) << n;
  return lanes;
}

inline Floats all(float value) {
  return each<Floats>([&](std::size_t) { return value; });
}
inline Ints allInts(std::int32_t value) {
  return each<Ints>([&](std::size_t) { return value; });
}
inline Floats laneZ() {
  return each<Floats>([](std::size_t n) { return static_cast<float>(n % 8); });
}
inline Floats laneY() {
  return each<Floats>([](std::size_t n) { return static_cast<float>(n / 8); });
}
inline Ints loadInts(const std::uint32_t* from) {
  return each<Ints>([&](std::size_t n) { return static_cast<std::int32_t>(from[n]); });
}
inline void store(std::uint32_t* to, const Ints& a) {
  for (std::size_t n = 0; n < kLaneCount; ++n) to[n] = static_cast<std::uint32_t>(a.v[n]);
}
#define ACCESSVDB_EMULATED(Type, name, expression) \
  inline Type name(const Type& a, const Type& b) { \
    return each<Type>([&](std::size_t n) {         \
      const auto x = a.v[n], y = b.v[n];           \
      return expression;                           \
    });                                            \
  }
ACCESSVDB_EMULATED(Floats, add, x + y)
ACCESSVDB_EMULATED(Floats, sub, x - y)
ACCESSVDB_EMULATED(Floats, mul, x* y)
ACCESSVDB_EMULATED(Floats, div, x / y)
ACCESSVDB_EMULATED(Floats, least, x < y ? x : y)
ACCESSVDB_EMULATED(Floats, most, x > y ? x : y)
ACCESSVDB_EMULATED(Ints, addInts, x + y)
ACCESSVDB_EMULATED(Ints, subInts, x - y)
ACCESSVDB_EMULATED(Ints, mulInts, x* y)
ACCESSVDB_EMULATED(Ints, leastInts, x < y ? x : y)
ACCESSVDB_EMULATED(Ints, mostInts, x > y ? x : y)
ACCESSVDB_EMULATED(Ints, bitAnd, x& y)
ACCESSVDB_EMULATED(Ints, bitOr, x | y)
#undef ACCESSVDB_EMULATED
inline Floats squareRoot(const Floats& a) {
  return each<Floats>([&](std::size_t n) { return std::sqrt(a.v[n]); });
}
inline Floats absolute(const Floats& a) {
  return each<Floats>([&](std::size_t n) { return std::fabs(a.v[n]); });
}
inline float magnitude(float value) { return std::fabs(value); }
inline Ints truncate(const Floats& a) {
  return each<Ints>([&](std::size_t n) { return static_cast<std::int32_t>(a.v[n]); });
}
inline Floats toFloats(const Ints& a) {
  return each<Floats>([&](std::size_t n) { return static_cast<float>(a.v[n]); });
}
inline Ints shiftLeft(const Ints& a, unsigned count) {
  return each<Ints>(
      [&](std::size_t n) { return static_cast<std::int32_t>(static_cast<std::uint32_t>(a.v[n]) << count); });
}
inline Ints shiftRight(const Ints& a, unsigned count) {
  return each<Ints>(
      [&](std::size_t n) { return static_cast<std::int32_t>(static_cast<std::uint32_t>(a.v[n]) >> count); });
}
inline Ints choose(Rows rows, const Ints& yes, const Ints& no) {
  return each<Ints>([&](std::size_t n) { return (rows.on >> n & 1u) != 0 ? yes.v[n] : no.v[n]; });
}

inline Rows operator&(Rows a, Rows b) { return {a.on & b.on}; }
inline Rows operator|(Rows a, Rows b) { return {a.on | b.on}; }
inline Rows operator~(Rows a) { return {~a.on}; }
inline Rows& operator|=(Rows& a, Rows b) { return a = a | b; }
inline Mask greater(const Floats& a, const Floats& b) {
  return flags([&](std::size_t n) { return a.v[n] > b.v[n]; });
}
inline Mask atMost(const Floats& a, const Floats& b) {
  return flags([&](std::size_t n) { return a.v[n] <= b.v[n]; });
}
inline Mask greater(Mask among, const Floats& a, const Floats& b) { return among & greater(a, b); }
inline Mask atMost(Mask among, const Floats& a, const Floats& b) { return among & atMost(a, b); }
inline Rows lessInts(const Ints& a, const Ints& b) {
  return flags([&](std::size_t n) { return a.v[n] < b.v[n]; });
}

inline int lowestBit(std::uint32_t bits) { return std::countr_zero(bits); }
inline int countBits(std::uint32_t word) { return std::popcount(word); }
inline int countBits(Slab slab) { return std::popcount(slab); }
inline bool areNone(Mask mask) { return mask.on == 0; }
inline std::uint32_t sumOfLanes(std::uint32_t count) { return count; }
inline std::uint64_t sumOfLanes(std::uint64_t count) { return count; }
inline std::uint32_t sumOf(const Ints& a) {
  std::uint32_t sum = 0;
  for (const std::int32_t lane : a.v) sum += static_cast<std::uint32_t>(lane);
  return sum;
}

inline const Floats& ofStrip(const Floats (&of)[kSlabStrips], int strip) { return of[strip]; }
inline void setStrip(Slab& slab, int strip, Rows rows) { slab |= std::uint64_t{rows.on} << (32 * strip); }
inline void setStrip(Bits& bits, int strip, Rows rows) {
  for (std::size_t n = 0; n < kLaneCount; ++n) bits[n] |= (rows.on >> n & 1u) << strip;
}
inline void setSlab(Bits& bits, int x, Slab slab) {
  for (int y = 0; y < kSlabStrips; ++y)
    setStrip(bits, kSlabStrips * x + y, {static_cast<std::uint32_t>(slab >> 32 * y)});
}
inline std::uint32_t stripsOf(const Bits& bits) {
  std::uint32_t strips = 0;
  for (const BitWord word : bits.of_lane) strips |= word;
  return strips;
}
struct Inside {
  Bits slabs;
  std::uint32_t strips = 0;
  void add(int x, Slab slab) { setSlab(slabs, x, slab); }
  void finish() { strips = stripsOf(slabs); }
  [[nodiscard]] Rows ofStrip(int strip) const {
    return flags([&](std::size_t n) { return (slabs[n] >> strip & 1u) != 0; });
  }
};

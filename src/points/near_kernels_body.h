// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// The kernels on offsets in steps, for kLanes doubles: included inside a namespace by near_kernels.cpp after one of
// real_*.h, hence no include guard. Offsets and all sums are whole numbers below 2^53, so no operation rounds, and any
// order gives the same bits.

inline void measure(const OffsetArrays& to, const float* c, double steps_per_m) {
  const Real cx = real(static_cast<double>(c[0])), cy = real(static_cast<double>(c[1])),
             cz = real(static_cast<double>(c[2])), steps = real(steps_per_m), half = real(0.5);
  const auto offset = [&](const float* from, Real origin) {
    return roundedDown(plus(times(minus(loadFloats(from), origin), steps), half));
  };
  for (std::size_t n = 0; n < to.count; n += kLanes) {
    const Real x = offset(to.x_m + n, cx), y = offset(to.y_m + n, cy), z = offset(to.z_m + n, cz);
    store(to.x + n, x);
    store(to.y + n, y);
    store(to.z + n, z);
    store(to.squared + n, plus(plus(times(x, x), times(y, y)), times(z, z)));
  }
  for (std::size_t n = to.count; n % OffsetArrays::kPadded != 0; ++n) to.squared[n] = OffsetArrays::kDropped;
}

inline std::size_t countWithin(const OffsetArrays& offsets, double most) {
  const Real bound = real(most);
  std::size_t count = 0;
  for (std::size_t n = 0; n < offsets.count; n += kLanes) {
    count += static_cast<std::size_t>(__builtin_popcount(bitsOf(atMost(load(offsets.squared + n), bound))));
  }
  return count;
}

inline std::size_t listWithin(const OffsetArrays& offsets, double most, std::uint32_t* found) {
  const Real bound = real(most);
  std::size_t count = 0;
  for (std::size_t n = 0; n < offsets.count; n += kLanes) {
    for (unsigned bits = bitsOf(atMost(load(offsets.squared + n), bound)); bits != 0; bits &= bits - 1) {
      found[count++] = static_cast<std::uint32_t>(n) + static_cast<std::uint32_t>(__builtin_ctz(bits));
    }
  }
  return count;
}

inline OffsetSums sumsWithin(const OffsetArrays& offsets, double most) {
  const Real bound = real(most), zero = real(0);
  Real sx = zero, sy = zero, sz = zero, xx = zero, xy = zero, xz = zero, yy = zero, yz = zero, zz = zero;
  Real farthest = zero;
  OffsetSums sums = {};
  for (std::size_t n = 0; n < offsets.count; n += kLanes) {
    const Real squared = load(offsets.squared + n);
    const Flag inside = atMost(squared, bound);
    const Real x = choose(inside, load(offsets.x + n), zero), y = choose(inside, load(offsets.y + n), zero),
               z = choose(inside, load(offsets.z + n), zero);
    sums.count += __builtin_popcount(bitsOf(inside));
    farthest = higher(farthest, choose(inside, squared, zero));
    sx = plus(sx, x), sy = plus(sy, y), sz = plus(sz, z);
    xx = plus(xx, times(x, x)), xy = plus(xy, times(x, y)), xz = plus(xz, times(x, z));
    yy = plus(yy, times(y, y)), yz = plus(yz, times(y, z)), zz = plus(zz, times(z, z));
  }
  const auto total = [](Real lanes) {
    alignas(64) double each[kLanes];
    store(each, lanes);
    double sum = 0;
    for (const double one : each) sum += one;
    return sum;
  };
  alignas(64) double each[kLanes];
  store(each, farthest);
  for (const double one : each) sums.farthest = one > sums.farthest ? one : sums.farthest;
  sums.x = total(sx), sums.y = total(sy), sums.z = total(sz);
  sums.xx = total(xx), sums.xy = total(xy), sums.xz = total(xz);
  sums.yy = total(yy), sums.yz = total(yz), sums.zz = total(zz);
  return sums;
}

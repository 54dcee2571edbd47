// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Seeded random numbers that are the same on every machine, which the standard distributions do not guarantee.
#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>

namespace accessvdb::samples {

/// One step of splitmix64: a good 64-bit hash of x.
inline std::uint64_t splitMix(std::uint64_t x) {
  x += 0x9E3779B97F4A7C15ull;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ull;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBull;
  return x ^ (x >> 31);
}

/// The stream of one (seed, index) pair; streams of different indices are independent, so frames can be made in any
/// order.
class RandomStream {
 public:
  explicit RandomStream(std::uint64_t seed, std::uint64_t index = 0) : state_(splitMix(splitMix(seed) ^ index)) {}

  std::uint64_t next() {
    state_ += 0x9E3779B97F4A7C15ull;
    return splitMix(state_);
  }
  /// [0, 1)
  double uniform() { return static_cast<double>(next() >> 11) * 0x1.0p-53; }
  double uniform(double lo, double hi) { return lo + (hi - lo) * uniform(); }
  /// Standard normal (Box-Muller).
  double gaussian() {
    const double u = 1.0 - uniform();  // (0, 1]: the logarithm stays finite
    const double v = uniform();
    return std::sqrt(-2.0 * std::log(u)) * std::cos(2.0 * std::numbers::pi * v);
  }

 private:
  std::uint64_t state_;
};

}  // namespace accessvdb::samples

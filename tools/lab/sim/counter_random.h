// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Random numbers by hashing a counter, the same on every machine and in any order; the standard distributions
/// promise neither.
#pragma once

#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <numbers>

namespace accessvdb::sim {

inline constexpr std::uint64_t kSplitMixStep = 0x9E3779B97F4A7C15ull;

/// The number that splitmix64 (Steele, Lea, Flood 2014) draws in this state: every input bit changes about half of the
/// output bits.
constexpr std::uint64_t mixBits(std::uint64_t x) {
  x += kSplitMixStep;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ull;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBull;
  return x ^ (x >> 31);
}

/// The stream of one key, for example (seed, frame, ray): streams of different keys are independent, so no ray depends
/// on how many numbers another one drew.
class CounterRandom {
 public:
  explicit constexpr CounterRandom(std::initializer_list<std::uint64_t> key) {
    for (const std::uint64_t part : key) state_ = mixBits(state_ ^ part);
  }
  constexpr std::uint64_t next() {
    state_ += kSplitMixStep;
    return mixBits(state_);
  }
  /// [0, 1), 53 bits.
  constexpr double uniform() { return static_cast<double>(next() >> 11) * 0x1.0p-53; }
  constexpr double uniform(double lo, double hi) { return lo + (hi - lo) * uniform(); }
  /// Standard normal, by Box and Muller. Draws two numbers.
  double gaussian() {
    const double u = 1.0 - uniform();  // (0, 1]: the logarithm stays finite
    const double v = uniform();
    return std::sqrt(-2.0 * std::log(u)) * std::cos(2.0 * std::numbers::pi * v);
  }

 private:
  std::uint64_t state_ = 0;
};

}  // namespace accessvdb::sim

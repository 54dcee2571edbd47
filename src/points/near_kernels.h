// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The inner loops of neighbour searches, compiled for several instruction sets; one set is selected at run time.
///
/// Squared distances use float32 arithmetic on the positions as they are: differences, products and sums each round
/// once, so the relative error is below kFloatSlack. Callers decide with the exact distances, which are whole numbers
/// of steps (hostdev/neighbour_rule.h) and held by doubles.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "processor/kernel_list.h"

namespace accessvdb::internal {

/// Bound on the relative error of a squared distance in float32: three roundings per term and two sums, 5 x 2^-24.
inline constexpr float kFloatSlack = 4e-7f;

/// Positions as a structure of arrays, padded to full lanes; the padding is too far away to be found.
class NearPositions {
 public:
  static constexpr std::size_t kLanes = 16;

  void clear() { x_.clear(), y_.clear(), z_.clear(), size_ = 0; }
  void add(float x, float y, float z);

  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] std::size_t lanes() const { return x_.size(); }
  [[nodiscard]] const float* x() const { return x_.data(); }
  [[nodiscard]] const float* y() const { return y_.data(); }
  [[nodiscard]] const float* z() const { return z_.data(); }

 private:
  std::vector<float> x_, y_, z_;
  std::size_t size_ = 0;
};

/// Candidates of a search and their offsets from its centre, in steps, as far as its kernels see them. Arrays have room
/// for whole groups of kPadded.
struct OffsetArrays {
  static constexpr std::size_t kPadded = 8;
  static constexpr double kDropped = 1e300;  ///< squared distance of what does not count
  std::size_t count = 0;
  float *x_m = nullptr, *y_m = nullptr, *z_m = nullptr;                 ///< positions; finite in the padding
  double *x = nullptr, *y = nullptr, *z = nullptr, *squared = nullptr;  ///< filled by measure()
};
/// Sums over offsets, all of them whole numbers, and the largest squared distance.
struct OffsetSums {
  int count;
  double x, y, z, xx, xy, xz, yy, yz, zz, farthest;
};

struct NearKernels {
  const char* name;
  /// Lists the positions with squared distance <= `squared` to c, ascending.
  /// @param found  room for lanes + kLanes @return their number
  std::size_t (*within)(const float* x, const float* y, const float* z, std::size_t lanes, const float* c,
                        float squared, std::uint32_t* found);
  /// Whether there is any such position.
  bool (*any_within)(const float* x, const float* y, const float* z, std::size_t lanes, const float* c, float squared);
  /// Offsets of the candidates from c, rounded to steps as by neighbourOffset(). They must be less than a few radii
  /// away.
  void (*measure)(const OffsetArrays& offsets, const float* c, double steps_per_m);
  /// Number of candidates with squared distance <= `most`.
  std::size_t (*count_within)(const OffsetArrays& offsets, double most);
  /// Lists them, ascending. @param found  room for all @return their number
  std::size_t (*list_within)(const OffsetArrays& offsets, double most, std::uint32_t* found);
  OffsetSums (*sums_within)(const OffsetArrays& offsets, double most);
};

/// The best set for this machine.
const NearKernels& nearKernels();
/// All sets that run on this machine, best first.
KernelList<NearKernels> runnableNearKernels();

// Inline: called once per position.

inline void NearPositions::add(float x, float y, float z) {
  if (size_ == x_.size()) {
    constexpr float kFar = 1e30f;  // its square is infinite
    x_.resize(size_ + kLanes, kFar);
    y_.resize(size_ + kLanes, kFar);
    z_.resize(size_ + kLanes, kFar);
  }
  x_[size_] = x, y_[size_] = y, z_[size_] = z;
  ++size_;
}

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The state arrays of all points in a backend's memory.
#pragma once

#include <cstdint>

#include "launch/backend.h"
#include "launch/counted_memory.h"

namespace accessvdb::internal {

class PointsOnDevice {
 public:
  /// @param rolls  whether the tool may roll: the best roll of a point is part of its state
  PointsOnDevice(kernels::Backend& backend, int direction_words, bool rolls = false);
  /// From now on positions, normals, seen directions and weights are those of `owner`, which must outlive this, has the
  /// same points and as many words, and grows first. Only while this has no points.
  void shareWith(const PointsOnDevice& owner);
  /// Grows to `size` points in chunks; new ones are unscored.
  void grow(std::uint32_t size);
  /// Like grow(), but new points are not initialised.
  void growRaw(std::uint32_t size);
  /// Makes room for `size` points without changing size(). If it has to reallocate, data beyond size() is lost.
  void reserve(std::uint32_t size);
  [[nodiscard]] kernels::PointStateView view() const;
  [[nodiscard]] std::uint32_t size() const { return size_; }
  [[nodiscard]] std::uint64_t bytes() const { return memory_.bytes(); }
  /// Bytes per point; at most 64 at D <= 192 (asserted in a test).
  static std::uint64_t bytesPerPoint(int direction_words, bool rolls = false);

 private:
  kernels::CountedMemory memory_;
  int words_;
  bool rolls_;
  const PointsOnDevice* owner_ = nullptr;  ///< null: this owns all arrays
  std::uint32_t size_ = 0, capacity_ = 0;
  kernels::DeviceArray<float> position_L_, normal_L_, stability_;
  kernels::DeviceArray<std::uint64_t> seen_;
  kernels::DeviceArray<std::uint16_t> score_, direction_, weight_;
  kernels::DeviceArray<PointLabel> label_;
  kernels::DeviceArray<PointReason> reason_;
  kernels::DeviceArray<std::uint8_t> roll_;  ///< only if the tool may roll
};

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Whether a trajectory belongs to a cloud: it must cover the cloud's times, and pass near its points.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "io/poses/trajectory.h"

namespace accessvdb::io {

/// An evenly spread sample of any number of values, of bounded size: when full, every other one is dropped.
class ValueSample {
 public:
  void add(double value) {
    if (count_++ % stride_ != 0) return;
    values_.push_back(value);
    if (values_.size() < kMost) return;
    for (std::size_t i = 0; 2 * i < values_.size(); ++i) values_[i] = values_[2 * i];
    values_.resize(values_.size() / 2);
    stride_ *= 2;
  }
  [[nodiscard]] const std::vector<double>& values() const { return values_; }

 private:
  static constexpr std::size_t kMost = 8192;
  std::vector<double> values_;
  std::uint64_t count_ = 0, stride_ = 1;
};

/// What would bring a cloud's clock to that of a trajectory.
struct ClockOffset {
  double offset_s = 0;  ///< to be added to the cloud's stamps
  std::string reason;
};

/// Tries the usual differences between clocks: adjusted standard GPS time (less 1e9 s), seconds of the week, time since
/// 1970, leap seconds. @param stamps_s  a sample of the cloud's @return the one that covers most, at least half of them
[[nodiscard]] std::optional<ClockOffset> likelyClockOffset(const std::vector<double>& stamps_s,
                                                           const Trajectory& trajectory);

/// Counts the returns of a cloud that have a position at their time.
class TrajectoryCoverage {
 public:
  /// @param stamp_s  on the trajectory's clock  @param q_W  the sensor's position then
  void add(double stamp_s, const Eigen::Vector3d& p_W, const std::optional<Eigen::Vector3d>& q_W);
  /// @param time_offset_s  what was added to the cloud's stamps
  /// @throws UnusableInput "trajectory.coverage" (less than 99 %), "trajectory.far" (most returns over 10 km away)
  void check(const Trajectory& trajectory, double time_offset_s) const;
  /// Both spans, the typical range, and how many returns are skipped.
  [[nodiscard]] std::vector<std::string> notices(const Trajectory& trajectory) const;

 private:
  std::uint64_t returns_ = 0, covered_ = 0, far_ = 0;
  double first_s_ = 0, last_s_ = 0;  ///< of the finite stamps
  bool any_finite_ = false;
  ValueSample stamps_s_, ranges_m_;
};

}  // namespace accessvdb::io

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where a sensor will be in a while, and how far it reaches there, if it goes on as of late.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>

namespace accessvdb::tiles {

class SensorCourse {
 public:
  /// @param q_L  where a step was taken  @param farthest_m  distance of the farthest tile that it touched
  void note(const Eigen::Vector3f& q_L, double farthest_m) {
    constexpr float kOfLate = 0.25F;         // the mean of some steps
    constexpr double kForgotten = 1 / 16.0;  // a scan that saw as far may come again
    if (steps_++ > 0) per_step_ += kOfLate * (q_L - q_L_ - per_step_);
    q_L_ = q_L;
    reach_m_ = std::max(reach_m_ - kForgotten * reach_m_, farthest_m);
  }
  /// @param most_m  nobody knows where the sensor will be farther than this from here
  [[nodiscard]] Eigen::Vector3f soon_L(double most_m) const {
    constexpr float kSteps = 32;
    const Eigen::Vector3f way = kSteps * per_step_;
    const auto most = static_cast<float>(most_m), length = way.norm();
    return q_L_ + (length > most ? most / length : 1.0F) * way;
  }
  [[nodiscard]] double reach_m() const { return reach_m_; }

 private:
  std::uint64_t steps_ = 0;
  Eigen::Vector3f q_L_ = Eigen::Vector3f::Zero(), per_step_ = Eigen::Vector3f::Zero();
  double reach_m_ = 0;
};

}  // namespace accessvdb::tiles

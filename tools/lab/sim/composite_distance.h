// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Signed distances of shapes put together from simple ones, in closed form; exact outside.
#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "sim/signed_distance.h"

namespace accessvdb::sim {

/// Axis-parallel boxes that may overlap. Inside, the depth in the box that it is deepest in: a lower bound.
class BoxesDistance final : public SignedDistance {
 public:
  explicit BoxesDistance(std::vector<Eigen::AlignedBox3d> boxes_W) : boxes_W_(std::move(boxes_W)) {}
  [[nodiscard]] double at(const Eigen::Vector3d& p_W) const override;
  /// Of the box nearest to the point.
  [[nodiscard]] Eigen::Vector3d outwardNormal(const Eigen::Vector3d& p_W) const override;

 private:
  std::vector<Eigen::AlignedBox3d> boxes_W_;
};

/// A solid of revolution around the z axis. Its profile: corners (distance from the axis, z) from the axis back to the
/// axis, joined by straight lines, counter-clockwise around the material. Exact inside, too.
class TurnedDistance final : public SignedDistance {
 public:
  explicit TurnedDistance(std::vector<Eigen::Vector2d> profile_m) : profile_m_(std::move(profile_m)) {}
  [[nodiscard]] double at(const Eigen::Vector3d& p_W) const override;
  [[nodiscard]] Eigen::Vector3d outwardNormal(const Eigen::Vector3d& p_W) const override;

 private:
  std::vector<Eigen::Vector2d> profile_m_;
};

}  // namespace accessvdb::sim

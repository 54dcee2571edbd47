// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Signed distances in closed form, exact to rounding inside and outside.
#pragma once

#include "sim/signed_distance.h"

namespace accessvdb::sim {

/// Torus around the vertical axis through its centre.
class TorusDistance final : public SignedDistance {
 public:
  TorusDistance(const Eigen::Vector3d& centre_W, double major_radius_m, double minor_radius_m)
      : centre_W_(centre_W), major_m_(major_radius_m), minor_m_(minor_radius_m) {}
  [[nodiscard]] double at(const Eigen::Vector3d& p_W) const override;
  [[nodiscard]] Eigen::Vector3d outwardNormal(const Eigen::Vector3d& p_W) const override;

 private:
  Eigen::Vector3d centre_W_;
  double major_m_, minor_m_;
};

class SphereDistance final : public SignedDistance {
 public:
  SphereDistance(const Eigen::Vector3d& centre_W, double radius_m) : centre_W_(centre_W), radius_m_(radius_m) {}
  [[nodiscard]] double at(const Eigen::Vector3d& p_W) const override;
  [[nodiscard]] Eigen::Vector3d outwardNormal(const Eigen::Vector3d& p_W) const override;

 private:
  Eigen::Vector3d centre_W_;
  double radius_m_;
};

/// Axis-parallel box. The normal of a point inside is that of its nearest face.
class BoxDistance final : public SignedDistance {
 public:
  BoxDistance(const Eigen::Vector3d& centre_W, const Eigen::Vector3d& size_m)
      : centre_W_(centre_W), half_m_(0.5 * size_m) {}
  [[nodiscard]] double at(const Eigen::Vector3d& p_W) const override;
  [[nodiscard]] Eigen::Vector3d outwardNormal(const Eigen::Vector3d& p_W) const override;

 private:
  Eigen::Vector3d centre_W_, half_m_;
};

}  // namespace accessvdb::sim

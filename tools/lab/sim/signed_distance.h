// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The truth about a scene: signed distance to its surface. Shares no code with the method.
#pragma once

#include <Eigen/Core>
#include <cmath>

namespace accessvdb::sim {

/// All functions may be called from several threads at once.
class SignedDistance {
 public:
  virtual ~SignedDistance() = default;
  /// Metres, negative inside. Exact outside; inside overlapping parts the magnitude is a lower bound with the right
  /// sign.
  [[nodiscard]] virtual double at(const Eigen::Vector3d& p_W) const = 0;
  /// Unit, outwards, at a point on or near the surface: the direction in which the distance grows.
  [[nodiscard]] virtual Eigen::Vector3d outwardNormal(const Eigen::Vector3d& p_W) const = 0;
  /// |at(p)| < r, and true for a point that is not finite. Cheaper for small r: no search beyond it, no sign.
  [[nodiscard]] virtual bool surfaceNearerThan(const Eigen::Vector3d& p_W, double r_m) const {
    return !(std::abs(at(p_W)) >= r_m);
  }
  /// Largest error of at() near the surface, metres; 0 = exact to rounding.
  [[nodiscard]] virtual double errorBound_m() const { return 0; }
};

}  // namespace accessvdb::sim

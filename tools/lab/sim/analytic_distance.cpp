// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/analytic_distance.h"

#include <algorithm>
#include <cmath>

namespace accessvdb::sim {
namespace {

/// The direction of v; at a medial point, where v is zero, any unit vector will do.
Eigen::Vector3d unitOr(const Eigen::Vector3d& v, const Eigen::Vector3d& fallback) {
  const double length = v.norm();
  return length > 0 ? Eigen::Vector3d(v / length) : fallback;
}

}  // namespace

double TorusDistance::at(const Eigen::Vector3d& p_W) const {
  const Eigen::Vector3d p = p_W - centre_W_;
  return std::hypot(std::hypot(p.x(), p.y()) - major_m_, p.z()) - minor_m_;
}

Eigen::Vector3d TorusDistance::outwardNormal(const Eigen::Vector3d& p_W) const {
  const Eigen::Vector3d p = p_W - centre_W_;
  const Eigen::Vector3d radial = unitOr({p.x(), p.y(), 0}, Eigen::Vector3d::UnitX());
  return unitOr(p - major_m_ * radial, Eigen::Vector3d::UnitZ());
}

double SphereDistance::at(const Eigen::Vector3d& p_W) const { return (p_W - centre_W_).norm() - radius_m_; }

Eigen::Vector3d SphereDistance::outwardNormal(const Eigen::Vector3d& p_W) const {
  return unitOr(p_W - centre_W_, Eigen::Vector3d::UnitZ());
}

double BoxDistance::at(const Eigen::Vector3d& p_W) const {
  const Eigen::Vector3d beyond = (p_W - centre_W_).cwiseAbs() - half_m_;
  return beyond.cwiseMax(0.0).norm() + std::min(beyond.maxCoeff(), 0.0);
}

Eigen::Vector3d BoxDistance::outwardNormal(const Eigen::Vector3d& p_W) const {
  const Eigen::Vector3d p = p_W - centre_W_;
  const Eigen::Vector3d beyond = p.cwiseAbs() - half_m_;
  Eigen::Vector3d normal = beyond.cwiseMax(0.0);
  if (!(normal.norm() > 0)) {
    Eigen::Index nearest_face;
    beyond.maxCoeff(&nearest_face);
    normal = Eigen::Vector3d::Unit(nearest_face);
  }
  for (int axis = 0; axis < 3; ++axis) normal[axis] = std::copysign(normal[axis], p[axis]);
  return normal.normalized();
}

}  // namespace accessvdb::sim

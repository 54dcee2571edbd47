// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/composite_distance.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "sim/analytic_distance.h"

namespace accessvdb::sim {
namespace {

BoxDistance distanceOf(const Eigen::AlignedBox3d& box_W) { return {box_W.center(), box_W.sizes()}; }

/// The nearest place of a profile.
struct NearestPlace {
  double distance_m = std::numeric_limits<double>::infinity();
  Eigen::Vector2d offset = {0, 0};   ///< from there to the point
  Eigen::Vector2d outward = {0, 0};  ///< of the line that it is on
};

NearestPlace nearestPlace(const std::vector<Eigen::Vector2d>& profile_m, const Eigen::Vector2d& p) {
  NearestPlace nearest;
  for (std::size_t n = 0; n + 1 < profile_m.size(); ++n) {
    const Eigen::Vector2d along = profile_m[n + 1] - profile_m[n], from = p - profile_m[n];
    const double share = std::clamp(from.dot(along) / along.squaredNorm(), 0.0, 1.0);
    const Eigen::Vector2d offset = from - share * along;
    if (offset.norm() >= nearest.distance_m) continue;
    nearest = {offset.norm(), offset, Eigen::Vector2d(along.y(), -along.x()).normalized()};
  }
  return nearest;
}

/// Crossings of a ray away from the axis: the axis itself, which closes the profile, is never crossed.
bool insideProfile(const std::vector<Eigen::Vector2d>& profile_m, const Eigen::Vector2d& p) {
  bool inside = false;
  for (std::size_t n = 0; n + 1 < profile_m.size(); ++n) {
    const Eigen::Vector2d &a = profile_m[n], &b = profile_m[n + 1];
    if ((a.y() > p.y()) == (b.y() > p.y())) continue;
    if (p.x() < a.x() + (b.x() - a.x()) * (p.y() - a.y()) / (b.y() - a.y())) inside = !inside;
  }
  return inside;
}

}  // namespace

double BoxesDistance::at(const Eigen::Vector3d& p_W) const {
  double nearest_m = std::numeric_limits<double>::infinity();
  for (const Eigen::AlignedBox3d& box_W : boxes_W_) nearest_m = std::min(nearest_m, distanceOf(box_W).at(p_W));
  return nearest_m;
}

Eigen::Vector3d BoxesDistance::outwardNormal(const Eigen::Vector3d& p_W) const {
  const auto nearest = std::min_element(boxes_W_.begin(), boxes_W_.end(), [&](const auto& a, const auto& b) {
    return distanceOf(a).at(p_W) < distanceOf(b).at(p_W);
  });
  return distanceOf(*nearest).outwardNormal(p_W);
}

double TurnedDistance::at(const Eigen::Vector3d& p_W) const {
  const Eigen::Vector2d p(std::hypot(p_W.x(), p_W.y()), p_W.z());
  const double distance_m = nearestPlace(profile_m_, p).distance_m;
  return insideProfile(profile_m_, p) ? -distance_m : distance_m;
}

Eigen::Vector3d TurnedDistance::outwardNormal(const Eigen::Vector3d& p_W) const {
  const double radius_m = std::hypot(p_W.x(), p_W.y());
  const Eigen::Vector2d p(radius_m, p_W.z());
  const NearestPlace nearest = nearestPlace(profile_m_, p);
  Eigen::Vector2d normal = nearest.outward;  // on the surface itself the offset has no direction
  constexpr double kOnSurface_m = 1e-9;
  if (nearest.distance_m > kOnSurface_m) {
    normal = nearest.offset / nearest.distance_m * (insideProfile(profile_m_, p) ? -1 : 1);
  }
  const Eigen::Vector2d radial = radius_m > 0 ? Eigen::Vector2d(p_W.head<2>() / radius_m) : Eigen::Vector2d(1, 0);
  return {normal.x() * radial.x(), normal.x() * radial.y(), normal.y()};
}

}  // namespace accessvdb::sim

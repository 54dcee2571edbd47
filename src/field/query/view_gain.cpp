// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/query/view_gain.h"

#include <algorithm>
#include <cmath>

#include "field/tools/scoring_setup.h"

namespace accessvdb::internal {
namespace {

/// A point takes over what its ten nearest neighbours were seen from, itself included.
constexpr double kNeighboursThatSee = 10;
/// Voxels of the surface in which a return adds to a point's weight: of the 3x3x3 around it, widened by the cone.
constexpr double kVoxelsThatWeigh = 20;
/// Voxels of the surface in which a new return may turn the point's normal, and how probable it then is that the point
/// can be tried, although the view brings nothing else (measured in pines: `accessvdb-lab evaluate --table views`).
constexpr double kVoxelsThatTurn = 30, kTurnedUnseen = 0.55, kTurnedUnknown = 0.15;
/// Ways of a point that are looked at, those nearest to the view first.
constexpr std::size_t kWaysTried = 4;
/// What is more probable than this counts as certain where a later view is planned on it.
constexpr double kCertain = 0.5;
/// How far off its surface a point is looked at, voxels.
constexpr double kLift = 1.5;
/// Fewer of the rays are none.
constexpr double kFewRays = 0.01;
/// Of the rays that clear a voxel by going through it, square voxels.
constexpr double kLineArea = 0.785;

/// Probability that a Poisson variable is `least` or more.
double atLeast(double least, double mean) {
  const int count = static_cast<int>(std::ceil(least));
  double term = std::exp(-mean), below = 0;
  for (int n = 0; n < count; ++n) {
    below += term;
    term *= mean / (n + 1);
  }
  return std::clamp(1 - below, 0.0, 1.0);
}

}  // namespace

ViewRules::ViewRules(const FieldParams& resolved, const ViewSensor& of_view)
    : voxel_size_m(resolved.tsdf.voxel_size_m),
      observation_cos_min(resolved.approach.observation_cos_min),
      cleared_radius(std::max(resolved.tsdf.cleared_radius_voxels, 0.5)),
      cleared_end(resolved.tsdf.cleared_end_tau * resolved.tsdf.truncation_distance_m / voxel_size_m),
      line_end(resolved.tsdf.clear_rays_m / voxel_size_m),
      same_surface(std::max(2.0, 3 * resolved.tsdf.range_noise_m / voxel_size_m)),
      sensor(of_view),
      max_range(std::min(of_view.max_range_m, resolved.tsdf.max_range_m) / voxel_size_m) {
  for (const double at_m : armDistances(resolved)) corridor.push_back(at_m / voxel_size_m);
  if (corridor.size() > OpenPoint::kMostSamples) corridor.resize(OpenPoint::kMostSamples);
}

void ViewRules::setPassing(double share) {
  passing = share;
  most_passed = share > 0 ? std::clamp(static_cast<int>(std::ceil(std::log(kFewRays) / std::log(share))), 1, 64) : 1;
}

double ViewRules::density(double sin_elevation) const {
  const double level = std::sqrt(std::max(1 - sin_elevation * sin_elevation, 1e-4));
  return sensor.rays / (sensor.azimuth_rad * (sensor.elevation_max_rad - sensor.elevation_min_rad) * level);
}

bool ViewRules::covers(const Eigen::Vector3d& unit_S) const {
  const double elevation = std::asin(std::clamp(unit_S.z(), -1.0, 1.0));
  return elevation >= sensor.elevation_min_rad && elevation <= sensor.elevation_max_rad &&
         std::abs(std::atan2(unit_S.y(), unit_S.x())) <= sensor.azimuth_rad / 2;
}

ViewGain::Sight ViewGain::sightOf(const SensorPose& pose, const Eigen::Vector3d& place) const {
  Sight sight;
  sight.out = pose.place - place;
  sight.range = sight.out.norm();
  if (!(sight.range > 1) || sight.range > rules_.max_range) return sight;
  sight.out /= sight.range;
  const Eigen::Vector3d towards_S = pose.R_WS.transpose() * -sight.out;
  if (rules_.covers(towards_S)) sight.density = rules_.density(towards_S.z());
  return sight;
}

double ViewGain::returnsAt(const SensorPose& pose, const OpenPoint& point) const {
  const Eigen::Vector3d normal = point.normal.cast<double>();
  const double facing = (pose.place - point.place).normalized().dot(normal);
  // Off the surface, so that what is beside the point does not hide it from a flat angle.
  const Sight sight = sightOf(pose, point.place + std::copysign(kLift, facing) * normal);
  if (sight.density == 0) return 0;
  const double end = std::max(sight.range - rules_.same_surface, 0.0);
  const double passing =
      rules_.passingAll(reader_.collidingOn(pose.place, -sight.out, {end, end, end}, rules_.most_passed)[0]);
  const double slant = point.normal.isZero() ? 0.5 : std::max(std::abs(facing), 0.05);
  return passing * sight.density * slant / (sight.range * sight.range);
}

double ViewGain::clears(const SensorPose& pose, const Eigen::Vector3d& sample, bool beside) const {
  const Sight sight = sightOf(pose, sample);
  if (sight.density == 0) return 0;
  const double band = std::min(sight.range + rules_.cleared_end, rules_.max_range);
  double line = std::min(sight.range + std::max(rules_.cleared_end, rules_.line_end), rules_.max_range);
  if (sight.density * kLineArea < kFewRays * sight.range * sight.range) line = band;
  double reach = 0;
  const auto areaAt = [&](const Eigen::Vector3d& place, double end) {
    const Eigen::Vector3d along = (place - pose.place).normalized();
    const auto [before, near, far] =
        reader_.collidingOn(pose.place, along, {sight.range, band, end}, rules_.most_passed);
    reach = rules_.passingAll(before);
    const double end_near = reach - rules_.passingAll(before + near),
                 end_far = reach - end_near - rules_.passingAll(before + near + far);
    return M_PI * end_near * rules_.cleared_radius * rules_.cleared_radius + kLineArea * end_far;
  };
  double area = areaAt(sample, line);
  if (beside && area < 1 && reach > kFewRays) {  // it ends nowhere: perhaps the sample is in front of an edge
    const Eigen::Vector3d side = sight.out.unitOrthogonal(), up = sight.out.cross(side);
    for (const Eigen::Vector3d& away : {side, up, Eigen::Vector3d(-side), Eigen::Vector3d(-up)})
      area += 0.2 * areaAt(sample + 0.7 * rules_.cleared_radius * away, band);
  }
  return 1 - std::exp(-sight.density * area / (sight.range * sight.range));
}

double ViewGain::completes(const SensorPose& pose, const OpenPoint& point, const OpenWay& way, double seen_anew) const {
  double probability = way.seen ? 1 : seen_anew;
  for (std::size_t k = 0; k < rules_.corridor.size() && probability > 0; ++k) {
    if ((way.unknown >> k & 1) == 0) continue;
    probability *= clears(pose, point.place + rules_.corridor[k] * way.along.cast<double>(), true);
  }
  return probability;
}

double ViewGain::of(const SensorPose& pose, const OpenPoint& point) const {
  const Sight sight = sightOf(pose, point.place);
  if (sight.range > rules_.max_range) return 0;
  const double returns = returnsAt(pose, point);
  const double weighed = point.missing_weight > 0 ? atLeast(point.missing_weight, kVoxelsThatWeigh * returns) : 1;
  if (weighed < 1e-3) return 0;
  const double seen_anew = 1 - std::exp(-kNeighboursThatSee * returns);
  std::array<const OpenWay*, kWaysTried> nearest = {};
  std::array<float, kWaysTried> cosines;
  cosines.fill(-2);
  const Eigen::Vector3f out = sight.out.cast<float>();
  for (const OpenWay& way : point.ways) {
    const float cosine = way.along.dot(out);
    if (!way.seen && !(static_cast<double>(cosine) > rules_.observation_cos_min)) continue;
    if (!way.seen && seen_anew == 0) continue;
    const OpenWay* moved = &way;
    float moved_cosine = way.unknown == 0 ? 2 : cosine;  // what only has to be seen comes first
    for (std::size_t k = 0; k < kWaysTried && moved != nullptr; ++k) {
      if (!(moved_cosine > cosines[k])) continue;
      std::swap(moved, nearest[k]);
      std::swap(moved_cosine, cosines[k]);
    }
  }
  double best = 0;
  for (const OpenWay* way : nearest) {
    if (way == nullptr || best > 0.95) break;
    best = std::max(best, completes(pose, point, *way, seen_anew));
  }
  const double turned = point.reason == PointReason::Unseen    ? kTurnedUnseen
                        : point.reason == PointReason::Unknown ? kTurnedUnknown
                                                               : 0;
  return weighed * (1 - (1 - best) * (1 - turned * point.may_turn * (1 - std::exp(-kVoxelsThatTurn * returns))));
}

void ViewGain::take(const SensorPose& pose, OpenPoint& point) const {
  const double resolved = of(pose, point);
  point.left *= 1 - resolved;
  const double returns = returnsAt(pose, point);
  point.may_turn *= std::exp(-kVoxelsThatTurn * returns);
  point.missing_weight = std::max(0.0, point.missing_weight - kVoxelsThatWeigh * returns);
  const bool sees = 1 - std::exp(-kNeighboursThatSee * returns) > kCertain;
  const Eigen::Vector3f out = (pose.place - point.place).normalized().cast<float>();
  for (OpenWay& way : point.ways) {
    if (sees && static_cast<double>(way.along.dot(out)) > rules_.observation_cos_min) way.seen = true;
    for (std::size_t k = 0; k < rules_.corridor.size(); ++k) {
      if ((way.unknown >> k & 1) == 0) continue;
      if (clears(pose, point.place + rules_.corridor[k] * way.along.cast<double>(), false) > kCertain)
        way.unknown &= ~(std::uint32_t{1} << k);
    }
  }
}

}  // namespace accessvdb::internal

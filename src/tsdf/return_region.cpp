// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/return_region.h"

#include <algorithm>
#include <cmath>

namespace accessvdb::internal {
namespace {
/// Slack of the conservative bounds against rounding, in voxels.
constexpr float kSlack = 1e-3f;
/// Radius of the ball around the return that is always updated (SPEC: |x-p| <= v), in voxels.
constexpr float kOwnVoxelRadius = 1.0f;
}  // namespace

RegionShape::RegionShape(const TsdfParams& p)
    : region(p.region),
      tau(static_cast<float>(p.truncation_distance_m / p.voxel_size_m)),
      cone_cos(static_cast<float>(p.cone_cos_min)),
      cone_cos_squared(static_cast<float>(p.cone_cos_min * p.cone_cos_min)),
      cone_sin_squared(static_cast<float>(1.0 - p.cone_cos_min * p.cone_cos_min)),
      band_begin(static_cast<float>(p.cleared_begin_tau * p.truncation_distance_m / p.voxel_size_m)),
      band_end(static_cast<float>(p.cleared_end_tau * p.truncation_distance_m / p.voxel_size_m)),
      band_radius(static_cast<float>(p.cleared_radius_voxels)) {}

RegionSlices::RegionSlices(const RegionShape& shape, const ReturnRay& ray)
    : tau_(shape.tau), full_cube_(shape.region == UpdateRegion::FullCube) {
  const auto& u = ray.to_sensor;
  a_ = 0;
  if (std::abs(u[1]) > std::abs(u[a_])) a_ = 1;
  if (std::abs(u[2]) > std::abs(u[a_])) a_ = 2;
  b_ = (a_ + 1) % 3;
  c_ = (a_ + 2) % 3;
  cone_along_ = {-tau_ - kSlack, tau_ + kSlack};

  // The projection of the cone onto the plane (a, other) is a wedge around the projected ray. Its edges have slopes m
  // with ((u_o - m u_a)^2 = sin^2 (1 + m^2)); u_a^2 >= 1/3 > sin^2, so both are finite.
  const float ua = u[a_];
  const float sin2 = std::min(shape.cone_sin_squared, 0.32f);
  const std::array<int, 2> others = {b_, c_};
  for (int n = 0; n < 2; ++n) {
    const float uo = u[others[n]];
    const float denominator = ua * ua - sin2;
    const float root = std::sqrt(std::max(0.0f, sin2 * (ua * ua + uo * uo) - sin2 * sin2));
    slope_low_[n] = (ua * uo - root) / denominator;
    slope_high_[n] = (ua * uo + root) / denominator;
    axis_slope_[n] = uo / ua;
    band_margin_[n] = shape.band_radius * std::sqrt(1.0f + axis_slope_[n] * axis_slope_[n]) + kSlack;
  }
  const float end = std::min(shape.band_end, ray.range);
  const float cap = shape.band_radius * std::sqrt(std::max(0.0f, 1.0f - ua * ua)) + kSlack;
  const float e0 = shape.band_begin * ua, e1 = end * ua;
  band_along_ = end > shape.band_begin ? Interval{std::min(e0, e1) - cap, std::max(e0, e1) + cap} : Interval{1, -1};
}

Interval RegionSlices::coneAcross(Interval along, int n) const {
  if (full_cube_) return {-tau_ - kSlack, tau_ + kSlack};
  const float e[4] = {slope_low_[n] * along.low, slope_high_[n] * along.low, slope_low_[n] * along.high,
                      slope_high_[n] * along.high};
  Interval across = {std::min({e[0], e[1], e[2], e[3]}) - kSlack, std::max({e[0], e[1], e[2], e[3]}) + kSlack};
  if (along.low <= kOwnVoxelRadius && along.high >= -kOwnVoxelRadius) {
    across = {std::min(across.low, -kOwnVoxelRadius - kSlack), std::max(across.high, kOwnVoxelRadius + kSlack)};
  }
  return {std::max(across.low, -tau_ - kSlack), std::min(across.high, tau_ + kSlack)};
}

Interval RegionSlices::bandAcross(Interval along, int n) const {
  const float e0 = axis_slope_[n] * along.low, e1 = axis_slope_[n] * along.high;
  return {std::min(e0, e1) - band_margin_[n], std::max(e0, e1) + band_margin_[n]};
}

}  // namespace accessvdb::internal

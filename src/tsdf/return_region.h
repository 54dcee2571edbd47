// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The voxels that a return updates, in units of voxels around the return (docs/PAPER_MAP.md, "Integration").
///
/// With e = x - p (from the return to a voxel centre), u = (q - p) / R (towards the sensor) and s = e . u:
///   double cone   s^2 > cos^2 |e|^2  or  |e| <= 1, inside the cube |e|_inf <= tau   (product)
///   full cube     R - s > cos |x - q|, inside the cube                              (paper: cone seen from the sensor)
///   cleared band  begin < s <= min(end, R),  |e|^2 - s^2 <= radius^2                (radius 0: samples every v/2)
///   cleared line  band's end < s <= min(clear_rays, R), kernels::ClearedLine         (with clear_rays_m)
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "accessvdb/params.h"
#include "hostdev/return_ray.h"

namespace accessvdb::internal {

using kernels::Interval, kernels::kOwnVoxelRadius, kernels::kSlack, kernels::ReturnRay;

/// The ray of a return. Rounded only where its parts are stored.
/// @param p_L, q_L  [3] return and sensor, local frame, metres
ReturnRay makeRay(const float* p_L, const float* q_L, double voxel_size_m);

/// Stands for a sensor position. @param q_L  [3] local frame, metres
ReturnRay ballAround(const float* q_L, double voxel_size_m);

/// Constants of a map's update region, in voxels.
struct RegionShape {
  explicit RegionShape(const TsdfParams& resolved);

  UpdateRegion region;
  float tau;
  float cone_cos, cone_cos_squared, cone_sin_squared;
  float band_begin, band_end, band_radius;
  float line_end;     ///< of what rays clear beyond the band; 0: nothing
  float ball_radius;  ///< of what the platform clears; 0: nothing
  [[nodiscard]] bool hasLines() const { return line_end > band_end; }
  [[nodiscard]] bool thinBand() const { return band_radius <= 0; }
};

/// Visits the voxels of a thin band, in order from the return: those nearest to samples every v/2 along the ray. One
/// may come twice in a row. @param visit  (ijk relative to ray.base_ijk)
template <typename Visit>
void forEachThinBandVoxel(const RegionShape& shape, const ReturnRay& ray, const Visit& visit) {
  const float end = std::min(shape.band_end, ray.range);
  for (int m = 1;; ++m) {
    const float s = shape.band_begin + 0.5f * static_cast<float>(m);
    if (!(s <= end)) return;
    std::array<std::int32_t, 3> voxel;
    for (std::size_t axis = 0; axis < 3; ++axis) voxel[axis] = kernels::thinBandVoxel(ray, s, static_cast<int>(axis));
    visit(voxel);
  }
}

/// The part of a region in a slice e_a in [low, high] across the ray's dominant axis a: bounds on the other two axes.
/// Conservative: never cuts off a voxel of the region.
class RegionSlices {
 public:
  RegionSlices(const RegionShape& shape, const ReturnRay& ray);

  [[nodiscard]] int dominantAxis() const { return a_; }
  [[nodiscard]] int axisB() const { return b_; }
  [[nodiscard]] int axisC() const { return c_; }
  [[nodiscard]] Interval coneAlong() const { return cone_along_; }
  [[nodiscard]] Interval bandAlong() const { return band_along_; }
  /// @param which  0: axisB, 1: axisC
  [[nodiscard]] Interval coneAcross(Interval along, int which) const;
  [[nodiscard]] Interval bandAcross(Interval along, int which) const;
  /// Extents along x.
  [[nodiscard]] Interval coneX() const { return a_ == 0 ? cone_along_ : coneAcross(cone_along_, b_ == 0 ? 0 : 1); }
  [[nodiscard]] Interval bandX() const { return a_ == 0 ? band_along_ : bandAcross(band_along_, b_ == 0 ? 0 : 1); }

 private:
  int a_, b_, c_;
  float tau_;
  bool full_cube_;
  Interval cone_along_, band_along_;
  std::array<float, 2> slope_low_, slope_high_;    ///< of the cone's projection onto (a, b) and (a, c)
  std::array<float, 2> axis_slope_, band_margin_;  ///< slope of the ray, and the band's half width across it
};

// Inline: called once per return and layer of leaves.

inline RegionSlices::RegionSlices(const RegionShape& shape, const ReturnRay& ray)
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

inline Interval RegionSlices::coneAcross(Interval along, int n) const {
  if (full_cube_) return {-tau_ - kSlack, tau_ + kSlack};
  const float e[4] = {slope_low_[n] * along.low, slope_high_[n] * along.low, slope_low_[n] * along.high,
                      slope_high_[n] * along.high};
  Interval across = {std::min({e[0], e[1], e[2], e[3]}) - kSlack, std::max({e[0], e[1], e[2], e[3]}) + kSlack};
  if (along.low <= kOwnVoxelRadius && along.high >= -kOwnVoxelRadius) {
    across = {std::min(across.low, -kOwnVoxelRadius - kSlack), std::max(across.high, kOwnVoxelRadius + kSlack)};
  }
  return {std::max(across.low, -tau_ - kSlack), std::min(across.high, tau_ + kSlack)};
}

inline Interval RegionSlices::bandAcross(Interval along, int n) const {
  const float e0 = axis_slope_[n] * along.low, e1 = axis_slope_[n] * along.high;
  return {std::min(e0, e1) - band_margin_[n], std::max(e0, e1) + band_margin_[n]};
}

}  // namespace accessvdb::internal

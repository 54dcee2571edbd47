// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The voxels that one return updates, in units of voxels around the return (SPEC a.3, a.4).
///
/// With e = x - p (from the return to a voxel centre), u = (q - p) / R (towards the sensor) and s = e . u:
///   double cone   s^2 > cos^2 |e|^2  or  |e| <= 1, inside the cube |e|_inf <= tau     (product)
///   full cube     R - s > cos |x - q|, inside the cube                                 (paper: cone seen from the
///   sensor) cleared band  begin < s <= min(end, R),  |e|^2 - s^2 <= radius^2                   (radius 0: samples
///   every v/2)
#pragma once

#include <array>
#include <cstdint>

#include "accessvdb/params.h"

namespace accessvdb::internal {

/// Interval of leaf-relative offsets e along one axis.
struct Interval {
  float low, high;
  [[nodiscard]] bool empty() const { return !(low <= high); }
};

/// One return with its ray, relative to a voxel near it, so that float32 keeps its precision anywhere in the map.
struct ReturnRay {
  std::array<std::int32_t, 3> base_ijk;  ///< voxel of the return
  std::array<float, 3> offset;           ///< return minus base_ijk, in voxels, within +-0.5
  std::array<float, 3> to_sensor;        ///< [u] unit
  float range;                           ///< [R] in voxels
  Interval cone_x, band_x;               ///< extents of its regions, set by ReturnBins
};

/// Constants of a map's update region, in voxels.
struct RegionShape {
  explicit RegionShape(const TsdfParams& resolved);

  UpdateRegion region;
  float tau;
  float cone_cos, cone_cos_squared, cone_sin_squared;
  float band_begin, band_end, band_radius;
  [[nodiscard]] bool thinBand() const { return band_radius <= 0; }
};

/// The part of a region in one slice e_a in [low, high] across the ray's dominant axis a: bounds on the other two axes.
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
  std::array<float, 2> axis_slope_, band_margin_;  ///< of the ray, and the band's half width across it
};

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which leaves a return's region may reach, in units of voxels around the return (docs/PAPER_MAP.md, "Integration").
/// Conservative: never without a leaf that holds a voxel of the region.
///
/// With e = x - p (from the return to a voxel centre), u = (q - p) / R (towards the sensor) and s = e . u:
///   double cone   s^2 > cos^2 |e|^2  or  |e| <= 1, inside the cube |e|_inf <= tau   (product)
///   full cube     R - s > cos |x - q|, inside the cube                              (paper: cone seen from the sensor)
///   cleared band  begin < s <= min(end, R),  |e|^2 - s^2 <= radius^2                (radius 0: samples every v/2)
///   cleared line  band's end < s <= min(clear_rays, R), ClearedLine                 (with clear_rays_m)
#pragma once

#include <cmath>
#include <cstdint>

#include "hostdev/return_ray.h"

namespace accessvdb::kernels {

/// Constants of a map's update region, in voxels.
struct RegionConstants {
  bool full_cube;  ///< the paper's region in place of the double cone
  float tau;
  float cone_cos, cone_cos_squared, cone_sin_squared;
  float band_begin, band_end, band_radius;
  float line_end;     ///< of what rays clear beyond the band; 0: nothing
  float ball_radius;  ///< of what the platform clears; 0: nothing
  [[nodiscard]] ACCESSVDB_HOSTDEV bool hasLines() const { return line_end > band_end; }
  [[nodiscard]] ACCESSVDB_HOSTDEV bool thinBand() const { return band_radius <= 0; }
};

ACCESSVDB_HOSTDEV inline float lesser(float a, float b) { return b < a ? b : a; }
ACCESSVDB_HOSTDEV inline float greater(float a, float b) { return a < b ? b : a; }

/// std::floor() is a call on x86-64 without SSE4.1.
ACCESSVDB_HOSTDEV inline std::int32_t floorToInt(float value) {
  const auto n = static_cast<std::int32_t>(value);
  return n - (static_cast<float>(n) > value ? 1 : 0);
}

/// The part of a region in a slice e_a in [low, high] across the ray's dominant axis a: bounds on the other two axes.
/// Conservative: never cuts off a voxel of the region.
class RegionSlices {
 public:
  // Inline: called once per return and layer of leaves.
  ACCESSVDB_HOSTDEV RegionSlices(const RegionConstants& shape, const ReturnRay& ray)
      : a_(0), tau_(shape.tau), full_cube_(shape.full_cube) {
    const auto& u = ray.to_sensor;
    if (fabsf(u[1]) > fabsf(u[a_])) a_ = 1;
    if (fabsf(u[2]) > fabsf(u[a_])) a_ = 2;
    b_ = (a_ + 1) % 3;
    c_ = (a_ + 2) % 3;
    cone_along_ = {-tau_ - kSlack, tau_ + kSlack};

    // The projection of the cone onto the plane (a, other) is a wedge around the projected ray. Its edges have slopes m
    // with ((u_o - m u_a)^2 = sin^2 (1 + m^2)); u_a^2 >= 1/3 > sin^2, so both are finite.
    const float ua = u[a_];
    const float sin2 = lesser(shape.cone_sin_squared, 0.32f);
    const int others[2] = {b_, c_};
    for (int n = 0; n < 2; ++n) {
      const float uo = u[others[n]];
      const float denominator = ua * ua - sin2;
      const float root = sqrtf(greater(0.0f, sin2 * (ua * ua + uo * uo) - sin2 * sin2));
      slope_low_[n] = (ua * uo - root) / denominator;
      slope_high_[n] = (ua * uo + root) / denominator;
      axis_slope_[n] = uo / ua;
      band_margin_[n] = shape.band_radius * sqrtf(1.0f + axis_slope_[n] * axis_slope_[n]) + kSlack;
    }
    const float end = lesser(shape.band_end, ray.range);
    const float cap = shape.band_radius * sqrtf(greater(0.0f, 1.0f - ua * ua)) + kSlack;
    const float e0 = shape.band_begin * ua, e1 = end * ua;
    band_along_ = end > shape.band_begin ? Interval{lesser(e0, e1) - cap, greater(e0, e1) + cap} : Interval{1, -1};
  }

  [[nodiscard]] ACCESSVDB_HOSTDEV int dominantAxis() const { return a_; }
  [[nodiscard]] ACCESSVDB_HOSTDEV int axisB() const { return b_; }
  [[nodiscard]] ACCESSVDB_HOSTDEV int axisC() const { return c_; }
  [[nodiscard]] ACCESSVDB_HOSTDEV Interval coneAlong() const { return cone_along_; }
  [[nodiscard]] ACCESSVDB_HOSTDEV Interval bandAlong() const { return band_along_; }
  /// @param which  0: axisB, 1: axisC
  [[nodiscard]] ACCESSVDB_HOSTDEV Interval coneAcross(Interval along, int which) const {
    if (full_cube_) return {-tau_ - kSlack, tau_ + kSlack};
    const float e0 = slope_low_[which] * along.low, e1 = slope_high_[which] * along.low,
                e2 = slope_low_[which] * along.high, e3 = slope_high_[which] * along.high;
    Interval across = {lesser(lesser(e0, e1), lesser(e2, e3)) - kSlack,
                       greater(greater(e0, e1), greater(e2, e3)) + kSlack};
    if (along.low <= kOwnVoxelRadius && along.high >= -kOwnVoxelRadius) {
      across = {lesser(across.low, -kOwnVoxelRadius - kSlack), greater(across.high, kOwnVoxelRadius + kSlack)};
    }
    return {greater(across.low, -tau_ - kSlack), lesser(across.high, tau_ + kSlack)};
  }
  [[nodiscard]] ACCESSVDB_HOSTDEV Interval bandAcross(Interval along, int which) const {
    const float e0 = axis_slope_[which] * along.low, e1 = axis_slope_[which] * along.high;
    return {lesser(e0, e1) - band_margin_[which], greater(e0, e1) + band_margin_[which]};
  }
  /// Extents along x.
  [[nodiscard]] ACCESSVDB_HOSTDEV Interval coneX() const {
    return a_ == 0 ? cone_along_ : coneAcross(cone_along_, b_ == 0 ? 0 : 1);
  }
  [[nodiscard]] ACCESSVDB_HOSTDEV Interval bandX() const {
    return a_ == 0 ? band_along_ : bandAcross(band_along_, b_ == 0 ? 0 : 1);
  }

 private:
  int a_, b_, c_;
  float tau_;
  bool full_cube_;
  Interval cone_along_, band_along_;
  float slope_low_[2], slope_high_[2];    ///< of the cone's projection onto (a, b) and (a, c)
  float axis_slope_[2], band_margin_[2];  ///< slope of the ray, and the band's half width across it
};

/// First and last leaf along an axis.
struct LeafSpan {
  std::int32_t first, last;
};

/// Leaves of the voxels whose centres have offsets in [low - margin, high + margin] from the return.
ACCESSVDB_HOSTDEV inline LeafSpan leafSpan(const ReturnRay& ray, int axis, Interval offsets, float margin) {
  const std::int32_t low = -floorToInt(-(offsets.low - margin + ray.offset[axis]));
  const std::int32_t high = floorToInt(offsets.high + margin + ray.offset[axis]);
  return {(ray.base_ijk[axis] + low) >> 3, (ray.base_ijk[axis] + high) >> 3};
}

/// Visits the leaves of a cube around a ball. @param visit  (leaf: const std::int32_t* [3], ijk >> 3)
template <typename Visit>
ACCESSVDB_HOSTDEV inline void forEachLeafAround(const ReturnRay& ball, float radius, const Visit& visit) {
  const LeafSpan x = leafSpan(ball, 0, {-radius, radius}, kSlack), y = leafSpan(ball, 1, {-radius, radius}, kSlack),
                 z = leafSpan(ball, 2, {-radius, radius}, kSlack);
  std::int32_t leaf[3];
  for (leaf[0] = x.first; leaf[0] <= x.last; ++leaf[0]) {
    for (leaf[1] = y.first; leaf[1] <= y.last; ++leaf[1]) {
      for (leaf[2] = z.first; leaf[2] <= z.last; ++leaf[2]) visit(leaf);
    }
  }
}

/// Visits all leaves with a voxel of the part, or one that is at most `margin` voxels from it along each axis.
/// @param along  extent of the part along the dominant axis
/// @param across  (slice of `along`, 0 or 1 for axisB() or axisC()) -> extent across it
/// @param visit  (leaf: const std::int32_t* [3], ijk >> 3)
template <typename Across, typename Visit>
ACCESSVDB_HOSTDEV inline void visitLayers(const RegionSlices& slices, const ReturnRay& ray, Interval along,
                                          float margin, const Across& across, const Visit& visit) {
  if (along.empty()) return;
  const int a = slices.dominantAxis(), b = slices.axisB(), c = slices.axisC();
  const LeafSpan layers = leafSpan(ray, a, along, margin);
  for (std::int32_t layer = layers.first; layer <= layers.last; ++layer) {
    // Voxels of this layer of leaves, and those at most `margin` from them, along the axis.
    const float first = static_cast<float>(layer * 8 - ray.base_ijk[a]) - ray.offset[a];
    const Interval slice = {greater(along.low, first - margin), lesser(along.high, first + 7.0f + margin)};
    if (slice.empty()) continue;
    const LeafSpan rows = leafSpan(ray, b, across(slice, 0), margin),
                   columns = leafSpan(ray, c, across(slice, 1), margin);
    std::int32_t leaf[3];
    leaf[a] = layer;
    for (leaf[b] = rows.first; leaf[b] <= rows.last; ++leaf[b]) {
      for (leaf[c] = columns.first; leaf[c] <= columns.last; ++leaf[c]) visit(leaf);
    }
  }
}

/// Visits the voxels of a thin band, in order from the return: those nearest to samples every v/2 along the ray. One
/// may come twice in a row. @param visit  (voxel: const std::int32_t* [3], relative to ray.base_ijk)
template <typename Visit>
ACCESSVDB_HOSTDEV inline void forEachThinBandVoxel(const RegionConstants& shape, const ReturnRay& ray,
                                                   const Visit& visit) {
  const float end = lesser(shape.band_end, ray.range);
  for (int m = 1;; ++m) {
    const float s = shape.band_begin + 0.5f * static_cast<float>(m);
    if (!(s <= end)) return;
    std::int32_t voxel[3];
    for (int axis = 0; axis < 3; ++axis) voxel[axis] = thinBandVoxel(ray, s, axis);
    visit(voxel);
  }
}

/// Visits the leaves that a return's cone and band may reach; one may come twice.
/// @param visit  (leaf: const std::int32_t* [3], ijk >> 3; part: LeafEntry::kCone or kBand)
template <typename Visit>
ACCESSVDB_HOSTDEV inline void forEachLeafOfReturn(const RegionConstants& shape, const RegionSlices& slices,
                                                  const ReturnRay& ray, const Visit& visit) {
  visitLayers(
      slices, ray, slices.coneAlong(), 0, [&](Interval slice, int n) { return slices.coneAcross(slice, n); },
      [&](const std::int32_t* leaf) { visit(leaf, LeafEntry::kCone); });
  if (!shape.thinBand()) {
    visitLayers(
        slices, ray, slices.bandAlong(), 0, [&](Interval slice, int n) { return slices.bandAcross(slice, n); },
        [&](const std::int32_t* leaf) { visit(leaf, LeafEntry::kBand); });
    return;
  }
  std::int32_t last[3] = {0, 0, 0};
  bool any = false;
  forEachThinBandVoxel(shape, ray, [&](const std::int32_t* voxel) {
    std::int32_t leaf[3];
    bool same = any;
    for (int axis = 0; axis < 3; ++axis) {
      leaf[axis] = (ray.base_ijk[axis] + voxel[axis]) >> 3;
      same = same && leaf[axis] == last[axis];
      last[axis] = leaf[axis];
    }
    any = true;
    if (!same) visit(leaf, LeafEntry::kBand);  // a straight line never returns
  });
}

/// Visits the leaves of a return's line, from the band on.
/// @param visit  (leaf: const std::int32_t* [3], ijk >> 3; bits: const std::uint64_t* [8], the line's voxels in it)
template <typename Visit>
ACCESSVDB_HOSTDEV inline void forEachLeafOfLine(const RegionConstants& shape, const ReturnRay& ray,
                                                const Visit& visit) {
  const ClearedLine line(ray, shape.band_end, shape.line_end);
  if (line.count == 0) return;
  std::int32_t leaf[3] = {0, 0, 0};
  std::uint64_t bits[8] = {};
  for (std::int32_t n = 1; n <= line.count; ++n) {
    std::int32_t voxel[3];
    bool same = n > 1;
    for (int axis = 0; axis < 3; ++axis) {
      voxel[axis] = ray.base_ijk[axis] + line.voxel(n, axis);
      same = same && voxel[axis] >> 3 == leaf[axis];
    }
    if (!same) {
      if (n > 1) visit(leaf, bits);
      for (std::uint64_t& word : bits) word = 0;
      for (int axis = 0; axis < 3; ++axis) leaf[axis] = voxel[axis] >> 3;
    }
    bits[voxel[0] & 7] |= std::uint64_t{1} << (8 * (voxel[1] & 7) + (voxel[2] & 7));
  }
  visit(leaf, bits);
}

}  // namespace accessvdb::kernels

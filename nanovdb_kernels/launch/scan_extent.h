// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where a scan may reach leaves, and how many: before a device takes it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

#include "accessvdb/error.h"
#include "hostdev/leaf_keys.h"
#include "hostdev/return_leaves.h"
#include "hostdev/return_ray.h"

namespace accessvdb::kernels {

/// No less than there is.
struct ScanExtent {
  /// [voxels]
  struct Side {
    double low = std::numeric_limits<double>::max(), high = std::numeric_limits<double>::lowest();

    void add(double base, double to_end) {
      low = std::min(low, std::min(base, base + to_end));
      high = std::max(high, std::max(base, base + to_end));
    }
  };
  Side x, y, z;      ///< of where rays end, and of what they clear; without the width of their regions
  double pairs = 0;  ///< of a return and a leaf that it may reach
};

/// @param balls  the last of the rays, which are positions of the sensor
inline ScanExtent extentOf(const RegionConstants& region, std::span<const ReturnRay> rays, std::uint32_t balls) {
  // Leaves of the cube around a return, and of each layer along its ray.
  const auto cubeOf = [](float voxels) { return std::pow(static_cast<double>(voxels) / 8 + 3, 3); };
  const double across = std::pow(static_cast<double>(region.band_radius) / 2 + 4, 2) + 3,
               of_return = cubeOf(2 * region.tau) + 3 * across;
  const float longest = std::max(region.band_end, region.line_end);
  ScanExtent::Side x, y, z;  // apart, and not in an array: the loop waits for nothing then
  double lengths = 0;
  const auto add = [&](const ReturnRay& ray, double length) {
    x.add(ray.base_ijk[0], length * static_cast<double>(ray.to_sensor[0]));
    y.add(ray.base_ijk[1], length * static_cast<double>(ray.to_sensor[1]));
    z.add(ray.base_ijk[2], length * static_cast<double>(ray.to_sensor[2]));
  };
  for (const ReturnRay& ray : rays.first(rays.size() - balls)) {
    const auto length = static_cast<double>(std::min(longest, ray.range));
    lengths += length;
    add(ray, length);
  }
  for (const ReturnRay& ball : rays.last(balls)) add(ball, 0);
  const double pairs = static_cast<double>(rays.size() - balls) * of_return + lengths / 8 * across +
                       balls * cubeOf(2 * region.ball_radius);
  return {x, y, z, pairs};
}

/// Keys for all leaves that the rays may reach. @param balls  as above
/// @throws ResourceLimit "device.scan_extent"  the scan is too large: the host fuses it
inline LeafKeys leafKeysFor(const RegionConstants& region, std::span<const ReturnRay> rays, std::uint32_t balls) {
  const auto requireAtMost = [](double number, double most) {
    if (number <= most) return;
    throw ResourceLimit("device.scan_extent", "cuda", "the scan is too large to be fused on the GPU",
                        "Use larger voxels, or BackendKind::Cpu");
  };
  const ScanExtent extent = extentOf(region, rays, balls);
  requireAtMost(extent.pairs, std::numeric_limits<std::int32_t>::max());
  LeafKeys keys;
  if (rays.empty()) return keys;
  constexpr float kRounded = 16;  // voxels: bounds of regions are rounded up
  const auto margin = static_cast<double>(std::max({region.tau, region.band_radius, region.ball_radius}) + kRounded);
  double uppers = 1;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const ScanExtent::Side& side = axis == 0 ? extent.x : axis == 1 ? extent.y : extent.z;
    const auto nodeOf = [](double voxels) { return static_cast<std::int64_t>(std::floor(voxels / 4096)); };
    const std::int64_t low = nodeOf(side.low - margin), high = nodeOf(side.high + margin);
    keys.low[axis] = static_cast<std::int32_t>(low);
    keys.size[axis] = static_cast<std::uint32_t>(high - low + 1);
    uppers *= keys.size[axis];
    requireAtMost(uppers, std::numeric_limits<std::uint32_t>::max());
  }
  return keys;
}

}  // namespace accessvdb::kernels

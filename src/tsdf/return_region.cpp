// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/return_region.h"

#include <Eigen/Core>

namespace accessvdb::internal {

RegionShape::RegionShape(const TsdfParams& p) {
  full_cube = p.region == UpdateRegion::FullCube;
  tau = static_cast<float>(p.truncation_distance_m / p.voxel_size_m);
  cone_cos = static_cast<float>(p.cone_cos_min);
  cone_cos_squared = static_cast<float>(p.cone_cos_min * p.cone_cos_min);
  cone_sin_squared = static_cast<float>(1.0 - p.cone_cos_min * p.cone_cos_min);
  band_begin = static_cast<float>(p.cleared_begin_tau * p.truncation_distance_m / p.voxel_size_m);
  band_end = static_cast<float>(p.cleared_end_tau * p.truncation_distance_m / p.voxel_size_m);
  band_radius = static_cast<float>(p.cleared_radius_voxels);
  line_end = static_cast<float>(p.clear_rays_m / p.voxel_size_m);
  ball_radius = static_cast<float>(p.platform_radius_m / p.voxel_size_m);
}

ReturnRay ballAround(const float* q_L, double voxel_size_m) {
  ReturnRay ball = {};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double q = static_cast<double>(q_L[axis]) / voxel_size_m, base = std::floor(q + 0.5);
    ball.base_ijk[axis] = static_cast<std::int32_t>(base);
    ball.offset[axis] = static_cast<float>(q - base);
  }
  return ball;
}

ReturnRay makeRay(const float* p_L, const float* q_L, double voxel_size_m) {
  const Eigen::Vector3d p = Eigen::Map<const Eigen::Vector3f>(p_L).cast<double>() / voxel_size_m;
  const Eigen::Vector3d to_sensor = Eigen::Map<const Eigen::Vector3f>(q_L).cast<double>() / voxel_size_m - p;
  const double range = to_sensor.norm();
  ReturnRay ray = {};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<Eigen::Index>(axis);
    const double base = std::floor(p[a] + 0.5);
    ray.base_ijk[axis] = static_cast<std::int32_t>(base);
    ray.offset[axis] = static_cast<float>(p[a] - base);
    ray.to_sensor[axis] = static_cast<float>(to_sensor[a] / range);
  }
  ray.range = static_cast<float>(range);
  return ray;
}

}  // namespace accessvdb::internal

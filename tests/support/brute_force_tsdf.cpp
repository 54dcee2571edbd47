// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "support/brute_force_tsdf.h"

#include <algorithm>
#include <cmath>

namespace accessvdb::test {
namespace {

using Eigen::Vector3d;

/// Calls body(voxel, centre) for each voxel whose centre is in the box, and one more on each side.
template <typename Body>
void forVoxels(const Vector3d& min, const Vector3d& max, double v, const Body& body) {
  VoxelCoord lo, hi;
  for (std::size_t a = 0; a < 3; ++a) {
    lo[a] = static_cast<std::int32_t>(std::floor(min[static_cast<Eigen::Index>(a)] / v)) - 1;
    hi[a] = static_cast<std::int32_t>(std::ceil(max[static_cast<Eigen::Index>(a)] / v)) + 1;
  }
  for (std::int32_t i = lo[0]; i <= hi[0]; ++i)
    for (std::int32_t j = lo[1]; j <= hi[1]; ++j)
      for (std::int32_t k = lo[2]; k <= hi[2]; ++k) body(VoxelCoord{i, j, k}, Vector3d(i * v, j * v, k * v));
}

}  // namespace

void BruteForceTsdf::integrate(std::span<const Vector3d> points_L, std::span<const Vector3d> sensor_L) {
  for (std::size_t i = 0; i < points_L.size(); ++i) {
    integrateReturn(points_L[i], sensor_L.size() == 1 ? sensor_L.front() : sensor_L[i]);
  }
}

void BruteForceTsdf::integrateReturn(const Vector3d& p, const Vector3d& q) {
  const double v = params_.voxel_size_m, tau = params_.tau_m;
  const double R = (p - q).norm();
  const Vector3d towards_sensor = (q - p) / R;

  // Conditions are written as depths: how far inside in metres, negative outside.
  forVoxels(p.array() - tau, p.array() + tau, v, [&](const VoxelCoord& voxel, const Vector3d& x) {
    const double offset = (x - p).norm();
    const double in_box = tau - (x - p).cwiseAbs().maxCoeff();
    const double in_cone = std::abs((x - p).dot(towards_sensor)) - params_.cone_cos_min * offset;
    const double near = v - offset;
    // The cone is open (> 0.95), the ball and the box are closed.
    const bool updated = in_box >= 0.0 && (in_cone > 0.0 || near >= 0.0);
    BruteForceTsdfVoxel& state = voxels_[voxel];
    state.update_margin_m = std::min(state.update_margin_m, std::abs(std::min(in_box, std::max(in_cone, near))));
    if (updated) {
      state.sum_m += std::clamp(R - (x - q).norm(), params_.clamp_min_m, tau);
      ++state.count;
    }
  });

  const double begin = params_.cleared_begin_tau * tau, end = std::min(params_.cleared_end_tau * tau, R);
  const double radius = params_.cleared_radius_voxels * v;
  if (end < begin) return;
  const Vector3d from = p + begin * towards_sensor, to = p + end * towards_sensor;
  forVoxels(from.cwiseMin(to).array() - radius, from.cwiseMax(to).array() + radius, v,
            [&](const VoxelCoord& voxel, const Vector3d& x) {
              const double s = (x - p).dot(towards_sensor);
              const double across = (x - p - s * towards_sensor).norm();
              BruteForceTsdfVoxel& state = voxels_[voxel];
              state.cleared_depth_m = std::max(state.cleared_depth_m, std::min({radius - across, s - begin, end - s}));
              if (across <= radius && s > begin && s <= end) state.cleared = true;
            });
}

MapVoxel BruteForceTsdf::operator()(const VoxelCoord& voxel) const {
  const auto found = voxels_.find(voxel);
  if (found == voxels_.end()) return {};
  const BruteForceTsdfVoxel& state = found->second;
  MapVoxel result;
  result.observed = state.count > 0;
  result.weight = state.count;
  result.cleared = state.cleared;
  if (result.observed) result.distance_m = static_cast<float>(state.sum_m / state.count);
  return result;
}

}  // namespace accessvdb::test

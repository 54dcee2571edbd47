// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "unit/tsdf/loop_tsdf.h"

#include <algorithm>
#include <cmath>
#include <random>

namespace accessvdb::test {

using Eigen::Vector3d;

void LoopTsdf::integrate(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L) {
  for (std::size_t n = 0; n < p_L.size(); ++n) {
    integrateReturn(p_L[n].cast<double>() / params_.voxel_size_m,
                    q_L[q_L.size() == 1 ? 0 : n].cast<double>() / params_.voxel_size_m);
  }
}

void LoopTsdf::integrateReturn(const Vector3d& p, const Vector3d& q) {
  const double v = params_.voxel_size_m, tau = params_.truncation_distance_m / v;
  const double range = (q - p).norm();
  const Vector3d u = (q - p) / range;
  const double band_begin = params_.cleared_begin_tau * tau, band_end = std::min(params_.cleared_end_tau * tau, range);
  const bool thin = params_.cleared_radius_voxels <= 0;
  const int reach = static_cast<int>(std::ceil(std::max(tau, params_.cleared_end_tau * tau + 4))) + 1;
  const std::array<int, 3> base = {static_cast<int>(std::lround(p.x())), static_cast<int>(std::lround(p.y())),
                                   static_cast<int>(std::lround(p.z()))};
  for (int i = base[0] - reach; i <= base[0] + reach; ++i) {
    for (int j = base[1] - reach; j <= base[1] + reach; ++j) {
      for (int k = base[2] - reach; k <= base[2] + reach; ++k) {
        const Vector3d x(i, j, k), e = x - p;
        const double s = e.dot(u);
        const double in_cube = tau - e.cwiseAbs().maxCoeff();
        double in_region = 0;
        if (params_.region == UpdateRegion::DoubleCone) {
          in_region = std::max(std::abs(s) - params_.cone_cos_min * e.norm(), 1.0 - e.norm());
        } else {
          in_region = (x - q).dot(p - q) / range - params_.cone_cos_min * (x - q).norm();
        }
        const double inside = std::min(in_cube, in_region);
        const double in_band =
            thin ? -1 : std::min({s - band_begin, band_end - s, params_.cleared_radius_voxels - (e - s * u).norm()});
        if (inside < -0.01 && in_band < -0.01) continue;
        LoopVoxel& voxel = voxels[{i, j, k}];
        voxel.update_margin = std::min(voxel.update_margin, std::abs(inside));
        if (inside > 0) {
          voxel.sum_m += std::clamp((range - (x - q).norm()) * v, params_.clamp_min_m, params_.truncation_distance_m);
          ++voxel.count;
          ++updates;
        }
        if (in_band > 0) voxel.cleared = true;
        if (!thin) voxel.cleared_margin = std::min(voxel.cleared_margin, std::abs(in_band));
      }
    }
  }
  for (int m = 1; thin && band_begin + 0.5 * m <= band_end; ++m) {
    const Vector3d at = p + (band_begin + 0.5 * m) * u;
    const Vector3d nearest(std::floor(at.x() + 0.5), std::floor(at.y() + 0.5), std::floor(at.z() + 0.5));
    // A sample this near to a face may fall into the voxel on the other side: skip the whole neighbourhood.
    const double margin = 0.5 - (at - nearest).cwiseAbs().maxCoeff();
    for (int n = 0; n < 27; ++n) {
      if (n != 13 && margin >= 1e-3) continue;
      LoopVoxel& voxel =
          voxels[{static_cast<int>(nearest.x()) + n / 9 - 1, static_cast<int>(nearest.y()) + n / 3 % 3 - 1,
                  static_cast<int>(nearest.z()) + n % 3 - 1}];
      voxel.cleared_margin = std::min(voxel.cleared_margin, margin);
      if (n == 13) voxel.cleared = true;
    }
  }
}

std::vector<Eigen::Vector3f> wavySheet(std::size_t n, double voxel_size_m, unsigned seed) {
  std::mt19937 random(seed);
  const auto uniform = [&random](double low, double high) {
    return low + (high - low) * static_cast<double>(random()) / static_cast<double>(std::mt19937::max());
  };
  std::vector<Eigen::Vector3f> points(n);
  for (auto& point : points) {
    const double x = uniform(-20, 20), y = uniform(-20, 20);
    const double z = 4 * std::sin(0.3 * x) + 3 * std::cos(0.2 * y) + uniform(-1, 1);
    point = (Eigen::Vector3d(x, y, z) * voxel_size_m).cast<float>();
  }
  return points;
}

}  // namespace accessvdb::test

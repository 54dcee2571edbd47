// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "report/surface_area.h"

#include <Eigen/Geometry>
#include <array>
#include <cmath>

namespace accessvdb::internal {
namespace {

/// Where a plane cuts the edges of the unit cube: at most six corners of a polygon, in no order.
struct Cuts {
  std::array<Eigen::Vector3d, 12> at;
  int count = 0;
};

Cuts cutsOf(const Eigen::Vector3d& p, const Eigen::Vector3d& n) {
  Cuts cuts;
  const double at_zero = -n.dot(p);
  for (int axis = 0; axis < 3; ++axis) {
    const int one = (axis + 1) % 3, other = (axis + 2) % 3;
    for (int edge = 0; edge < 4; ++edge) {
      const double low = at_zero + (edge & 1) * n[one] + (edge >> 1) * n[other], high = low + n[axis];
      if ((low < 0) == (high < 0)) continue;
      Eigen::Vector3d& corner = cuts.at[static_cast<std::size_t>(cuts.count++)];
      corner[one] = edge & 1;
      corner[other] = edge >> 1;
      corner[axis] = low / (low - high);
    }
  }
  return cuts;
}

/// Rises with the angle of (x, y) from -pi to pi, and takes a fifth of the time.
double turnOf(double x, double y) {
  const double size = std::abs(x) + std::abs(y), part = size > 0 ? y / size : 0;
  return x >= 0 ? part : y >= 0 ? 2 - part : -2 - part;
}

}  // namespace

double areaOfPoint_m2(const Eigen::Vector3d& place, const Eigen::Vector3f& normal_W, double voxel_size_m) {
  /// For random directions and places; build/ci/bin/report_test --gtest_filter=*MeanOverAllPlanes* makes it.
  constexpr double kMean = 0.941;
  const double face_m2 = voxel_size_m * voxel_size_m;
  const Eigen::Vector3d n = normal_W.cast<double>();
  if (!(n.squaredNorm() > 0) || !place.allFinite()) return kMean * face_m2;
  // A plane in a face of the voxel belongs to it, whichever way it looks.
  constexpr double kInside = 1e-6;
  const Cuts cuts = cutsOf(place.cwiseMax(kInside).cwiseMin(1 - kInside), n);
  const Eigen::Vector3d u = n.unitOrthogonal(), v = n.cross(u).normalized();
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (int k = 0; k < cuts.count; ++k) middle += cuts.at[static_cast<std::size_t>(k)] / cuts.count;
  struct Corner {
    double angle, x, y;
  };
  std::array<Corner, 12> corners;  // around the middle
  for (int k = 0; k < cuts.count; ++k) {
    const Eigen::Vector3d from_middle = cuts.at[static_cast<std::size_t>(k)] - middle;
    const double x = u.dot(from_middle), y = v.dot(from_middle), angle = turnOf(x, y);
    auto at = static_cast<std::size_t>(k);
    for (; at > 0 && corners[at - 1].angle > angle; --at) corners[at] = corners[at - 1];
    corners[at] = {angle, x, y};
  }
  double twice = 0;
  for (int k = 0; k < cuts.count; ++k) {
    const Corner &a = corners[static_cast<std::size_t>(k)],
                 &b = corners[static_cast<std::size_t>((k + 1) % cuts.count)];
    twice += a.x * b.y - b.x * a.y;
  }
  return twice / 2 * face_m2;
}

double areaOfCell_m2(const Eigen::Vector3f& normal_W, double cell_m) {
  const Eigen::Vector3d n = normal_W.cast<double>();
  return cell_m * cell_m * n.norm() / n.cwiseAbs().maxCoeff();
}

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/range_image.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace accessvdb::internal {
namespace {

using std::numbers::pi;

/// Angle of (x, y) in [-pi, pi], within 4e-7. Branches would keep the loops below from being vectorised.
/// Reduction and coefficients: Cephes, atanf.
inline float angleOf(float y, float x) {
  constexpr float kHalfPi = 1.57079632679489662f, kQuarterPi = 0.785398163397448310f, kWhole = 3.14159265358979324f;
  constexpr float kTanEighth = 0.414213562373095049f;
  const float ax = std::fabs(x), ay = std::fabs(y);
  const float low = ax < ay ? ax : ay, high = ax < ay ? ay : ax;
  const float slope = low / (high > 0.0f ? high : 1.0f);
  const bool steep = slope > kTanEighth;
  const float t = steep ? (slope - 1.0f) / (slope + 1.0f) : slope;
  const float z = t * t;
  const float bend =
      (((8.05374449538e-2f * z - 1.38776856032e-1f) * z + 1.99777106478e-1f) * z - 3.33329491539e-1f) * z * t + t;
  const float octant = bend + (steep ? kQuarterPi : 0.0f);
  const float quadrant = ax < ay ? kHalfPi - octant : octant;
  const float half = x < 0.0f ? kWhole - quadrant : quadrant;
  return y < 0.0f ? -half : half;
}

struct Projection {
  float range, column, row;
};

/// Bins of a position in the sensor frame. Rounding at the seam must not lead out of the image.
inline Projection projectionOf(float x, float y, float z, float bins_per_rad, float last_column, float last_row) {
  const float flat2 = x * x + y * y;
  const float column = (angleOf(y, x) + static_cast<float>(pi)) * bins_per_rad;
  const float row = (angleOf(z, std::sqrt(flat2)) + static_cast<float>(pi / 2)) * bins_per_rad;
  const float column_up = column > 0.0f ? column : 0.0f, row_up = row > 0.0f ? row : 0.0f;
  return {std::sqrt(flat2 + z * z), column_up < last_column ? column_up : last_column,
          row_up < last_row ? row_up : last_row};
}

/// The largest float whose integer part is bins - 1.
float lastOf(int bins) { return std::nextafter(static_cast<float>(bins), 0.0f); }

std::vector<std::array<float, 2>> cosineAndSine(int count, double first_rad, double step_rad) {
  std::vector<std::array<float, 2>> table;
  for (int n = 0; n < count; ++n) {
    const double angle = first_rad + (n + 0.5) * step_rad;
    table.push_back({static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle))});
  }
  return table;
}

}  // namespace

RangeImage::RangeImage(double bin_rad)
    : columns_(2 * std::max(2, static_cast<int>(std::lround(pi / bin_rad)))),
      rows_(columns_ / 2),
      bin_rad_(2 * pi / columns_),
      ranges_(index(0, rows_), 0.0f),
      azimuth_(cosineAndSine(columns_, -pi, bin_rad_)),
      elevation_(cosineAndSine(rows_, -pi / 2, bin_rad_)) {}

void RangeImage::fill(std::span<const Eigen::Vector3f> p_L, const Eigen::Vector3f& q_L, const Eigen::Matrix3d& R_W_S,
                      double voxel_size_m) {
  for (const std::uint32_t bin : filled_) ranges_[bin] = 0;
  filled_.clear();
  const auto bins_per_rad = static_cast<float>(1 / bin_rad_);
  const float last_column = lastOf(columns_), last_row = lastOf(rows_);
  for (const Eigen::Vector3f& point : p_L) {
    const Eigen::Vector3f p_S =
        (R_W_S.transpose() * (point.cast<double>() - q_L.cast<double>()) / voxel_size_m).cast<float>();
    const Projection at = projectionOf(p_S.x(), p_S.y(), p_S.z(), bins_per_rad, last_column, last_row);
    const std::size_t bin = index(static_cast<int>(at.column), static_cast<int>(at.row));
    if (ranges_[bin] == 0) filled_.push_back(static_cast<std::uint32_t>(bin));
    if (ranges_[bin] == 0 || at.range < ranges_[bin]) ranges_[bin] = at.range;
  }
}

Eigen::Vector3d RangeImage::directionAt(double column, double row) const {
  const double azimuth = column * bin_rad_ - pi, elevation = row * bin_rad_ - pi / 2;
  return {std::cos(azimuth) * std::cos(elevation), std::sin(azimuth) * std::cos(elevation), std::sin(elevation)};
}

Eigen::Vector3f RangeImage::centreOf(int column, int row) const {
  const auto& [ca, sa] = azimuth_[static_cast<std::size_t>(column)];
  const auto& [ce, se] = elevation_[static_cast<std::size_t>(row)];
  return {ca * ce, sa * ce, se};
}

void RangeImage::project(const Eigen::Vector3f& first, const Eigen::Matrix3f& steps, LeafProjection& out) const {
  const auto bins_per_rad = static_cast<float>(1 / bin_rad_);
  const float last_column = lastOf(columns_), last_row = lastOf(rows_);
  const float zx = steps(0, 2), zy = steps(1, 2), zz = steps(2, 2);
  for (int row = 0; row < 64; ++row) {
    const Eigen::Vector3f begin =
        first + static_cast<float>(row >> 3) * steps.col(0) + static_cast<float>(row & 7) * steps.col(1);
    const float bx = begin.x(), by = begin.y(), bz = begin.z();
    float* range = out.range.data() + 8 * row;
    float* column = out.column.data() + 8 * row;
    float* elevation = out.row.data() + 8 * row;
    for (int n = 0; n < 8; ++n) {
      const auto k = static_cast<float>(n);
      const Projection at = projectionOf(bx + k * zx, by + k * zy, bz + k * zz, bins_per_rad, last_column, last_row);
      range[n] = at.range;
      column[n] = at.column;
      elevation[n] = at.row;
    }
  }
}

}  // namespace accessvdb::internal

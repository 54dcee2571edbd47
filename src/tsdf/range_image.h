// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The nearest range of a scan in each bin of azimuth and elevation of the sensor frame (docs/PAPER_MAP.md,
/// "Baselines").
///
/// Azimuth and elevation come from polynomials in this file, never from libm, so that bins are the same everywhere.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace accessvdb::internal {

/// The 512 voxels of a leaf as the sensor sees them, in the leaf's order.
struct LeafProjection {
  alignas(64) std::array<float, 512> range;   ///< |x - q| in voxels
  alignas(64) std::array<float, 512> column;  ///< azimuth in bins, integer part in 0 .. columns - 1
  alignas(64) std::array<float, 512> row;     ///< elevation in bins, integer part in 0 .. rows - 1
};

class RangeImage {
 public:
  /// @param bin_rad  edge of a bin; adjusted slightly so that a whole number fills the circle
  explicit RangeImage(double bin_rad);

  /// Replaces the image. @param p_L  [n] returns, none at the sensor  @param q_L  sensor; both local frame, metres
  void fill(std::span<const Eigen::Vector3f> p_L, const Eigen::Vector3f& q_L, const Eigen::Matrix3d& R_W_S,
            double voxel_size_m);

  [[nodiscard]] int columns() const { return columns_; }
  [[nodiscard]] int rows() const { return rows_; }
  [[nodiscard]] double bin_rad() const { return bin_rad_; }
  /// Voxels; 0 = empty.
  [[nodiscard]] float at(int column, int row) const { return ranges_[index(column, row)]; }
  /// Indices of the filled bins, row * columns + column, each once, in no particular order.
  [[nodiscard]] std::span<const std::uint32_t> filled() const { return filled_; }

  /// Unit vector of the image position, in bins, in the sensor frame; bin centres are at halves.
  [[nodiscard]] Eigen::Vector3d directionAt(double column, double row) const;
  /// Same for the centre of a bin, from a table.
  [[nodiscard]] Eigen::Vector3f centreOf(int column, int row) const;

  /// Projects a leaf. @param first  its lowest voxel in the sensor frame, voxels from the sensor
  /// @param steps  columns: one voxel along x, y and z of the map, in the sensor frame
  void project(const Eigen::Vector3f& first, const Eigen::Matrix3f& steps, LeafProjection& out) const;

 private:
  [[nodiscard]] std::size_t index(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) + static_cast<std::size_t>(column);
  }

  int columns_, rows_;
  double bin_rad_;
  std::vector<float> ranges_;  ///< [rows][columns]
  std::vector<std::uint32_t> filled_;
  std::vector<std::array<float, 2>> azimuth_, elevation_;  ///< cosine and sine at bin centres
};

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What scans are like before they are mapped: how dense, how noisy, how large. Looks at whole blocks of space, chosen
/// by chance, so that density is that of all scans and memory stays bounded.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "accessvdb/scan_io.h"

namespace accessvdb::tools {

/// Noise of the ranges, from surfaces that are flat.
struct PlaneNoise {
  double sigma_m = 0;        ///< along the rays: median over the planes
  double plane_m = 0;        ///< diameter of the flat pieces
  std::uint64_t planes = 0;  ///< how many there are
};

class CloudSurvey {
 public:
  void add(const io::ScanRecord& record);

  [[nodiscard]] std::uint64_t returns() const { return returns_; }
  [[nodiscard]] const Eigen::AlignedBox3d& extent_W() const { return extent_W_; }
  [[nodiscard]] double medianRange_m() const;
  /// Points whose 3 x 3 x 3 voxels of that size hold `least` returns or more, over all points looked at.
  /// @param times  scans that stand for one that was read
  [[nodiscard]] double shareSeen(double voxel_m, double least, double times) const;
  /// Median distance from a point to its nearest neighbour among all scans read; 0 for fewer than two points.
  [[nodiscard]] double spacing_m() const;
  /// Nothing without 10 planes.
  [[nodiscard]] std::optional<PlaneNoise> noise() const;

 private:
  struct Return {
    Eigen::Vector3f p_L, u;  ///< from the first sensor position; unit, towards the sensor
  };
  void keep(const Return& one);
  /// Thickness of each disc of that size that is flat, and how many were looked at.
  [[nodiscard]] std::pair<std::vector<double>, std::size_t> planesOf(double edge_m) const;
  /// @param seed, around  indices into kept_: of a cube, and of the 27 around it
  [[nodiscard]] std::optional<double> thicknessOf(const std::vector<std::uint32_t>& seed,
                                                  const std::vector<std::uint32_t>& around, double edge_m) const;

  std::optional<Eigen::Vector3d> origin_W_;
  std::vector<Return> kept_;
  std::uint64_t returns_ = 0;
  std::uint64_t block_share_ = 1;  ///< one in so many blocks is looked at
  Eigen::AlignedBox3d extent_W_;
  std::vector<float> ranges_m_;
};

}  // namespace accessvdb::tools

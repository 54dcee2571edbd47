// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What one scan sees in which direction: the nearest and the farthest return of each cell of a cube around the sensor.
/// It is in the sensor's frame, so it stays the same whatever the scan's pose turns out to be.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace accessvdb::io {

class ScanView {
 public:
  enum class Answer {
    Surface,
    Free,
    Hidden,
    Nothing,  ///< the scan has no return around that direction
    Unknown   ///< between the rows of a scanner, at an edge, at the rim of what the scan sees
  };

  /// @param returns_S  finite, none at the origin
  explicit ScanView(const std::vector<Eigen::Vector3f>& returns_S);

  /// Free only where returns all around lie beyond p by more than the tolerance: three sigma and the cells' width.
  [[nodiscard]] Answer at(const Eigen::Vector3f& p_S, float three_sigma_m) const;

 private:
  struct Span {
    float nearest, farthest;
  };

  /// Whether there are returns within a few cells of that direction.
  [[nodiscard]] bool seesAround(const Eigen::Vector3f& p_S) const;
  [[nodiscard]] std::size_t cellOf(const Eigen::Vector3f& p_S) const;

  int edge_cells_ = 0;  ///< of one face of the cube
  int stride_ = 0;      ///< cells and a border that holds nothing
  float width_rad_ = 0;
  std::vector<Span> cells_;
};

}  // namespace accessvdb::io

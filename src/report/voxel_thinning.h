// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Fewer points where there are too many to draw: one per cell of a grid and reason, so that no reason vanishes behind
/// another one; of several tools one per set of those that reach it, too.
#pragma once

#include <array>
#include <cstdint>
#include <unordered_set>

#include "report/field_folder.h"

namespace accessvdb::internal {

class VoxelThinning {
 public:
  /// @param cell_m  edge of a cell; 0 keeps every point
  VoxelThinning(const Eigen::Vector3d& origin_W, double cell_m) : origin_W_(origin_W), cell_m_(cell_m) {}

  /// Whether the point is the first one of its cell, reason and tools.
  bool keep(const SurfacePoint& point);
  [[nodiscard]] std::uint64_t kept() const { return kept_; }

 private:
  struct Cell {
    std::array<double, 3> ijk;  ///< whole numbers; positions may be far beyond what an int32 can count
    PointReason reason;
    std::uint32_t tools;
    bool operator==(const Cell&) const = default;
  };
  struct CellHash {
    std::size_t operator()(const Cell& cell) const noexcept;
  };
  Eigen::Vector3d origin_W_;
  double cell_m_;
  std::uint64_t kept_ = 0;
  std::unordered_set<Cell, CellHash> cells_;
};

/// The smallest edge that was found to keep at most `most` points; 0 if that many need no thinning. Reads the points as
/// often as it takes, but never holds more than `most` of them.
[[nodiscard]] double thinningCell_m(const FieldFolder& folder, std::uint64_t most);

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which points may not be accessible because of returns that were left out
/// (docs/design/left_out.md, "What is left out blocks"): those whose neighbour search reaches a voxel that is left out,
/// and, where not even voxels are kept, those whose label could depend on anything there. Laid over the state of the
/// points when it is read, as what has gone is.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <set>
#include <span>
#include <unordered_set>
#include <vector>

#include "accessvdb/point_label.h"
#include "change/leaf_flags.h"
#include "change/ray_evidence.h"
#include "field/tools/window_margins.h"
#include "points/point_store.h"
#include "tsdf/left_out_voxels.h"

namespace accessvdb::internal {

class LeftOutPoints {
 public:
  /// Values of withheld(), beside 0.
  static constexpr std::uint8_t kGone = 1, kLeftOut = 2;

  LeftOutPoints(const WindowMargins& reach, const FieldParams& resolved);

  /// More was left out in these leaves. @param origins  lowest voxels
  void noteLeaves(std::span<const openvdb::Coord> origins);
  /// No voxels are kept any more.
  void forgetLeaves() { near_.clear(); }
  /// Of these voxels, those around which returns are missing by which it is judged what has gone.
  [[nodiscard]] LeafBits nearLeftOut(const OpenedLeaf& opened, const LeftOutVoxels& voxels) const;
  /// Returns were left out at most this far from a position, and no voxel says where. Positions that are not finite are
  /// no returns.
  void close(const Eigen::Vector3d& centre_W, double radius_m);

  /// At each update. @param gone  GonePoints::published()
  void publish(const PointStore& points, const LeftOutVoxels& voxels, const std::vector<std::uint8_t>& gone,
               const Eigen::Vector3d& origin_W);
  /// By id, as of the last publish(): 0, kGone or kLeftOut. Later points are neither.
  [[nodiscard]] std::span<const std::uint8_t> withheld(const std::vector<std::uint8_t>& gone) const {
    return any_ ? std::span<const std::uint8_t>(withheld_) : std::span<const std::uint8_t>(gone);
  }

  using Cube = std::array<std::int64_t, 3>;
  /// Cubes of the world in which nothing is accessible, nor beside them.
  [[nodiscard]] const std::set<Cube>& closedCubes() const { return closed_; }
  /// Of them: the base edge, doubled so many times.
  [[nodiscard]] std::uint32_t doublings() const { return doublings_; }
  /// @return false if no field can have such cubes
  [[nodiscard]] bool restoreCubes(std::uint32_t doublings, const std::vector<Cube>& cubes);
  [[nodiscard]] std::uint64_t bytes() const;

  static constexpr std::size_t kMostCubes = std::size_t{1} << 16;
  static constexpr double kLargestRadius_m = 1e6;

 private:
  struct Hash {
    std::size_t operator()(const Cube& cube) const;
  };
  [[nodiscard]] bool isNear(const Index3& leaf) const;
  void closeCube(const Cube& cube);
  void doubleCubes();
  [[nodiscard]] bool reachesLeftOut(const Index3& voxel, const LeftOutVoxels& voxels) const;

  std::int32_t
      reach_;  ///< [voxels] from a point to the farthest return that decides on its normal, or whether it is gone
  std::int32_t near_leaves_;
  double edge_m_;
  std::uint32_t doublings_ = 0;
  LeafFlags near_;                         ///< leaves at most so many from one with voxels left out
  std::set<Cube> closed_;                  ///< in order: files do not depend on when they came
  std::unordered_set<Cube, Hash> shadow_;  ///< closed cubes and those beside them
  std::vector<std::uint8_t> withheld_;
  bool any_ = false;
};

/// Why a point that is withheld is unscored: the surface has gone, or too little of it is in the map.
[[nodiscard]] constexpr PointReason reasonOf(std::uint8_t withheld) {
  return withheld == LeftOutPoints::kGone ? PointReason::Changed : PointReason::Confidence;
}

}  // namespace accessvdb::internal

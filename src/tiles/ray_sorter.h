// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which rays of a step come near which tile: with ChangeMode::Full they are evidence there, wherever they return.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <map>
#include <span>
#include <vector>

#include "field/field_access.h"
#include "field/scan_gate.h"
#include "tiles/ray_shard.h"

namespace accessvdb::tiles {

class RaySorter {
 public:
  /// @param margin_voxels  of returns. Rays may open what has to be exact, and where returns within tau of that lie,
  ///                       which decides on their votes: that is nearer to the core by more than tau
  ///                       (WindowMargins::returns)
  RaySorter(std::int32_t tile_voxels, std::int32_t margin_voxels, double voxel_size_m);

  using Wanted = std::function<bool(const TileIndex& tile)>;
  /// @return tiles that rays come near, of those that are wanted, by their ids; valid until the next call
  std::span<const TileIndex> sort(const internal::GatedScan& scan, const Wanted& is_wanted);
  /// Of the scan that was sorted last. Valid until the next call.
  internal::FieldAccess::Returns raysOf(const TileIndex& tile, const internal::GatedScan& scan);

 private:
  struct Rays {
    bool wanted;
    std::vector<std::uint32_t> rays;
  };
  [[nodiscard]] Eigen::Vector2d voxelsOf(const Eigen::Vector3f& x_L) const;
  template <typename Visit>
  void forEachTile(const Eigen::Vector2d& from, const Eigen::Vector2d& to, const Visit& visit) const;

  std::int32_t tile_voxels_;
  double margin_voxels_, voxel_size_m_;
  std::map<TileIndex, Rays> rays_of_;
  std::vector<TileIndex> crossed_;
  std::vector<Eigen::Vector3f> p_L_, q_L_;
};

}  // namespace accessvdb::tiles

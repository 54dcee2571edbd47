// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which returns of a step go to which tile.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <span>
#include <unordered_map>
#include <vector>

#include "field/scan_gate.h"
#include "tiles/ray_shard.h"
#include "tiles/tile_grid.h"

namespace accessvdb::tiles {

[[nodiscard]] float longestRay_m(const internal::GatedScan& scan);

class StepSorter {
 public:
  /// @param margin_voxels  returns this far outside a tile's core are needed there, too
  StepSorter(std::int32_t tile_voxels, std::int32_t margin_voxels, double voxel_size_m);

  /// @return the tiles that need returns of the scan, in the order of the first of them; valid until the next call
  std::span<const TileIndex> sort(const internal::GatedScan& scan);

  struct Returns {
    std::span<const Eigen::Vector3f> p_L, q_L;  ///< q_L: [n] or [1], as in the scan
    std::span<const std::int32_t> attributes;   ///< a row for each
  };
  /// Of the scan that was sorted last. Valid until the next call. @param tile  one of those
  Returns returnsOf(const TileIndex& tile, const internal::GatedScan& scan);

 private:
  struct Hash {
    std::size_t operator()(const TileIndex& tile) const {
      return (static_cast<std::size_t>(static_cast<std::uint32_t>(tile.first)) << 32 |
              static_cast<std::uint32_t>(tile.second)) *
             0x9e3779b97f4a7c15u;
    }
  };

  TileGrid grid_;
  float inverse_voxel_size_;
  std::unordered_map<TileIndex, std::vector<std::uint32_t>, Hash> returns_of_;
  std::vector<TileIndex> touched_;
  std::vector<Eigen::Vector3f> p_L_, q_L_;
  std::vector<std::int32_t> attributes_;
};

}  // namespace accessvdb::tiles

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A scan with ChangeMode::Full, which all tiles that it touches go through together: what a cell is judged by may lie
/// in other tiles, and what opens depends on verdicts there. Each judges the cells of its core.
#pragma once

#include <cstdint>
#include <vector>

#include "accessvdb/types.h"
#include "field/field_access.h"
#include "field/scan_gate.h"
#include "tiles/ray_shard.h"
#include "tiles/ray_sorter.h"
#include "tiles/rolling_tiles.h"
#include "tiles/step_sorter.h"

namespace accessvdb::tiles {

/// A tile that a scan touches.
struct TouchedTile {
  TileIndex id;
  RollingTile* tile;  ///< null if it does not fit
  bool has_returns;   ///< else only rays come near it, with ChangeMode::Full
  bool is_new;
};

class SharedScan {
 public:
  /// What the larger map knows of the scan.
  struct Moment {
    double stamp_s;       ///< not finite: none
    std::uint64_t scans;  ///< with a return, before this one
    double age_s;         ///< MapTime::age_s, with this one
  };
  /// @param here  in memory; those with returns may change  @param sorter, ray_sorter  have sorted the scan
  SharedScan(const internal::GatedScan& scan, const Moment& moment, std::vector<TouchedTile> here, StepSorter& sorter,
             RaySorter& ray_sorter);

  struct OfTile {
    FrameStats stats;
    bool has_changed;  ///< what a saved state holds
  };
  /// Once. @param margin_voxels  how far outside its core a tile holds something  @return for each tile, in their order
  [[nodiscard]] std::vector<OfTile> fuse(std::int32_t tile_voxels, std::int32_t margin_voxels) const;

 private:
  template <typename Visit>
  void forEachCells(const Visit& visit) const;
  void catchUp(std::int32_t tile_voxels) const;
  void begin() const;
  void judge() const;
  [[nodiscard]] std::vector<internal::OpenedLeaf> open() const;

  const internal::GatedScan& scan_;
  Moment moment_;
  std::vector<TouchedTile> here_;
  StepSorter& sorter_;
  RaySorter& ray_sorter_;
};

}  // namespace accessvdb::tiles

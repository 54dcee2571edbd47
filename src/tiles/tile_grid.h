// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which tiles need a return. Edges are powers of two voxels, so this takes shifts, no divisions. And how far beyond
/// its core a tile needs them.
#pragma once

#include <bit>
#include <cstdint>

#include "accessvdb/tiles.h"
#include "field/tools/window_margins.h"

namespace accessvdb::tiles {

/// @param reach  of the tools' results
[[nodiscard]] TileMargins marginsFrom(const internal::WindowMargins& reach);

struct TileRange {
  std::int32_t x_low, x_high, y_low, y_high;  ///< inclusive
};

class TileGrid {
 public:
  /// @param tile_voxels  a power of two  @param margin_voxels  returns this far outside a core are needed too
  TileGrid(std::int32_t tile_voxels, std::int32_t margin_voxels)
      : shift_(std::countr_zero(static_cast<std::uint32_t>(tile_voxels))), margin_(margin_voxels) {}

  [[nodiscard]] TileRange around(std::int32_t i, std::int32_t j) const {
    return {(i - margin_) >> shift_, (i + margin_) >> shift_, (j - margin_) >> shift_, (j + margin_) >> shift_};
  }

 private:
  int shift_;
  std::int32_t margin_;
};

}  // namespace accessvdb::tiles

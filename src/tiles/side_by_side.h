// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Maps in tiles with ChangeMode::Full: bin() takes all tiles through the scans side by side, as a RollingField in
/// rays/, which is never updated; run() scores one tile and writes its files.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/tiles.h"
#include "field/tools/shared_tables.h"

namespace accessvdb::tiles {

[[nodiscard]] bool goesSideBySide(const FieldParams& params);

/// bin(). The folder of rays holds nothing of others.
[[nodiscard]] Binned passSideBySide(const Job& job, std::span<io::ScanSequence* const> flights, const Watch& watch,
                                    const BinLimits& limits);

/// hasRays(). @param inputs  Binned::inputs
[[nodiscard]] bool hasFused(const Job& job, const std::vector<io::InputFile>& inputs);

/// A tile that has taken all scans, without labels.
struct FusedTile {
  std::unique_ptr<internal::SharedTables> tables;
  AccessibilityField field;
  std::uint64_t returns;
  /// The step that brought the first return of a point, by its id in the tile.
  std::function<std::uint32_t(std::uint32_t id)> stepOf;
};
/// @param inputs  Binned::inputs  @throws InputError "rays.missing", "rays.damaged"
[[nodiscard]] FusedTile loadFused(const Job& job, const std::vector<io::InputFile>& inputs, const TileId& id);

}  // namespace accessvdb::tiles

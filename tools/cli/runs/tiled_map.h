// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// `map` in tiles: plan, bin, run and index in one go; whatever an earlier run finished is not done again.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "accessvdb/tiles.h"
#include "output/error_output.h"
#include "output/report.h"
#include "runs/tile_job.h"

namespace accessvdb::tools {

/// Points of all tiles that are drawn: enough for a picture of 1600 by 1000 pixels.
inline constexpr std::uint64_t kPicturePoints = 2'000'000;

/// Reads all scans into rays/. @param limit_bytes  tiles::BinLimits
/// @return what was read; not complete if a signal stopped it
[[nodiscard]] tiles::Binned binWithProgress(const tiles::Job& job, std::span<io::ScanSequence* const> flights,
                                            std::optional<std::uint64_t> limit_bytes, Messages& messages);

/// Runs tiles one after the other; one line for each. @return the finished ones among them
struct TileWork {
  const tiles::Job& job;
  const tiles::Binned& rays;
  tiles::RunLimits limits;
};
std::vector<tiles::Tile> runWithProgress(const TileWork& work, const std::vector<tiles::TileId>& todo,
                                         Messages& messages);

/// field.json, preview.png and report.json from what is finished.
struct TiledResult {
  const tiles::Job& job;
  const MapOptions& options;
  const tiles::Binned& rays;
  const tiles::Status& status;
};
void writeResult(const TiledResult& result, RunReport& report, Messages& messages);

/// @throws ResourceLimit "limit.memory" if one field.vdb of all tiles would not fit
void requireRoomForGrids(const tiles::Status& status, std::optional<std::uint64_t> limit_bytes);

/// @throws InvalidArgument "usage.tiles"
void requireTilesPossible(const MapOptions& options, const FieldParams& params);

/// @param chosen_voxels  edge of a tile that the prediction of memory chose; 0 takes --tiles
/// @return 0, or 128 + the signal that stopped it
int mapInTiles(const PlanSources& sources, std::int32_t chosen_voxels, RunReport& report, Messages& messages);

}  // namespace accessvdb::tools

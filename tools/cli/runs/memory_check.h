// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A pass over the scans that predicts a run's memory before any work, and refuses a run that will not fit.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>

#include "accessvdb/program/memory_prediction.h"
#include "accessvdb/scan_io.h"
#include "accessvdb/tiles.h"
#include "accessvdb/tool_geometry.h"
#include "accessvdb/tool_spec.h"
#include "options/map_options.h"

namespace accessvdb::tools {

struct MemoryCheck {
  std::uint64_t predicted_bytes = 0;  ///< peak in one piece
  std::uint64_t limit_bytes = 0;      ///< --max-memory, else what the machine can give
  std::int32_t tile_voxels = 0;       ///< edge of the largest tiles that fit; 0 if one piece fits
};

/// Reads all scans, or without --max-memory at most a few million returns, and then predicts a lower bound.
/// @param marginsOfTiles  if tiles may be used where one piece does not fit; called only then, as it makes the tools'
/// tables
/// @return nothing if a signal stopped it
/// @throws ResourceLimit "limit.memory" with the smallest voxel that fits, "tool.span", "tool.columns"; InputError
///         while reading
[[nodiscard]] std::optional<MemoryCheck> checkMemory(const MapOptions& options, const std::vector<ToolSpec>& tools,
                                                     RunOutput output, io::ScanSequence& scans,
                                                     const std::function<tiles::TileMargins()>& marginsOfTiles,
                                                     Messages& messages);

/// --max-memory, else what the machine can give, else nothing.
[[nodiscard]] std::optional<std::uint64_t> memoryLimit(const MapOptions& options);

}  // namespace accessvdb::tools

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A pass over the scans that predicts a run's memory before any work, and refuses a run that will not fit.
#pragma once

#include <cstdint>
#include <optional>

#include "accessvdb/scan_io.h"
#include "accessvdb/tool_geometry.h"
#include "map_options.h"
#include "memory_prediction.h"

namespace accessvdb::tools {

/// Reads all scans, or without --max-memory at most a few million returns, and then predicts a lower bound.
/// @return predicted peak in bytes; nothing if a signal stopped it
/// @throws ResourceLimit "limit.memory" with the smallest voxel that fits, "tool.span", "tool.columns"; InputError
///         while reading
[[nodiscard]] std::optional<std::uint64_t> checkMemory(const MapOptions& options, const ToolGeometry& tool,
                                                       RunOutput output, io::ScanSequence& scans, Messages& messages);

}  // namespace accessvdb::tools

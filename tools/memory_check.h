// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The pass over the scans that predicts a run's memory before its work, and refuses what will not fit.
#pragma once

#include <cstdint>
#include <optional>

#include "accessvdb/scan_io.h"
#include "map_options.h"

namespace accessvdb::tools {

/// Reads all scans, or without --max-memory at most a few million returns, and then predicts a lower bound.
/// @return predicted peak in bytes; nothing where a signal stopped it
/// @throws ResourceLimit "limit.memory" with the smallest voxel that fits; InputError from reading
[[nodiscard]] std::optional<std::uint64_t> checkMemory(const MapOptions& options, io::ScanSequence& scans,
                                                       Messages& messages);

}  // namespace accessvdb::tools

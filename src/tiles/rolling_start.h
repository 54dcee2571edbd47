// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a rolling field refuses, and works out, before it begins.
#pragma once

#include <cstdint>
#include <filesystem>

#include "accessvdb/params.h"
#include "accessvdb/rolling_field.h"
#include "accessvdb/tiles.h"
#include "tiles/folder_in_use.h"

namespace accessvdb::tiles {

/// @param params  resolved  @throws InvalidArgument "rolling.params", "rolling.tile"
void requireRolling(const FieldParams& params, const RollingOptions& options, const TileMargins& margins);
/// What the process has left for tiles: the rest is itself without any, and a step of scans. 0 = no limit
/// @throws ResourceLimit "limit.memory" if that is nothing
[[nodiscard]] std::uint64_t tileLimit(const RollingOptions& options);
/// @param free_bytes  of the GPU, once the tables are there; 0 without one  @param table_bytes  there
/// @return with the tables; 0 = no limit
[[nodiscard]] std::uint64_t deviceLimit(const RollingOptions& options, std::uint64_t free_bytes,
                                        std::uint64_t table_bytes);
/// Keeps everybody else out of the folder from now on: what is read of it before may be out of date.
/// @throws OutputError
[[nodiscard]] FolderInUse takeFolder(const std::filesystem::path& folder);
/// The same for one that is empty, or not there. @throws OutputError
[[nodiscard]] FolderInUse takeNewFolder(const std::filesystem::path& folder);

}  // namespace accessvdb::tiles

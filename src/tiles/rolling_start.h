// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a rolling field refuses, and works out, before it begins.
#pragma once

#include <cstdint>
#include <filesystem>

#include "accessvdb/params.h"
#include "accessvdb/rolling_field.h"
#include "accessvdb/tiles.h"

namespace accessvdb::tiles {

/// @param params  resolved  @throws InvalidArgument "rolling.params", "rolling.tile"
void requireRolling(const FieldParams& params, const RollingOptions& options, const TileMargins& margins);
/// What the process has left for tiles: the rest is itself without any, and a step of scans. 0 = no limit
/// @throws ResourceLimit "limit.memory" if that is nothing
[[nodiscard]] std::uint64_t tileLimit(const RollingOptions& options);
/// @throws OutputError
void prepareRollingFolder(const std::filesystem::path& folder);

}  // namespace accessvdb::tiles

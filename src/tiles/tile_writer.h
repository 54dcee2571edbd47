// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The files of a tile whose labels are up to date.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>

#include "accessvdb/tiles.h"

namespace accessvdb {
class AccessibilityField;
}  // namespace accessvdb

namespace accessvdb::tiles {

/// The step that brought the first return of a point, by its id in the tile.
using StepOfPoint = std::function<std::uint32_t(std::uint32_t id)>;

/// @param folder  of an attempt  @param tile  gets what its manifest says of the files, but not who made them and when
/// @throws OutputError
void writeTileFiles(const AccessibilityField& field, const std::filesystem::path& folder,
                    const io::WriteOptions& options, const StepOfPoint& stepOf, Tile& tile);

}  // namespace accessvdb::tiles

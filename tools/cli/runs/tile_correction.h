// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Corrected poses for a map in tiles: what is to be made again (docs/large_maps.md).
#pragma once

#include <filesystem>

#include "options/flag_parser.h"
#include "options/map_options.h"
#include "output/error_output.h"

namespace accessvdb::tools {

/// Whether the flags of tile plan give poses and nothing that would make a plan of its own.
[[nodiscard]] bool givesPosesAlone(const MapOptions& options);

/// Takes the poses that `options` names for a flight of the plan in the folder. A scan of which nothing moved by more
/// than half a voxel keeps the pose that it has.
/// @return the exit code: a signal may have stopped it, before anything was written
/// @throws InvalidArgument "usage.poses"; InputError "plan.missing"; UnusableInput "plan.changed", "poses.other_scans",
///         "poses.far", "poses.disagree"; what reading the scans throws
int correctPoses(const std::filesystem::path& out, const MapOptions& options, const FlagParser& flags,
                 Messages& messages);

}  // namespace accessvdb::tools

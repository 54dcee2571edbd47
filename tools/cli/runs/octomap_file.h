// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The map as an OctoMap, for MoveIt and Nav2. A program without OctoMap has no_octomap.cpp.
#pragma once

#include <filesystem>
#include <string>

#include "accessvdb/accessibility_field.h"
#include "runs/prepared_file.h"

namespace accessvdb::tools {

/// @throws InvalidArgument "usage.no_octomap" in a program without it
void requireOctomap(const std::string& flag);

/// Cells as large as voxels, at multiples of their size, which is half a voxel beside the voxels: a cell is occupied if
/// any voxel that it overlaps collides, free if all of them were seen to be free, else unknown.
/// @throws ResourceLimit "octomap.range" beyond OctoMap's 2^15 cells from the origin of the world frame
[[nodiscard]] PreparedFile octomapFile(const std::filesystem::path& file, const AccessibilityField& field);

}  // namespace accessvdb::tools

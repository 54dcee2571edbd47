// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Sets of voxels as runs.
#pragma once

#include <vector>

#include "tool/voxelize.h"

namespace accessvdb::internal {

/// Sorts them, and joins those that touch or overlap.
void joinRuns(std::vector<VoxelRun>& runs);
/// Voxels that no path through faces of voxels leads to from far away, without the walls themselves.
/// @param walls  as those of voxelize(), as is the result
[[nodiscard]] std::vector<VoxelRun> enclosedBy(const std::vector<VoxelRun>& walls);

/// Voxels that are in both. @param a, b  disjoint, sorted by (i, j, lo), as is the result
[[nodiscard]] std::vector<VoxelRun> sharedVoxels(const std::vector<VoxelRun>& a, const std::vector<VoxelRun>& b);
/// Voxels of a that are not in b.
[[nodiscard]] std::vector<VoxelRun> voxelsWithout(const std::vector<VoxelRun>& a, const std::vector<VoxelRun>& b);

}  // namespace accessvdb::internal

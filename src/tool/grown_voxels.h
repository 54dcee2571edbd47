// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A tool with room around it, in voxels.
#pragma once

#include <vector>

#include "tool/voxelize.h"

namespace accessvdb::internal {

/// The largest margin whose voxels are made, in voxels: time grows with its square.
inline constexpr double kMostMargin_voxels = 128;

/// Room that a tool has at its tip, per distance from the ball of self-exclusion: what one that is held 20 degrees
/// above a flat surface, as aslant as ApproachParams::normal_cone_rad allows, has from what it touches.
inline constexpr double kRoomPerDistance = 1.0 / 3;

/// The voxels of a tool, and those whose centre is within the margin of one of them. At its tip the tool touches the
/// surface, and has no room: there a voxel is grown by less, see kRoomPerDistance. So what a slender tip touches does
/// not take the margin away, and the voxels of a smaller margin are among those of a larger one.
/// @param runs  without those in the ball, as voxelize(), as is the result  @param margin  [voxels] 0 or more
/// @param self_exclusion_voxels  negative: there is no ball
[[nodiscard]] std::vector<VoxelRun> grownVoxels(const std::vector<VoxelRun>& runs, double margin,
                                                double self_exclusion_voxels);

}  // namespace accessvdb::internal

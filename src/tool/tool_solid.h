// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The voxels of a tool, whether its surface is closed or not.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "accessvdb/tool_geometry.h"
#include "tool/mesh_openings.h"
#include "tool/voxelize.h"

namespace accessvdb::internal {

/// Those of one orientation.
struct SolidVoxels {
  std::vector<VoxelRun> runs;  ///< without those near the tip, with those in the tool's margin
  /// Of the tool alone: with those near the tip; those near it; those that count for the limit, which a larger tool
  /// must not raise.
  std::uint64_t all = 0, hidden = 0, counted = 0;
};

class ToolSolid {
 public:
  /// Keeps a reference.
  explicit ToolSolid(const ToolGeometry& tool);

  /// Those of the tool, and around them those of its margin, see grownVoxels(). Of a closed tool as voxelize(). Of an
  /// open one at least those that it would have if it were closed: what the surface touches, what may be missing near
  /// its rims, and all that the two enclose; openings of more than a quarter of its size stay open. Nine tenths of what
  /// its surface touches count: closing must not let it touch more.
  /// @param vertices  in voxels, one for each of the tool
  /// @param self_exclusion_voxels  0 or more: voxels within it of the tip are left out; negative: none
  [[nodiscard]] SolidVoxels voxels(const std::vector<Eigen::Vector3d>& vertices, double voxel_size_m,
                                   double self_exclusion_voxels) const;

 private:
  [[nodiscard]] SolidVoxels ownVoxels(const std::vector<Eigen::Vector3d>& vertices, double voxel_size_m,
                                      double self_exclusion_voxels) const;

  const ToolGeometry& tool_;
  MeshOpenings openings_;
};

}  // namespace accessvdb::internal

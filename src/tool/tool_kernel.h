// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The tool at every approach direction, as the scoring rules need it (paper, "Tool kernel").
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "accessvdb/params.h"
#include "accessvdb/table_progress.h"
#include "accessvdb/tool_geometry.h"
#include "hostdev/views.h"
#include "tool/expanded_orientations.h"
#include "tool/tool_rolls.h"

namespace accessvdb::internal {

/// Host-side tables behind a ToolKernelView.
struct ToolKernel {
  std::vector<kernels::VoxelColumn> columns;
  std::vector<std::uint32_t> column_begin;  ///< [D P + 1], P parts per direction
  std::vector<float> samples;               ///< [3 sum]
  std::vector<std::uint32_t> sample_begin;  ///< [D P + 1]
  std::vector<std::uint32_t>
      voxel_count;  ///< [D] voxels left after self-exclusion, at roll 0, that count for the limit
  /// Box of all voxels (or sample voxels) of all directions, relative to the point's voxel.
  std::array<int, 3> min_ijk = {}, max_ijk = {};
  double hidden_share = 0;  ///< of the tool's voxels, removed by self-exclusion; the largest of all directions
  int num_directions = 0;   ///< [D] as many orientations as there are tables of
  std::uint16_t collision_limit = 1;  ///< [n_c] see make()
  bool use_samples = false;
  ToolRolls rolls;  ///< in each direction

  [[nodiscard]] int parts() const { return rolls.count == 1 ? 1 : rolls.count + 1; }  ///< [P]
  [[nodiscard]] kernels::ToolKernelView view() const;

  /// Voxel form: voxel (i,j,k) belongs to the tool at direction d if its cell touches the surface of the rotated mesh
  /// or its centre is inside a closed mesh, see ToolSolid; cells whose centre is within self_exclusion_voxels of the
  /// origin are removed. collision_limit = max_collisions + 1 (1 for -1), by rule max(1, floor(0.005 x fewest voxels of
  /// any yaw d)) + 1. It is that of the yaw directions without roll for every set of orientations: else more
  /// orientations could lower it, and take access away. With rolls, the parts of a direction are the voxels that all
  /// rolls share, and what each has besides. Sample form: surface_samples points uniform on the surface from a fixed
  /// seed, rotated; those within self_exclusion_voxels * v are removed; collision_limit = max_collisions + 1, by
  /// rule 5. Makes both forms where useful (the voxel form always, for sizes and footprints). Parallel over
  /// orientations.
  /// @throws ResourceLimit when the tool spans more than 30 000 voxels or needs more than 2^28 columns (4 GiB)
  static ToolKernel make(const ToolGeometry& tool, const FieldParams& resolved,
                         const ExpandedOrientations& orientations, const TableProgress& progress = {});
  static ToolKernel make(const ToolGeometry& tool, const FieldParams& resolved, const TableProgress& progress = {}) {
    return make(tool, resolved, ExpandedOrientations::of(resolved.approach), progress);
  }
  /// The same for some of the orientations, in place of all: to estimate the memory for all. The collision limit is not
  /// that of all.
  /// @throws ResourceLimit as make(), as far as these directions show
  static ToolKernel sampled(const ToolGeometry& tool, const FieldParams& resolved, const ExpandedOrientations& all,
                            int most);
};

/// A tool's vertices, turned as for its tables, to the last bit. @param scale  [1/m] of the result
[[nodiscard]] std::vector<Eigen::Vector3d> turnedVertices(const ToolGeometry& tool, const Eigen::Matrix3d& R_WT,
                                                          double scale);

/// ToolKernel::hidden_share, without the tables.
[[nodiscard]] double largestHiddenShare(const ToolGeometry& tool, const FieldParams& resolved);

}  // namespace accessvdb::internal

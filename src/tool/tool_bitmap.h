// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The tool for any pose: hostdev/tool_fit.h says what its bits mean.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "accessvdb/tool_geometry.h"
#include "hostdev/tool_fit.h"

namespace accessvdb::internal {

struct ToolBitmap {
  /// The tool's own voxels, those of ToolSolid at an edge of v / n, are grown by every distance that a voxel's corner
  /// can have from its centre, and a node's.
  /// @throws ResourceLimit "tool.span"  for a tool that is too large for its voxels
  ToolBitmap(const ToolGeometry& tool, double voxel_size_m);

  [[nodiscard]] kernels::ToolBitmapView view() const;
  [[nodiscard]] std::uint64_t bytes() const { return words.size() * sizeof words[0]; }

  std::vector<std::uint64_t> words;
  std::array<std::int32_t, 3> low = {}, size = {};  ///< nodes
  std::int32_t words_z = 0;
  int nodes_per_voxel = 4;
};

}  // namespace accessvdb::internal

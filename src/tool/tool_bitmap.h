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

  /// @param of_words  `words`, or a copy in any memory
  [[nodiscard]] kernels::ToolBitmapView view(const std::uint64_t* of_words) const;
  [[nodiscard]] std::uint64_t bytes() const { return words.size() * sizeof words[0]; }

  /// Bits and where they are, without their memory.
  struct Level {
    std::array<double, 3> low = {};         ///< the first node's lower corner, in nodes from the tip
    std::array<std::int32_t, 3> size = {};  ///< nodes
    std::int32_t words_z = 0;
    double nodes_per_voxel = 1;
    std::size_t first_word = 0;
  };

  std::vector<std::uint64_t> words;
  Level voxels, blocks;
};

}  // namespace accessvdb::internal

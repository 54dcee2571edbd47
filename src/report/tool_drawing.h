// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The tool as the page draws it: a mesh, and the cells that it fills.
#pragma once

#include <nlohmann/json.hpp>

#include "accessvdb/tool_geometry.h"

namespace accessvdb::internal {

/// Frame of the cells.
struct ToolCells {
  double voxel_size_m = 0;
  double self_exclusion_voxels = 0;  ///< cells this near to the tip are left out, as scoring leaves them out
};

/// Mesh and cells in the tool frame, metres: {"mesh": {"vertices", "triangles", "data", "simplified"}, "cells":
/// {"edge_m", "min", "size", "data"}}. `data` is compressed and base64: float32 vertices, then uint32 triangles; one
/// bit per cell, x fastest, lowest bit first. A mesh with very many triangles is drawn simpler.
[[nodiscard]] nlohmann::ordered_json drawTool(const ToolGeometry& tool, const ToolCells& cells);

}  // namespace accessvdb::internal

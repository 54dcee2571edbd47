// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Pictures without a display: points as shaded splats, coloured by label or by reason, or a tool.
#pragma once

#include <Eigen/Core>
#include <filesystem>

#include "accessvdb/export.h"
#include "accessvdb/types.h"

namespace accessvdb {
class SurfacePoints;
class ToolGeometry;
}  // namespace accessvdb

namespace accessvdb::io {

/// What the colour of a point says.
enum class RenderColour {
  Label,  ///< green accessible, red blocked, grey not scored
  Reason  ///< accessible, or why not (PointReason); the colours can be told apart by colour-blind people
};

struct RenderOptions {
  int width_px = 1600;
  int height_px = 1000;
  /// Direction towards the viewer, world frame; orthographic. (0,0,1) = top view; default = iso.
  Eigen::Vector3d view_W = {-1.0, -1.0, 0.8};
  RenderColour colour = RenderColour::Label;  ///< of a field's points
};

/// @throws OutputError; InvalidArgument for a zero or non-finite view direction
ACCESSVDB_API void renderField(const std::filesystem::path& png, const FieldSnapshot& field,
                               const RenderOptions& options = {});
ACCESSVDB_API void renderField(const std::filesystem::path& png, const SurfacePoints& points,
                               const RenderOptions& options = {});
/// The tool in its frame, four times at one scale: from the side, from above, from the front, and towards view_W. Axes
/// drawn, tip marked, size labelled.
ACCESSVDB_API void renderTool(const std::filesystem::path& png, const ToolGeometry& tool,
                              const RenderOptions& options = {});

}  // namespace accessvdb::io

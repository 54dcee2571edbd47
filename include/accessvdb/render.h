// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Pictures without a display: points as shaded splats, coloured by label or by reason, or a tool.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>

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

/// A field whose points are read part by part, so that only one part is in memory at a time.
struct FieldParts {
  Eigen::Vector3d origin_W = {0, 0, 0};  ///< world position of the map's local origin
  double voxel_size_m = 0;
  // Of all points, also of those that read() leaves out:
  std::array<std::uint64_t, kNumPointLabels> labels = {};
  std::array<std::uint64_t, kNumPointReasons> reasons = {};
  std::size_t count = 0;  ///< of parts
  std::function<FieldSnapshot(std::size_t part)> read;
};

/// @throws OutputError; InvalidArgument for a zero or non-finite view direction
ACCESSVDB_API void renderField(const std::filesystem::path& png, const FieldSnapshot& field,
                               const RenderOptions& options = {});
ACCESSVDB_API void renderField(const std::filesystem::path& png, const SurfacePoints& points,
                               const RenderOptions& options = {});
/// Draws the parts one after the other; reads each twice.
ACCESSVDB_API void renderField(const std::filesystem::path& png, const FieldParts& parts,
                               const RenderOptions& options = {});
/// The tool in its frame, four times at one scale: from the side, from above, from the front, and towards view_W. Axes
/// drawn, tip marked, size labelled.
ACCESSVDB_API void renderTool(const std::filesystem::path& png, const ToolGeometry& tool,
                              const RenderOptions& options = {});

}  // namespace accessvdb::io

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What can be cut, from files: boxes by name, or a point cloud in which each point has a segment.
/// Made for the program `accessvdb`: unlike the headers above this folder, it may change with every version.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "accessvdb/export.h"

namespace accessvdb::io {

struct NamedBox {
  std::string name;
  Eigen::Vector3d min_W, max_W;
};
/// Text: a line "name xmin ymin zmin xmax ymax zmax" per box, metres; each is a segment; blanks,
/// commas, # comments. @throws InputError "input.missing", "input.malformed" naming the line
[[nodiscard]] ACCESSVDB_API std::vector<NamedBox> readBoxes(const std::filesystem::path& path);

struct LabelledCloud {
  std::vector<Eigen::Vector3d> positions_W;
  std::vector<std::int64_t> segments;  ///< of each; 0 and below: of none
};
/// PLY, text or binary, with the property `segment`, `segment_id`, `instance` or `tree_id`, the first that there is.
/// @throws InputError "input.missing", "input.malformed", "input.truncated", "input.no_segments",
///         "input.unsupported" (vertices with lists)
[[nodiscard]] ACCESSVDB_API LabelledCloud readLabelledCloud(const std::filesystem::path& path);

}  // namespace accessvdb::io

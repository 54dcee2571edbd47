// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The points of a field and the ways in to them as MCAP, for Foxglove and Rerun.
/// Made for the program `accessvdb`: unlike the headers above this folder, it may change with every version.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "accessvdb/export.h"

namespace accessvdb::io {

struct McapOptions {
  std::uint64_t most_points = 2'000'000;  ///< one of so many where there are more
  std::uint64_t most_arrows = 2'000;      ///< the same, of those that are accessible
};

struct PointsMcap {
  std::uint64_t points = 0, shown = 0, accessible = 0, arrows = 0;
  std::string content;  ///< of the file
};

/// Channels /accessvdb/points (foxglove.PointCloud), /accessvdb/approaches (foxglove.SceneUpdate) and /accessvdb/frame
/// (foxglove.FrameTransform, from `world` to `map`, the field's local origin).
/// @param points  files of points.ply, of one field  @throws InputError
[[nodiscard]] ACCESSVDB_API PointsMcap pointsMcap(const std::vector<std::filesystem::path>& points,
                                                  const McapOptions& options);

}  // namespace accessvdb::io

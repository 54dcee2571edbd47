// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One picture per scene: the truth, the method's result, visibility alone, and the method's errors.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

namespace accessvdb::eval {

struct ScenePicture {
  std::string title;
  double voxel_size_m = 0;
  std::span<const Eigen::Vector3d> positions_W;  ///< [n] metres
  std::span<const Eigen::Vector3f> normals_W;    ///< [n] unit, or empty: then shading uses only depth
  std::span<const std::uint8_t> truth;           ///< [n] non-zero = accessible
  std::span<const std::uint8_t> found;           ///< [n] same, by the method
  std::span<const std::uint8_t> visible;         ///< [n] same, by HPR; or empty: then its panel is omitted
  /// Where the sensor was: the picture is taken from that side or, if the positions are all around, from above the
  /// corner that `render` uses. May be empty.
  std::span<const Eigen::Vector3d> viewpoints_W;
};

/// Draws the panels and writes a PNG. In the error panel, false points are drawn over everything in front of them, so
/// that none is hidden: magenta where the label promises access that does not exist, blue where it denies access that
/// does.
/// @throws InvalidArgument if lengths differ, there is no point, or the voxel size is not positive; OutputError
void drawScenePicture(const std::filesystem::path& png, const ScenePicture& picture);

}  // namespace accessvdb::eval

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One picture a scene: the truth, what the method found, what visibility alone would say, and where the method errs.
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
  std::span<const Eigen::Vector3f> normals_W;    ///< [n] unit, or empty: shading then comes from depth alone
  std::span<const std::uint8_t> truth;           ///< [n] non-zero = accessible
  std::span<const std::uint8_t> found;           ///< [n] same, by the method
  std::span<const std::uint8_t> visible;         ///< [n] same, by HPR; or empty: then its panel is left out
  /// Where the sensor was: the picture is taken from their side, or, where they lie all around, from above the corner
  /// that `render` takes. May be empty.
  std::span<const Eigen::Vector3d> viewpoints_W;
};

/// Draws the panels and writes a PNG. In the panel of errors, false ones are drawn over everything that lies before
/// them, so that none is hidden: magenta where the label promises an access that does not exist, blue where it denies
/// one that does.
/// @throws InvalidArgument where lengths differ, there is no point, or the voxel size is not positive; OutputError
void drawScenePicture(const std::filesystem::path& png, const ScenePicture& picture);

}  // namespace accessvdb::eval

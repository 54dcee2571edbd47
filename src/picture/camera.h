// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Orthographic camera and the framing of a scene.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "accessvdb/render.h"

namespace accessvdb::internal {

/// View frame _V: x right, y up, z towards the viewer; pixels: x right, y down.
struct Camera {
  Eigen::Matrix3d R_V_W = Eigen::Matrix3d::Identity();
  Eigen::Vector2d centre_V = {0, 0};
  double px_per_m = 1;
  int width_px = 0, height_px = 0;

  [[nodiscard]] Eigen::Vector3d toView(const Eigen::Vector3d& p_W) const { return R_V_W * p_W; }
  /// x, y in pixels; z stays in metres towards the viewer.
  [[nodiscard]] Eigen::Vector3d toPixels(const Eigen::Vector3d& p_V) const {
    return {width_px / 2.0 + (p_V.x() - centre_V.x()) * px_per_m, height_px / 2.0 - (p_V.y() - centre_V.y()) * px_per_m,
            p_V.z()};
  }
};

/// @param scale  pixels of the camera per pixel of the picture (supersampling)
/// @throws InvalidArgument for a zero or non-finite view direction or a size outside 16 .. 8192 pixels
[[nodiscard]] Camera cameraTowards(const io::RenderOptions& options, int scale);

/// Centres the scene. A few points far away from all others do not shrink it: the box is that of the
/// 1st to 99th percentile, unless all points fit into a slightly larger one.
/// @param points_V  view frame  @param margin  share of the picture left free on each side
void frameScene(Camera& camera, const std::vector<Eigen::Vector3f>& points_V, double margin);

}  // namespace accessvdb::internal

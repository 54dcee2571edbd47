// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Z-buffered canvas: round splats, triangles and lines, then shading by depth and reduction to the final picture.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "picture/camera.h"
#include "picture/png_writer.h"

namespace accessvdb::internal {

class Canvas {
 public:
  Canvas(int width_px, int height_px);

  /// Disc of a surface element. @param centre_px x, y in pixels and z in metres; normal_V zero = facing the viewer
  void drawSplat(const Eigen::Vector3d& centre_px, const Eigen::Vector3f& normal_V, double radius_px, double px_per_m,
                 const Eigen::Vector3f& colour);
  void drawTriangle(const std::array<Eigen::Vector3d, 3>& corners_px, const Eigen::Vector3f& colour);
  /// Depth-tested line of a width in pixels, moved towards the viewer by `lift_m`.
  void drawLine(const Eigen::Vector3d& from_px, const Eigen::Vector3d& to_px, double width_px, double lift_m,
                const Eigen::Vector3f& colour);

  /// Darkens what is behind its surroundings (eye-dome lighting): shows shape without normals.
  /// @param range_m  depth step that counts as one full step
  void shadeByDepth(double range_m, int distance_px, float strength);

  /// Averages blocks of scale x scale pixels.
  [[nodiscard]] RgbImage reduced(int scale, const Eigen::Vector3f& background) const;

 private:
  void plot(int x, int y, float depth, const Eigen::Vector3f& colour);
  [[nodiscard]] std::size_t at(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_px_) + static_cast<std::size_t>(x);
  }

  int width_px_, height_px_;
  std::vector<float> depth_;             ///< metres towards the viewer, -inf = nothing
  std::vector<Eigen::Vector3f> colour_;  ///< 0 .. 1, sRGB
};

}  // namespace accessvdb::internal

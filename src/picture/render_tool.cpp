// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Picture of a tool in its frame: is the tip where it should be, does the body run along +x, is the size right.
#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "accessvdb/render.h"
#include "accessvdb/tool_geometry.h"
#include "picture/camera.h"
#include "picture/canvas.h"
#include "picture/picture_style.h"
#include "picture/picture_text.h"

namespace accessvdb::io {
namespace {

using internal::Camera;
using internal::Canvas;
using internal::kBackground;
using internal::kInk;
using internal::kLight_V;
using internal::kSupersampling;
using internal::Rgb;
using internal::RgbImage;

constexpr double kToolMargin = 0.12;
constexpr double kAxisShare = 0.4;  ///< length of the drawn axes, of the tool's largest extent
const Eigen::Vector3f kToolColour = {0.55f, 0.62f, 0.70f};

struct Axis {
  const char* name;
  Eigen::Vector3f colour;
};

Rgb toRgb(const Eigen::Vector3f& colour) {
  return {static_cast<std::uint8_t>(std::lround(colour.x() * 255)),
          static_cast<std::uint8_t>(std::lround(colour.y() * 255)),
          static_cast<std::uint8_t>(std::lround(colour.z() * 255))};
}

void drawMesh(Canvas& canvas, const Camera& camera, const ToolGeometry& tool,
              const std::vector<Eigen::Vector3f>& points_V) {
  for (const auto& triangle : tool.triangles()) {
    std::array<Eigen::Vector3d, 3> corners_px;
    std::array<Eigen::Vector3f, 3> corners_V;
    for (std::size_t k = 0; k < 3; ++k) {
      corners_V[k] = points_V[triangle[k]];
      corners_px[k] = camera.toPixels(corners_V[k].cast<double>());
    }
    Eigen::Vector3f normal_V = (corners_V[1] - corners_V[0]).cross(corners_V[2] - corners_V[0]).normalized();
    if (normal_V.z() < 0) normal_V = -normal_V;
    const float light = 0.42f + 0.65f * std::max(0.0f, normal_V.dot(kLight_V));
    canvas.drawTriangle(corners_px, kToolColour * light);
  }
}

}  // namespace

void renderTool(const std::filesystem::path& png, const ToolGeometry& tool, const RenderOptions& options) {
  Camera camera = internal::cameraTowards(options, kSupersampling);
  std::vector<Eigen::Vector3f> points_V;
  points_V.reserve(tool.vertices_T().size());
  for (const Eigen::Vector3f& p : tool.vertices_T()) points_V.push_back(camera.toView(p.cast<double>()).cast<float>());

  const Eigen::Vector3d size_m = (tool.max_T() - tool.min_T()).cast<double>();
  const double axis_m = kAxisShare * std::max(size_m.maxCoeff(), 1e-3);
  // A tool has no outliers: its corners, the tip and the ends of the axes must all be in the picture.
  std::vector<Eigen::Vector3f> framed;
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3f& x = corner & 1 ? tool.max_T() : tool.min_T();
    const Eigen::Vector3f& y = corner & 2 ? tool.max_T() : tool.min_T();
    const Eigen::Vector3f& z = corner & 4 ? tool.max_T() : tool.min_T();
    framed.push_back(camera.toView(Eigen::Vector3d(x.x(), y.y(), z.z())).cast<float>());
  }
  framed.push_back(Eigen::Vector3f::Zero());
  for (int axis = 0; axis < 3; ++axis) {
    framed.push_back(camera.toView(Eigen::Vector3d::Unit(axis) * axis_m).cast<float>());
  }
  internal::frameScene(camera, framed, kToolMargin);

  Canvas canvas(camera.width_px, camera.height_px);
  drawMesh(canvas, camera, tool, points_V);
  canvas.shadeByDepth(0.2 * size_m.maxCoeff(), kSupersampling, 0.8f);

  // Axes and tip lie in front of everything: they are what the picture is for.
  const double lift_m = 4 * (size_m.norm() + axis_m);
  const int scale = internal::textScale(options.height_px);
  const double line_px = 2.5 * scale * kSupersampling;
  const std::array<Axis, 3> axes = {
      {{"x", {0.84f, 0.16f, 0.16f}}, {"y", {0.13f, 0.60f, 0.20f}}, {"z", {0.15f, 0.35f, 0.85f}}}};
  const Eigen::Vector3d tip_px = camera.toPixels(Eigen::Vector3d::Zero());
  std::array<Eigen::Vector3d, 3> ends_px;
  for (int axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<std::size_t>(axis);
    ends_px[a] = camera.toPixels(camera.toView(Eigen::Vector3d::Unit(axis) * axis_m));
    canvas.drawLine(tip_px, ends_px[a], line_px, lift_m, axes[a].colour);
  }
  canvas.drawSplat(tip_px + Eigen::Vector3d(0, 0, 2 * lift_m), Eigen::Vector3f::Zero(), 2.2 * line_px, 1,
                   {0.10f, 0.10f, 0.12f});
  canvas.drawSplat(tip_px + Eigen::Vector3d(0, 0, 3 * lift_m), Eigen::Vector3f::Zero(), 1.4 * line_px, 1,
                   {1.0f, 0.80f, 0.10f});

  RgbImage image = canvas.reduced(kSupersampling, kBackground);
  for (std::size_t a = 0; a < axes.size(); ++a) {
    const Eigen::Vector2d along = (ends_px[a] - tip_px).head<2>().stableNormalized();
    const Eigen::Vector2d at_px = ends_px[a].head<2>() / kSupersampling + along * 8.0 * scale;
    internal::drawText(image, static_cast<int>(at_px.x()) - 2 * scale, static_cast<int>(at_px.y()) - 3 * scale,
                       axes[a].name, scale, toRgb(axes[a].colour));
  }
  const Eigen::Vector2d tip = tip_px.head<2>() / kSupersampling;
  internal::drawText(image, static_cast<int>(tip.x()) + 8 * scale, static_cast<int>(tip.y()) + 8 * scale, "tip", scale,
                     kInk);
  const int margin = 12 * scale;
  const std::string size_text = "size x " + internal::fixedText(size_m.x(), 3) + "  y " +
                                internal::fixedText(size_m.y(), 3) + "  z " + internal::fixedText(size_m.z(), 3) +
                                " m   reach " + internal::fixedText(tool.reach_m(), 3) + " m";
  internal::drawText(image, margin, margin, tool.name(), scale, kInk);
  internal::drawText(image, margin, margin + 12 * scale, size_text, scale, kInk);
  internal::writePng(png, image);
}

}  // namespace accessvdb::io

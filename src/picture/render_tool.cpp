// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Picture of a tool in its frame: is the tip where it should be, does the body run along +x, is the size right.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
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

/// One of the views of a tool, and what to call it.
struct View {
  const char* name;
  Eigen::Vector3d towards_T;  ///< direction to the viewer, tool frame
};

/// Length of the drawn axes.
double axisLength_m(const ToolGeometry& tool) {
  return kAxisShare * std::max<double>((tool.max_T() - tool.min_T()).maxCoeff(), 1e-3);
}

/// A camera that has the whole tool, its tip and the ends of the axes in the picture: a tool has no outliers.
Camera cameraFor(const ToolGeometry& tool, const RenderOptions& options) {
  Camera camera = internal::cameraTowards(options, kSupersampling);
  std::vector<Eigen::Vector3f> framed;
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3f& x = corner & 1 ? tool.max_T() : tool.min_T();
    const Eigen::Vector3f& y = corner & 2 ? tool.max_T() : tool.min_T();
    const Eigen::Vector3f& z = corner & 4 ? tool.max_T() : tool.min_T();
    framed.push_back(camera.toView(Eigen::Vector3d(x.x(), y.y(), z.z())).cast<float>());
  }
  framed.push_back(Eigen::Vector3f::Zero());
  for (int axis = 0; axis < 3; ++axis) {
    framed.push_back(camera.toView(Eigen::Vector3d::Unit(axis) * axisLength_m(tool)).cast<float>());
  }
  internal::frameScene(camera, framed, kToolMargin);
  return camera;
}

/// The tool with its axes and its tip.
RgbImage drawView(const ToolGeometry& tool, const Camera& camera, int scale) {
  std::vector<Eigen::Vector3f> points_V;
  points_V.reserve(tool.vertices_T().size());
  for (const Eigen::Vector3f& p : tool.vertices_T()) points_V.push_back(camera.toView(p.cast<double>()).cast<float>());
  const Eigen::Vector3d size_m = (tool.max_T() - tool.min_T()).cast<double>();
  const double axis_m = axisLength_m(tool);
  Canvas canvas(camera.width_px, camera.height_px);
  drawMesh(canvas, camera, tool, points_V);
  canvas.shadeByDepth(0.2 * size_m.maxCoeff(), kSupersampling, 0.8f);

  // Axes and tip are in front of everything: they are what the picture is for.
  const double lift_m = 4 * (size_m.norm() + axis_m);
  const double line_px = 2.5 * scale * kSupersampling;
  const std::array<Axis, 3> axes = {
      {{"x", {0.84f, 0.16f, 0.16f}}, {"y", {0.13f, 0.60f, 0.20f}}, {"z", {0.15f, 0.35f, 0.85f}}}};
  const Eigen::Vector3d tip_px = camera.toPixels(Eigen::Vector3d::Zero());
  std::array<Eigen::Vector3d, 3> ends_px;
  for (std::size_t a = 0; a < axes.size(); ++a) {
    ends_px[a] = camera.toPixels(camera.toView(Eigen::Vector3d::Unit(static_cast<int>(a)) * axis_m));
    canvas.drawLine(tip_px, ends_px[a], line_px, lift_m, axes[a].colour);
  }
  canvas.drawSplat(tip_px + Eigen::Vector3d(0, 0, 2 * lift_m), Eigen::Vector3f::Zero(), 2.2 * line_px, 1,
                   {0.10f, 0.10f, 0.12f});
  canvas.drawSplat(tip_px + Eigen::Vector3d(0, 0, 3 * lift_m), Eigen::Vector3f::Zero(), 1.4 * line_px, 1,
                   {1.0f, 0.80f, 0.10f});

  RgbImage image = canvas.reduced(kSupersampling, kBackground);
  for (std::size_t a = 0; a < axes.size(); ++a) {
    const Eigen::Vector2d drawn_px = (ends_px[a] - tip_px).head<2>();
    if (drawn_px.norm() < 4 * line_px) continue;  // it points at the viewer
    const Eigen::Vector2d at_px = ends_px[a].head<2>() / kSupersampling + drawn_px.normalized() * 8.0 * scale;
    internal::drawText(image, static_cast<int>(at_px.x()) - 2 * scale, static_cast<int>(at_px.y()) - 3 * scale,
                       axes[a].name, scale, toRgb(axes[a].colour));
  }
  const Eigen::Vector2d tip = tip_px.head<2>() / kSupersampling;
  internal::drawText(image, static_cast<int>(tip.x()) + 8 * scale, static_cast<int>(tip.y()) + 8 * scale, "tip", scale,
                     kInk);
  return image;
}

/// Copies a picture into a larger one. @param x, y  of its top left corner
void paste(RgbImage& image, const RgbImage& part, int x, int y) {
  for (int row = 0; row < part.height_px; ++row) {
    for (int column = 0; column < part.width_px; ++column) {
      const std::size_t from = 3 * (static_cast<std::size_t>(row) * static_cast<std::size_t>(part.width_px) +
                                    static_cast<std::size_t>(column));
      image.set(x + column, y + row, {part.rgb[from], part.rgb[from + 1], part.rgb[from + 2]});
    }
  }
}

}  // namespace

void renderTool(const std::filesystem::path& png, const ToolGeometry& tool, const RenderOptions& options) {
  (void)internal::cameraTowards(options, kSupersampling);  // says what is wrong with the options
  const int scale = internal::textScale(options.height_px), margin = 12 * scale, title = 36 * scale;
  const int width = options.width_px / 2, height = std::max((options.height_px - title) / 2, 16);
  const std::array<View, 4> views = {{{"from the side", -Eigen::Vector3d::UnitY()},
                                      {"from above", Eigen::Vector3d::UnitZ()},
                                      {"from the front, where it approaches", -Eigen::Vector3d::UnitX()},
                                      {"chosen view", options.view_W}}};
  std::array<Camera, 4> cameras;
  double px_per_m = std::numeric_limits<double>::infinity();
  for (std::size_t n = 0; n < views.size(); ++n) {
    cameras[n] = cameraFor(tool, {.width_px = width, .height_px = height, .view_W = views[n].towards_T});
    px_per_m = std::min(px_per_m, cameras[n].px_per_m);
  }
  RgbImage image(options.width_px, options.height_px, toRgb(kBackground));
  for (std::size_t n = 0; n < views.size(); ++n) {
    cameras[n].px_per_m = px_per_m;  // the same scale everywhere
    const int x = n % 2 == 0 ? 0 : width, y = title + (n < 2 ? 0 : height);
    paste(image, drawView(tool, cameras[n], scale), x, y);
    internal::drawText(image, x + margin, y, views[n].name, scale, kInk);
  }
  const Eigen::Vector3d size_m = (tool.max_T() - tool.min_T()).cast<double>();
  const std::string size_text = "size x " + internal::fixedText(size_m.x(), 3) + "  y " +
                                internal::fixedText(size_m.y(), 3) + "  z " + internal::fixedText(size_m.z(), 3) +
                                " m   reach " + internal::fixedText(tool.reach_m(), 3) + " m";
  internal::drawText(image, margin, margin / 2, tool.name(), scale, kInk);
  internal::drawText(image, margin, margin / 2 + 12 * scale, size_text, scale, kInk);
  internal::writePng(png, image);
}

}  // namespace accessvdb::io

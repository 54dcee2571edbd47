// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "eval/scene_picture.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/render.h"
#include "eval/confusion.h"
#include "picture/camera.h"
#include "picture/canvas.h"
#include "picture/picture_text.h"

namespace accessvdb::eval {
namespace {

using internal::Camera;
using internal::Canvas;
using internal::Rgb;
using internal::RgbImage;

constexpr int kPanelWidth_px = 800, kPanelHeight_px = 560, kGap_px = 12, kTitle_px = 44, kCaption_px = 56;
constexpr int kSupersampling = 2;
constexpr int kTextScale = 2;
constexpr double kMargin = 0.06;
/// As in picture/render.cpp: discs of neighbouring voxels overlap in any direction.
constexpr double kSplatRadiusVoxels = 0.85;
constexpr double kMinSplatRadius_px = 1.0;
constexpr double kMaxSplatShare = 0.1;  ///< of the panel's height: a single point must not fill the picture
/// Single wrong points among a hundred thousand must be visible.
constexpr double kMinErrorRadius_px = 2.5;
constexpr float kAmbient = 0.45f, kDiffuse = 0.62f;
const Eigen::Vector3f kLight_V = Eigen::Vector3f(-0.35f, 0.55f, 0.75f).normalized();
const Eigen::Vector3f kBackground = {0.975f, 0.975f, 0.97f};
constexpr Rgb kPaper = {249, 249, 247}, kInk = {40, 44, 52};
constexpr Rgb kFalseAccessible = {214, 0, 200}, kFalseBlocked = {0, 84, 230};
constexpr Rgb kRightAccessible = {205, 214, 205}, kRightBlocked = {176, 172, 172};
/// Sensors count as on one side if their mean is this far off the centre, as a share of their distance.
constexpr double kOneSided = 0.4;

struct Panel {
  std::string caption, details;
  std::vector<Rgb> colours;        ///< [n]
  std::vector<std::uint8_t> lift;  ///< [n] non-zero = drawn larger and over everything; or empty
};

Eigen::Vector3f toFloat(const Rgb& colour) { return Eigen::Vector3f(colour[0], colour[1], colour[2]) / 255.0f; }

void requireSame(std::size_t length, std::size_t points, const char* what) {
  if (length == points) return;
  throw InvalidArgument("picture.sizes", what,
                        "has " + std::to_string(length) + " entries for " + std::to_string(points) + " points");
}

void check(const ScenePicture& picture) {
  const std::size_t n = picture.positions_W.size();
  if (n == 0) throw InvalidArgument("picture.empty", "positions_W", "there is no point to draw");
  if (!(picture.voxel_size_m > 0)) throw InvalidArgument("picture.voxel", "voxel_size_m", "must be positive");
  requireSame(picture.truth.size(), n, "truth");
  requireSame(picture.found.size(), n, "found");
  if (!picture.visible.empty()) requireSame(picture.visible.size(), n, "visible");
  if (!picture.normals_W.empty()) requireSame(picture.normals_W.size(), n, "normals_W");
}

/// Direction towards the viewer.
Eigen::Vector3d viewOf(const ScenePicture& picture, const Eigen::Vector3d& centre_W) {
  const Eigen::Vector3d corner = io::RenderOptions{}.view_W;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  double distance_m = 0;
  for (const Eigen::Vector3d& q : picture.viewpoints_W) {
    mean += q - centre_W;
    distance_m += (q - centre_W).norm();
  }
  if (!(mean.norm() > kOneSided * distance_m)) return corner;
  // Slightly from above and from the left, for depth.
  mean.normalize();
  const Eigen::Vector3d left(mean.y(), -mean.x(), 0);
  return mean + 0.45 * left + Eigen::Vector3d(0, 0, 0.35);
}

std::string percentText(double percent) { return internal::fixedText(percent, 1) + " %"; }

std::vector<Rgb> labelColours(std::span<const std::uint8_t> accessible) {
  std::vector<Rgb> colours(accessible.size());
  std::transform(accessible.begin(), accessible.end(), colours.begin(), [](std::uint8_t yes) {
    return internal::colourOf(yes != 0 ? PointLabel::Accessible : PointLabel::Blocked);
  });
  return colours;
}

std::string shareText(std::span<const std::uint8_t> accessible, const char* word) {
  const auto count = static_cast<std::uint64_t>(
      std::count_if(accessible.begin(), accessible.end(), [](std::uint8_t yes) { return yes != 0; }));
  return internal::groupedText(count) + " of " + internal::groupedText(accessible.size()) + " points " + word + ", " +
         percentText(100 * static_cast<double>(count) / static_cast<double>(accessible.size()));
}

std::string scoreText(const Confusion& c) {
  return "P " + internal::fixedText(c.precision(), 1) + "  R " + internal::fixedText(c.recall(), 1) + "  F1 " +
         internal::fixedText(c.f1(), 1);
}

std::vector<Panel> panelsOf(const ScenePicture& picture) {
  std::vector<Panel> panels;
  panels.push_back({"ground truth", shareText(picture.truth, "accessible"), labelColours(picture.truth), {}});
  const Confusion ours = compare(picture.truth, picture.found);
  panels.push_back(
      {"found: " + scoreText(ours), shareText(picture.found, "accessible"), labelColours(picture.found), {}});
  if (!picture.visible.empty()) {
    panels.push_back({"HPR: " + scoreText(compare(picture.truth, picture.visible)),
                      shareText(picture.visible, "visible"),
                      labelColours(picture.visible),
                      {}});
  }
  Panel errors = {"errors of what was found, seen through the object", {}, {}, {}};
  for (std::size_t n = 0; n < picture.truth.size(); ++n) {
    const bool truth = picture.truth[n] != 0, found = picture.found[n] != 0;
    errors.colours.push_back(truth == found ? (truth ? kRightAccessible : kRightBlocked)
                             : found        ? kFalseAccessible
                                            : kFalseBlocked);
    errors.lift.push_back(truth != found ? 1 : 0);
  }
  errors.details = internal::groupedText(ours.false_accessible) + " false accessible  " +
                   internal::groupedText(ours.false_blocked) + " false blocked";
  panels.push_back(std::move(errors));
  return panels;
}

float lightOn(const Eigen::Vector3f& normal_V) {
  const Eigen::Vector3f facing = normal_V.z() < 0 ? Eigen::Vector3f(-normal_V) : normal_V;
  return kAmbient + kDiffuse * std::max(0.0f, facing.dot(kLight_V));
}

RgbImage drawPanel(const ScenePicture& picture, const Panel& panel, const Camera& camera,
                   const std::vector<Eigen::Vector3f>& points_V) {
  Canvas canvas(camera.width_px, camera.height_px);
  const double radius_px = std::clamp(kSplatRadiusVoxels * picture.voxel_size_m * camera.px_per_m,
                                      kMinSplatRadius_px * kSupersampling, kMaxSplatShare * camera.height_px);
  const Eigen::Matrix3f R_V_W = camera.R_V_W.cast<float>();
  const auto draw = [&](std::size_t n, double radius, double lift_m, bool shaded) {
    Eigen::Vector3d centre_px = camera.toPixels(points_V[n].cast<double>());
    centre_px.z() += lift_m;
    const Eigen::Vector3f normal_V = picture.normals_W.empty() || !shaded
                                         ? Eigen::Vector3f(Eigen::Vector3f::Zero())
                                         : Eigen::Vector3f(R_V_W * picture.normals_W[n]);
    const float light = normal_V.isZero() ? 1.0f : lightOn(normal_V);
    canvas.drawSplat(centre_px, normal_V, radius, camera.px_per_m, toFloat(panel.colours[n]) * light);
  };
  for (std::size_t n = 0; n < points_V.size(); ++n) {
    if (panel.lift.empty() || panel.lift[n] == 0) draw(n, radius_px, 0, true);
  }
  const double picture_height_m = camera.height_px / camera.px_per_m;
  canvas.shadeByDepth(std::max(6 * picture.voxel_size_m, 0.03 * picture_height_m), 2 * kSupersampling, 1.1f);
  // Drawn after the shading, which would darken everything around points floating in front of the object.
  if (!panel.lift.empty()) {
    Eigen::Vector3f low = points_V.front(), high = low;
    for (const auto& p : points_V) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
    const double depth_m = high.z() - low.z() + picture.voxel_size_m;
    for (std::size_t n = 0; n < points_V.size(); ++n) {
      if (panel.lift[n] != 0) draw(n, std::max(radius_px, kMinErrorRadius_px * kSupersampling), depth_m, false);
    }
  }
  return canvas.reduced(kSupersampling, kBackground);
}

void paste(RgbImage& image, const RgbImage& part, int left, int top) {
  for (int y = 0; y < part.height_px; ++y) {
    const std::uint8_t* from =
        part.rgb.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(part.width_px) * 3;
    std::uint8_t* to =
        image.rgb.data() + (static_cast<std::size_t>(top + y) * static_cast<std::size_t>(image.width_px) +
                            static_cast<std::size_t>(left)) *
                               3;
    std::copy_n(from, static_cast<std::size_t>(part.width_px) * 3, to);
  }
}

void drawLegend(RgbImage& image, int right, int top) {
  struct Entry {
    const char* words;
    Rgb colour;
  };
  const Entry entries[] = {{"accessible", internal::colourOf(PointLabel::Accessible)},
                           {"blocked", internal::colourOf(PointLabel::Blocked)},
                           {"false accessible", kFalseAccessible},
                           {"false blocked", kFalseBlocked}};
  const int chip = internal::textHeight(kTextScale);
  int width = 0;
  for (const Entry& entry : entries) width += chip + 8 + internal::textWidth(entry.words, kTextScale) + 24;
  int x = right - width + 24;
  for (const Entry& entry : entries) {
    image.fillRectangle(x, top, x + chip, top + chip, entry.colour, 1.0f);
    internal::drawText(image, x + chip + 8, top, entry.words, kTextScale, kInk);
    x += chip + 8 + internal::textWidth(entry.words, kTextScale) + 24;
  }
}

}  // namespace

void drawScenePicture(const std::filesystem::path& png, const ScenePicture& picture) {
  check(picture);
  Eigen::Vector3d centre_W = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : picture.positions_W) centre_W += p;
  centre_W /= static_cast<double>(picture.positions_W.size());
  io::RenderOptions options;
  options.width_px = kPanelWidth_px;
  options.height_px = kPanelHeight_px;
  options.view_W = viewOf(picture, centre_W);
  Camera camera = internal::cameraTowards(options, kSupersampling);
  std::vector<Eigen::Vector3f> points_V;
  points_V.reserve(picture.positions_W.size());
  for (const Eigen::Vector3d& p : picture.positions_W) points_V.push_back(camera.toView(p - centre_W).cast<float>());
  internal::frameScene(camera, points_V, kMargin);

  const std::vector<Panel> panels = panelsOf(picture);
  const int columns = 2, rows = (static_cast<int>(panels.size()) + 1) / 2;
  RgbImage image(columns * kPanelWidth_px + (columns + 1) * kGap_px,
                 kTitle_px + rows * (kPanelHeight_px + kCaption_px + kGap_px) + kGap_px, kPaper);
  internal::drawText(image, kGap_px, kGap_px, picture.title, kTextScale, kInk);
  drawLegend(image, image.width_px - kGap_px, kGap_px);
  for (std::size_t n = 0; n < panels.size(); ++n) {
    const int left = kGap_px + static_cast<int>(n % 2) * (kPanelWidth_px + kGap_px);
    const int top = kTitle_px + static_cast<int>(n / 2) * (kPanelHeight_px + kCaption_px + kGap_px);
    paste(image, drawPanel(picture, panels[n], camera, points_V), left, top);
    internal::drawText(image, left, top + kPanelHeight_px + 6, panels[n].caption, kTextScale, kInk);
    internal::drawText(image, left, top + kPanelHeight_px + 30, panels[n].details, kTextScale, kInk);
  }
  internal::writePng(png, image);
}

}  // namespace accessvdb::eval

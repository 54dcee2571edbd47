// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <string>

#include "accessvdb/access_map.h"
#include "picture/picture_style.h"
#include "picture/picture_text.h"
#include "picture/png_writer.h"

namespace accessvdb::io {
namespace {

using internal::Rgb;
using internal::RgbImage;

constexpr int kWidth_px = 1120, kHeight_px = 720;
constexpr double kRadius_px = 236;
constexpr Rgb kPaper = {249, 249, 247}, kDisc = {233, 233, 230}, kRim = {170, 172, 176};

struct Placement {
  double x, y;
};

/// Covers the pixels whose centre is between two radii of a place, smoothed over a pixel.
void drawRing(RgbImage& image, const Placement& at, double inner_px, double outer_px, const Rgb& colour) {
  const int reach = static_cast<int>(std::ceil(outer_px)) + 1;
  const int x0 = static_cast<int>(std::lround(at.x)), y0 = static_cast<int>(std::lround(at.y));
  for (int y = y0 - reach; y <= y0 + reach; ++y) {
    for (int x = x0 - reach; x <= x0 + reach; ++x) {
      const double radius = std::hypot(x - at.x, y - at.y);
      const double cover =
          std::clamp(outer_px - radius + 0.5, 0.0, 1.0) * std::clamp(radius - inner_px + 0.5, 0.0, 1.0);
      if (cover > 0) image.blend(x, y, colour, static_cast<float>(cover));
    }
  }
}
void drawDot(RgbImage& image, const Placement& at, double radius_px, const Rgb& colour) {
  drawRing(image, at, -1, radius_px, colour);
}

/// Lambert's azimuthal projection of half a sphere, whose area is true: a pole is in the middle, the equator the rim.
Placement projected(const Eigen::Vector3f& direction, const Placement& middle) {
  const double up = std::abs(static_cast<double>(direction.z()));
  const double scale = kRadius_px * std::sqrt(1 / (1 + std::min(up, 1.0)));
  return {middle.x + scale * static_cast<double>(direction.x()), middle.y - scale * static_cast<double>(direction.y())};
}

const char* meaning(PointReason reason) {
  switch (reason) {
    case PointReason::None:
      return "free";
    case PointReason::Confidence:
      return "confidence";
    case PointReason::Normal:
      return "normal: too slanted";
    case PointReason::Unseen:
      return "unseen: that side was not observed";
    case PointReason::Unknown:
      return "unknown: the way was never seen";
    case PointReason::Arm:
      return "arm: the way is obstructed";
    case PointReason::Changed:
      return "changed: what was here has gone";
    case PointReason::BesideSurface:
      return "beside_surface: another point is scored";
    case PointReason::Tool:
      break;
  }
  return "tool: it would collide";
}

void drawText(RgbImage& image, int x, int y, const std::string& text) {
  internal::drawText(image, x, y, text, 2, internal::kInk);
}

void drawLegend(RgbImage& image, const AccessMap& map) {
  const SurfacePoint& point = map.point;
  drawText(image, 24, 18,
           "point " + std::to_string(point.id) + ": " + name(point.label) + ", reason " + name(point.reason) +
               (point.score == kNoScore ? std::string() : ", score " + std::to_string(point.score)) + ", limit " +
               std::to_string(map.collision_limit));
  const auto counts = map.reasons();
  int column = 0, row = 0;
  for (const PointReason reason : {PointReason::None, PointReason::Tool, PointReason::Arm, PointReason::Unknown,
                                   PointReason::Unseen, PointReason::Normal}) {
    const int x = 24 + 560 * column, y = kHeight_px - 84 + 26 * row;
    drawDot(image, {x + 7.0, y + 7.0}, 7, internal::colourOf(reason));
    drawText(image, x + 24, y, std::to_string(counts[static_cast<std::size_t>(reason)]) + " " + meaning(reason));
    if (++row == 3) row = 0, ++column;
  }
}

}  // namespace

void renderAccessMap(const std::filesystem::path& png, const AccessMap& map) {
  RgbImage image(kWidth_px, kHeight_px, kPaper);
  const Placement upper = {kWidth_px / 4.0, 350}, lower = {3 * kWidth_px / 4.0, 350};
  for (const auto& [middle, title] : {std::pair{upper, "from above"}, std::pair{lower, "from below"}}) {
    drawDot(image, middle, kRadius_px + 10, kDisc);
    drawRing(image, middle, kRadius_px - 1, kRadius_px, kRim);
    drawText(image, static_cast<int>(middle.x) - internal::textWidth(title, 2) / 2, 62, title);
  }
  // As large as lets dots touch where directions cover the sphere evenly.
  const double spacing = 2 * kRadius_px / std::sqrt(std::max<double>(1, static_cast<double>(map.directions.size())));
  const double dot_px = std::clamp(0.5 * spacing, 4.0, 18.0);
  for (std::size_t d = 0; d < map.directions.size(); ++d) {
    const DirectionOutcome& outcome = map.directions[d];
    const float z = outcome.direction_W.z();
    for (const bool above : {true, false}) {
      if (above ? z < 0 : z > 0) continue;  // a level direction is on both rims
      const Placement at = projected(outcome.direction_W, above ? upper : lower);
      drawDot(image, at, dot_px, internal::colourOf(outcome.reason));
      if (d == map.point.direction) drawRing(image, at, dot_px + 1, dot_px + 4, internal::kInk);
    }
  }
  const Eigen::Vector3f& normal = map.point.normal_W;
  if (!normal.isZero()) {
    const Placement at = projected(normal, normal.z() >= 0 ? upper : lower);
    for (int n = -7; n <= 7; ++n) {  // a cross
      for (int thick = 0; thick < 2; ++thick) {
        image.set(static_cast<int>(at.x) + n, static_cast<int>(at.y) + thick, internal::kInk);
        image.set(static_cast<int>(at.x) + thick, static_cast<int>(at.y) + n, internal::kInk);
      }
    }
    drawText(image, kWidth_px - 24 - internal::textWidth("+ normal", 2), 18, "+ normal");
  }
  drawLegend(image, map);
  internal::writePng(png, image);
}

}  // namespace accessvdb::io

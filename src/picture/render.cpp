// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Picture of a field: oriented discs, light from above the viewer, depth shading, legend and scale bar.
#include "accessvdb/render.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/surface_points.h"
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

constexpr double kFieldMargin = 0.05;
/// Discs of neighbouring voxels must overlap whatever their direction: half the diagonal of a voxel's face and more.
constexpr double kSplatRadiusVoxels = 0.85;
constexpr double kMinSplatRadius_px = 1.0;
constexpr double kMaxSplatShare = 0.1;  ///< of the picture's height, so that one point does not fill it
constexpr float kAmbient = 0.45f, kDiffuse = 0.62f;
constexpr float kNoNormalLight = 0.85f;

Eigen::Vector3f toFloat(const Rgb& colour) { return Eigen::Vector3f(colour[0], colour[1], colour[2]) / 255.0f; }

float lightOn(const Eigen::Vector3f& normal_V) {
  if (normal_V.isZero()) return kNoNormalLight;
  // The side that faces the viewer is the one that is seen.
  const Eigen::Vector3f facing = normal_V.z() < 0 ? Eigen::Vector3f(-normal_V) : normal_V;
  return kAmbient + kDiffuse * std::max(0.0f, facing.dot(kLight_V));
}

/// 1, 2 or 5 times a power of ten: about a sixth of the picture's width.
double scaleBarLength_m(double px_per_m, int width_px) {
  const double target_m = width_px / 6.0 / px_per_m;
  const double decade = std::pow(10.0, std::floor(std::log10(target_m)));
  for (const double factor : {5.0, 2.0}) {
    if (factor * decade <= target_m) return factor * decade;
  }
  return decade;
}

std::string lengthText(double length_m) {
  if (length_m >= 1) return internal::fixedText(length_m, 0) + " m";
  if (length_m >= 0.01) return internal::fixedText(length_m * 100, 0) + " cm";
  return internal::fixedText(length_m * 1000, length_m < 0.001 ? 3 : 0) + " mm";
}

void drawScaleBar(RgbImage& image, double px_per_m) {
  const int scale = internal::textScale(image.height_px);
  const double length_m = scaleBarLength_m(px_per_m, image.width_px);
  const int length_px = std::max(1, static_cast<int>(std::lround(length_m * px_per_m)));
  const int margin = 12 * scale, tick = 4 * scale;
  const int x1 = image.width_px - margin, x0 = x1 - length_px, y = image.height_px - margin;
  image.fillRectangle(x0, y - scale, x1, y, kInk, 1.0f);
  image.fillRectangle(x0, y - tick, x0 + scale, y, kInk, 1.0f);
  image.fillRectangle(x1 - scale, y - tick, x1, y, kInk, 1.0f);
  const std::string text = lengthText(length_m);
  internal::drawText(image, (x0 + x1 - internal::textWidth(text, scale)) / 2,
                     y - tick - 3 * scale - internal::textHeight(scale), text, scale, kInk);
}

struct LegendRow {
  std::string words;
  Rgb colour;
  std::uint64_t count = 0;
};

/// How many points there are of each kind.
struct PointCounts {
  std::array<std::uint64_t, kNumPointLabels> labels = {};
  std::array<std::uint64_t, kNumPointReasons> reasons = {};
  [[nodiscard]] std::uint64_t all() const { return std::accumulate(labels.begin(), labels.end(), std::uint64_t{0}); }
};

PointCounts countsOf(const SurfacePoints& points) {
  PointCounts counts;
  for (std::size_t n = 0; n < points.size(); ++n) {
    const SurfacePoint point = points.at(n);
    ++counts.labels[static_cast<std::size_t>(point.label)];
    ++counts.reasons[static_cast<std::size_t>(point.reason)];
  }
  return counts;
}

std::vector<LegendRow> legendOf(const PointCounts& points, RenderColour colour) {
  const auto& [labels, reasons] = points;
  std::vector<LegendRow> rows;
  if (colour == RenderColour::Label) {
    for (const auto& [label, words] :
         {std::pair{PointLabel::Accessible, "accessible"}, std::pair{PointLabel::Blocked, "blocked"},
          std::pair{PointLabel::Unscored, "not scored"}}) {
      rows.push_back({words, internal::colourOf(label), labels[static_cast<std::size_t>(label)]});
    }
    return rows;
  }
  for (const auto& [reason, words] :
       {std::pair{PointReason::None, "accessible"}, std::pair{PointReason::Tool, "tool collides"},
        std::pair{PointReason::Arm, "arm obstructed"}, std::pair{PointReason::Unknown, "unknown way in"},
        std::pair{PointReason::Unseen, "unseen from there"}, std::pair{PointReason::Normal, "normal: no direction"},
        std::pair{PointReason::Confidence, "confidence too low"}}) {
    rows.push_back({words, internal::colourOf(reason), reasons[static_cast<std::size_t>(reason)]});
  }
  if (const std::uint64_t changed = reasons[static_cast<std::size_t>(PointReason::Changed)]; changed > 0) {
    rows.push_back({"has gone", internal::colourOf(PointReason::Changed), changed});
  }
  if (const std::uint64_t beside = reasons[static_cast<std::size_t>(PointReason::BesideSurface)]; beside > 0) {
    rows.push_back({"beside the surface", internal::colourOf(PointReason::BesideSurface), beside});
  }
  return rows;
}

void drawLegend(RgbImage& image, const PointCounts& points, RenderColour colour) {
  const std::vector<LegendRow> rows = legendOf(points, colour);
  const int scale = internal::textScale(image.height_px);
  const int line = 12 * scale, margin = 12 * scale, chip = internal::textHeight(scale);
  std::vector<std::string> counts, shares;
  int name_width = 0, count_width = 0, share_width = 0;
  for (const LegendRow& row : rows) {
    const double total = static_cast<double>(std::max<std::uint64_t>(1, points.all()));
    counts.push_back(internal::groupedText(row.count));
    shares.push_back(internal::fixedText(100.0 * static_cast<double>(row.count) / total, 1) + " %");
    name_width = std::max(name_width, internal::textWidth(row.words, scale));
    count_width = std::max(count_width, internal::textWidth(counts.back(), scale));
    share_width = std::max(share_width, internal::textWidth(shares.back(), scale));
  }
  const int names_x = margin + chip + 6 * scale;
  const int counts_x = names_x + name_width + 10 * scale + count_width;
  const int shares_x = counts_x + 10 * scale + share_width;
  const int top = image.height_px - margin - static_cast<int>(rows.size()) * line;
  const Rgb paper = {250, 250, 248};
  image.fillRectangle(margin - 5 * scale, top - 5 * scale, shares_x + 5 * scale, image.height_px - margin + scale,
                      paper, 0.8f);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const int y = top + static_cast<int>(i) * line;
    image.fillRectangle(margin, y, margin + chip, y + chip, rows[i].colour, 1.0f);
    internal::drawText(image, names_x, y, rows[i].words, scale, kInk);
    internal::drawText(image, counts_x - internal::textWidth(counts[i], scale), y, counts[i], scale, kInk);
    internal::drawText(image, shares_x - internal::textWidth(shares[i], scale), y, shares[i], scale, kInk);
  }
}

Rgb colourOf(const SurfacePoint& point, RenderColour colour) {
  return colour == RenderColour::Label ? internal::colourOf(point.label) : internal::colourOf(point.reason);
}

/// A picture of a field while it is drawn.
class FieldPicture {
 public:
  /// @param camera  that frames the field
  FieldPicture(const Camera& camera, double voxel_size_m, RenderColour colour)
      : camera_(camera),
        R_V_W_(camera.R_V_W.cast<float>()),
        voxel_size_m_(voxel_size_m),
        radius_px_(std::clamp(kSplatRadiusVoxels * voxel_size_m * camera.px_per_m, kMinSplatRadius_px * kSupersampling,
                              kMaxSplatShare * camera.height_px)),
        colour_(colour),
        canvas_(camera.width_px, camera.height_px) {}

  /// @param p_V  the point's position, see toView()
  void draw(const SurfacePoint& point, const Eigen::Vector3f& p_V) {
    const Eigen::Vector3f normal_V = R_V_W_ * point.normal_W;
    canvas_.drawSplat(camera_.toPixels(p_V.cast<double>()), normal_V, radius_px_, camera_.px_per_m,
                      toFloat(colourOf(point, colour_)) * lightOn(normal_V));
  }

  void write(const std::filesystem::path& png, const PointCounts& counts) {
    const double picture_height_m = camera_.height_px / camera_.px_per_m;
    canvas_.shadeByDepth(std::max(6 * voxel_size_m_, 0.03 * picture_height_m), 2 * kSupersampling, 1.1f);
    RgbImage image = canvas_.reduced(kSupersampling, kBackground);
    drawLegend(image, counts, colour_);
    if (counts.all() > 0) drawScaleBar(image, camera_.px_per_m / kSupersampling);
    internal::writePng(png, image);
  }

 private:
  const Camera& camera_;
  Eigen::Matrix3f R_V_W_;
  double voxel_size_m_, radius_px_;
  RenderColour colour_;
  Canvas canvas_;
};

/// A position in the view frame, around the map's origin, so that floats do for UTM coordinates too.
Eigen::Vector3f toView(const Camera& camera, const Eigen::Vector3d& p_W, const Eigen::Vector3d& origin_W) {
  return camera.toView(p_W - origin_W).cast<float>();
}

/// An evenly spread sample of positions, of bounded size: when full, every other one is dropped.
class PositionSample {
 public:
  void add(const Eigen::Vector3f& p_V) {
    if (count_++ % stride_ != 0) return;
    positions_V_.push_back(p_V);
    if (positions_V_.size() < kMost) return;
    for (std::size_t n = 0; 2 * n < positions_V_.size(); ++n) positions_V_[n] = positions_V_[2 * n];
    positions_V_.resize((positions_V_.size() + 1) / 2);
    stride_ *= 2;
  }
  [[nodiscard]] const std::vector<Eigen::Vector3f>& positions_V() const { return positions_V_; }

 private:
  static constexpr std::size_t kMost = 1u << 17;
  std::vector<Eigen::Vector3f> positions_V_;
  std::uint64_t count_ = 0, stride_ = 1;
};

}  // namespace

void renderField(const std::filesystem::path& png, const SurfacePoints& points, const RenderOptions& options) {
  Camera camera = internal::cameraTowards(options, kSupersampling);
  std::vector<Eigen::Vector3f> points_V;
  points_V.reserve(points.size());
  for (std::size_t n = 0; n < points.size(); ++n) {
    points_V.push_back(toView(camera, points.position_W(n), points.origin_W()));
  }
  internal::frameScene(camera, points_V, kFieldMargin);

  FieldPicture picture(camera, points.voxel_size_m(), options.colour);
  for (std::size_t n = 0; n < points.size(); ++n) picture.draw(points.at(n), points_V[n]);
  picture.write(png, countsOf(points));
}

void renderField(const std::filesystem::path& png, const FieldSnapshot& field, const RenderOptions& options) {
  renderField(png, SnapshotPoints(field), options);
}

void renderField(const std::filesystem::path& png, const FieldParts& parts, const RenderOptions& options) {
  Camera camera = internal::cameraTowards(options, kSupersampling);
  PositionSample sample;
  for (std::size_t part = 0; part < parts.count; ++part) {
    for (const SurfacePoint& point : parts.read(part).points) {
      sample.add(toView(camera, point.position_W, parts.origin_W));
    }
  }
  internal::frameScene(camera, sample.positions_V(), kFieldMargin);

  FieldPicture picture(camera, parts.voxel_size_m, options.colour);
  for (std::size_t part = 0; part < parts.count; ++part) {
    for (const SurfacePoint& point : parts.read(part).points) {
      picture.draw(point, toView(camera, point.position_W, parts.origin_W));
    }
  }
  picture.write(png, {parts.labels, parts.reasons});
}

}  // namespace accessvdb::io

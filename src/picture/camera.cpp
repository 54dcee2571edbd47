// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "picture/camera.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "accessvdb/error.h"

namespace accessvdb::internal {
namespace {

constexpr int kMinSize_px = 16, kMaxSize_px = 8192;
constexpr double kPercentile = 0.01;
constexpr double kOutlierRatio = 1.35;  ///< the whole box may be this much larger before points count as outliers
constexpr double kOutlierPadding = 0.08;
constexpr double kSmallestExtent_m = 1e-3;

struct Range {
  double begin = 0, end = 0;
  [[nodiscard]] double size() const { return end - begin; }
};

Range robustRange(std::vector<float>& values) {
  if (values.empty()) return {-0.5, 0.5};
  const auto skip = static_cast<std::ptrdiff_t>(kPercentile * static_cast<double>(values.size()));
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  const Range all = {*low, *high};
  std::nth_element(values.begin(), values.begin() + skip, values.end());
  const double begin = values[static_cast<std::size_t>(skip)];
  std::nth_element(values.begin(), values.end() - 1 - skip, values.end());
  const double end = *(values.end() - 1 - skip);
  const Range robust = {begin, end};
  if (all.size() <= kOutlierRatio * robust.size()) return all;
  const double padding = kOutlierPadding * robust.size();
  return {std::max(all.begin, begin - padding), std::min(all.end, end + padding)};
}

}  // namespace

Camera cameraTowards(const io::RenderOptions& options, int scale) {
  const double length = options.view_W.norm();
  if (!(length > 0) || !std::isfinite(length)) {
    throw InvalidArgument("render.view", "view_W", "the view direction is zero or not finite",
                          "Use top, iso or X,Y,Z towards the viewer");
  }
  for (const int size : {options.width_px, options.height_px}) {
    if (!(size >= kMinSize_px && size <= kMaxSize_px)) {
      throw InvalidArgument("render.size", "", "a picture of " + std::to_string(size) + " pixels cannot be made",
                            "Use 16 to 8192 pixels");
    }
  }
  Camera camera;
  camera.width_px = options.width_px * scale;
  camera.height_px = options.height_px * scale;
  const Eigen::Vector3d towards = options.view_W / length;
  // Seen from above or below, z gives no "up": y is up then, as on a map.
  const Eigen::Vector3d up_hint = std::abs(towards.z()) > 0.999 ? Eigen::Vector3d::UnitY() : Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d right = up_hint.cross(towards).normalized();
  camera.R_V_W.row(0) = right;
  camera.R_V_W.row(1) = towards.cross(right);
  camera.R_V_W.row(2) = towards;
  return camera;
}

void frameScene(Camera& camera, const std::vector<Eigen::Vector3f>& points_V, double margin) {
  std::vector<float> values(points_V.size());
  Range ranges[2];
  for (int axis = 0; axis < 2; ++axis) {
    std::transform(points_V.begin(), points_V.end(), values.begin(), [axis](const auto& p) { return p[axis]; });
    ranges[axis] = robustRange(values);
  }
  camera.centre_V = {(ranges[0].begin + ranges[0].end) / 2, (ranges[1].begin + ranges[1].end) / 2};
  const double free = 1 - 2 * margin;
  camera.px_per_m = std::min(camera.width_px * free / std::max(ranges[0].size(), kSmallestExtent_m),
                             camera.height_px * free / std::max(ranges[1].size(), kSmallestExtent_m));
}

}  // namespace accessvdb::internal

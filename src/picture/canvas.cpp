// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "picture/canvas.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace accessvdb::internal {
namespace {

constexpr float kEmpty = -std::numeric_limits<float>::infinity();
// A disc seen edge-on would vanish: it is drawn as if tilted no more than this.
constexpr double kMinFacing = 0.35;

}  // namespace

Canvas::Canvas(int width_px, int height_px)
    : width_px_(width_px),
      height_px_(height_px),
      depth_(static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px), kEmpty),
      colour_(depth_.size(), Eigen::Vector3f::Zero()) {}

void Canvas::plot(int x, int y, float depth, const Eigen::Vector3f& colour) {
  const std::size_t i = at(x, y);
  if (depth <= depth_[i]) return;
  depth_[i] = depth;
  colour_[i] = colour;
}

void Canvas::drawSplat(const Eigen::Vector3d& centre_px, const Eigen::Vector3f& normal_V, double radius_px,
                       double px_per_m, const Eigen::Vector3f& colour) {
  if (!(centre_px.x() + radius_px >= 0 && centre_px.x() - radius_px < width_px_ && centre_px.y() + radius_px >= 0 &&
        centre_px.y() - radius_px < height_px_)) {
    return;
  }
  // Slope of the disc's plane: depth gained per step to the right and down, both in pixels.
  Eigen::Vector2d slope = {0, 0};
  if (!normal_V.isZero()) {
    const Eigen::Vector3d n = normal_V.cast<double>() * (normal_V.z() < 0 ? -1.0 : 1.0);
    const double flat = std::hypot(n.x(), n.y());
    if (flat > 1e-9) {
      const double facing = std::max(n.z(), kMinFacing);
      const double tilt = std::sqrt(1 - facing * facing) / facing;
      slope = Eigen::Vector2d(-n.x(), n.y()) / flat * std::min(tilt, flat / std::max(n.z(), 1e-9));
    }
  }
  const int x0 = std::max(0, static_cast<int>(std::floor(centre_px.x() - radius_px)));
  const int x1 = std::min(width_px_ - 1, static_cast<int>(std::ceil(centre_px.x() + radius_px)));
  const int y0 = std::max(0, static_cast<int>(std::floor(centre_px.y() - radius_px)));
  const int y1 = std::min(height_px_ - 1, static_cast<int>(std::ceil(centre_px.y() + radius_px)));
  const double radius2 = radius_px * radius_px;
  for (int y = y0; y <= y1; ++y) {
    for (int x = x0; x <= x1; ++x) {
      const double dx = x + 0.5 - centre_px.x(), dy = y + 0.5 - centre_px.y();
      const double dz = slope.x() * dx + slope.y() * dy;
      if (dx * dx + dy * dy + dz * dz > radius2) continue;
      plot(x, y, static_cast<float>(centre_px.z() + dz / px_per_m), colour);
    }
  }
}

void Canvas::drawTriangle(const std::array<Eigen::Vector3d, 3>& p, const Eigen::Vector3f& colour) {
  const double area = (p[1].x() - p[0].x()) * (p[2].y() - p[0].y()) - (p[2].x() - p[0].x()) * (p[1].y() - p[0].y());
  if (!(std::abs(area) > 1e-12)) return;
  const auto [min_x, max_x] = std::minmax({p[0].x(), p[1].x(), p[2].x()});
  const auto [min_y, max_y] = std::minmax({p[0].y(), p[1].y(), p[2].y()});
  const int x0 = static_cast<int>(std::max(0.0, std::floor(min_x)));
  const int x1 = static_cast<int>(std::min<double>(width_px_ - 1, std::ceil(max_x)));
  const int y0 = static_cast<int>(std::max(0.0, std::floor(min_y)));
  const int y1 = static_cast<int>(std::min<double>(height_px_ - 1, std::ceil(max_y)));
  const auto edge = [](const Eigen::Vector3d& a, const Eigen::Vector3d& b, double x, double y) {
    return (b.x() - a.x()) * (y - a.y()) - (b.y() - a.y()) * (x - a.x());
  };
  for (int y = y0; y <= y1; ++y) {
    for (int x = x0; x <= x1; ++x) {
      const double w0 = edge(p[1], p[2], x + 0.5, y + 0.5) / area;
      const double w1 = edge(p[2], p[0], x + 0.5, y + 0.5) / area;
      const double w2 = 1 - w0 - w1;
      if (w0 < 0 || w1 < 0 || w2 < 0) continue;
      plot(x, y, static_cast<float>(w0 * p[0].z() + w1 * p[1].z() + w2 * p[2].z()), colour);
    }
  }
}

void Canvas::drawLine(const Eigen::Vector3d& from_px, const Eigen::Vector3d& to_px, double width_px, double lift_m,
                      const Eigen::Vector3f& colour) {
  const double length = (to_px - from_px).head<2>().norm();
  const int steps = std::max(1, static_cast<int>(std::ceil(length * 2)));
  for (int i = 0; i <= steps; ++i) {
    Eigen::Vector3d p = from_px + (to_px - from_px) * (static_cast<double>(i) / steps);
    p.z() += lift_m;
    drawSplat(p, Eigen::Vector3f::Zero(), width_px / 2, 1, colour);
  }
}

void Canvas::shadeByDepth(double range_m, int distance_px, float strength) {
  const std::array<std::array<int, 2>, 8> around = {
      {{1, 0}, {-1, 0}, {0, 1}, {0, -1}, {1, 1}, {1, -1}, {-1, 1}, {-1, -1}}};
  const float scale = static_cast<float>(1 / range_m);
  tbb::parallel_for(0, height_px_, [&](int y) {
    for (int x = 0; x < width_px_; ++x) {
      const float depth = depth_[at(x, y)];
      if (depth == kEmpty) continue;
      float hidden = 0;
      for (const auto& [dx, dy] : around) {
        const int u = x + dx * distance_px, v = y + dy * distance_px;
        if (u < 0 || v < 0 || u >= width_px_ || v >= height_px_) continue;
        const float other = depth_[at(u, v)];
        if (other > depth) hidden += std::min(1.0f, (other - depth) * scale);
      }
      colour_[at(x, y)] *= std::exp(-strength * hidden / static_cast<float>(around.size()));
    }
  });
}

RgbImage Canvas::reduced(int scale, const Eigen::Vector3f& background) const {
  RgbImage image(width_px_ / scale, height_px_ / scale, {0, 0, 0});
  tbb::parallel_for(0, image.height_px, [&](int y) {
    for (int x = 0; x < image.width_px; ++x) {
      Eigen::Vector3f sum = Eigen::Vector3f::Zero();
      for (int v = y * scale; v < (y + 1) * scale; ++v) {
        for (int u = x * scale; u < (x + 1) * scale; ++u) {
          sum += depth_[at(u, v)] == kEmpty ? background : colour_[at(u, v)];
        }
      }
      const Eigen::Vector3f mean = sum / static_cast<float>(scale * scale);
      Rgb pixel;
      for (int c = 0; c < 3; ++c) {
        pixel[static_cast<std::size_t>(c)] =
            static_cast<std::uint8_t>(std::lround(std::clamp(mean[c], 0.0f, 1.0f) * 255));
      }
      image.set(x, y, pixel);
    }
  });
  return image;
}

}  // namespace accessvdb::internal

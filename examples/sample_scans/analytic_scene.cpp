// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sample_scans/analytic_scene.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace accessvdb::samples {
namespace {

using Eigen::Vector3d;

constexpr double kMiss = std::numeric_limits<double>::infinity();
constexpr std::uint32_t kShapesPerLeaf = 4;
// Padding of the hierarchy's boxes, so that rounding in the slab test cannot miss a grazing hit.
constexpr double kBoxPadding_m = 1e-9;

double ahead(double t) { return t > 0.0 ? t : kMiss; }

double enterSphere(const Vector3d& centre, double radius, const Ray& ray) {
  const Vector3d oc = ray.origin - centre;
  const double b = oc.dot(ray.direction);
  const double h = b * b - (oc.squaredNorm() - radius * radius);
  return h >= 0.0 ? ahead(-b - std::sqrt(h)) : kMiss;
}

double enter(const Capsule& capsule, const Ray& ray) {
  const double t_ends =
      std::min(enterSphere(capsule.begin, capsule.radius, ray), enterSphere(capsule.end, capsule.radius, ray));
  const Vector3d span = capsule.end - capsule.begin;
  const double length = span.norm();
  if (!(length > 0.0)) return t_ends;
  // The curved side: dropping the components along the axis from ray and offset leaves a circle.
  const Vector3d axis = span / length;
  const Vector3d offset = ray.origin - capsule.begin;
  const Vector3d across = ray.direction - axis * axis.dot(ray.direction);
  const Vector3d offset_across = offset - axis * axis.dot(offset);
  const double a = across.squaredNorm();
  const double b = across.dot(offset_across);
  const double h = b * b - a * (offset_across.squaredNorm() - capsule.radius * capsule.radius);
  if (!(a > 0.0) || h < 0.0) return t_ends;
  const double t = (-b - std::sqrt(h)) / a;
  const double along = axis.dot(offset + t * ray.direction);
  return along >= 0.0 && along <= length ? std::min(t_ends, ahead(t)) : t_ends;
}

double enter(const TaperedCylinder& cylinder, const Ray& ray) {
  const Vector3d o = ray.origin - cylinder.base;
  const Vector3d& d = ray.direction;
  const double slope = (cylinder.top_radius - cylinder.base_radius) / cylinder.height;
  double nearest = kMiss;
  // Ends.
  if (d.z() != 0.0) {
    for (const auto& [z, radius] : {std::pair{0.0, cylinder.base_radius}, {cylinder.height, cylinder.top_radius}}) {
      const double t = (z - o.z()) / d.z();
      if ((o + t * d).head<2>().norm() <= radius) nearest = std::min(nearest, ahead(t));
    }
  }
  // Side: |xy(t)|^2 = r(z(t))^2 with r linear in z; both roots, because a cone opens both ways.
  const double m = cylinder.base_radius + slope * o.z();
  const double n = slope * d.z();
  const double a = d.head<2>().squaredNorm() - n * n;
  const double b = o.head<2>().dot(d.head<2>()) - m * n;
  const double c = o.head<2>().squaredNorm() - m * m;
  const auto consider = [&](double t) {
    const double z = o.z() + t * d.z();
    if (z >= 0.0 && z <= cylinder.height) nearest = std::min(nearest, ahead(t));
  };
  if (std::abs(a) > 1e-12) {
    const double h = b * b - a * c;
    if (h >= 0.0) {
      consider((-b - std::sqrt(h)) / a);
      consider((-b + std::sqrt(h)) / a);
    }
  } else if (b != 0.0) {
    consider(-c / (2.0 * b));
  }
  return nearest;
}

/// Slab test; {entry, exit}, entry > exit if the ray misses.
std::array<double, 2> crossSlabs(const Vector3d& min, const Vector3d& max, const Vector3d& o, const Vector3d& d) {
  double t_in = -kMiss, t_out = kMiss;
  for (int axis = 0; axis < 3; ++axis) {
    if (d[axis] == 0.0) {
      if (o[axis] < min[axis] || o[axis] > max[axis]) return {kMiss, -kMiss};
      continue;
    }
    const double t0 = (min[axis] - o[axis]) / d[axis];
    const double t1 = (max[axis] - o[axis]) / d[axis];
    t_in = std::max(t_in, std::min(t0, t1));
    t_out = std::min(t_out, std::max(t0, t1));
  }
  return {t_in, t_out};
}

double enter(const Box& box, const Ray& ray) {
  const double c = std::cos(box.yaw_rad), s = std::sin(box.yaw_rad);
  const auto turned = [&](const Vector3d& p) { return Vector3d(c * p.x() + s * p.y(), c * p.y() - s * p.x(), p.z()); };
  const auto [t_in, t_out] =
      crossSlabs(-box.half_size, box.half_size, turned(ray.origin - box.centre), turned(ray.direction));
  return t_in <= t_out ? ahead(t_in) : kMiss;
}

double enter(const Bump& bump, const Ray& ray) {
  return enterSphere({bump.x, bump.y, bump.height - bump.sphere_radius}, bump.sphere_radius, ray);
}

struct Bounds {
  Vector3d min, max;
};

Bounds bounds(const Capsule& c) {
  return {c.begin.cwiseMin(c.end).array() - c.radius, c.begin.cwiseMax(c.end).array() + c.radius};
}
Bounds bounds(const TaperedCylinder& c) {
  const double r = std::max(c.base_radius, c.top_radius);
  return {c.base - Vector3d(r, r, 0), c.base + Vector3d(r, r, c.height)};
}
Bounds bounds(const Box& b) {
  const double c = std::abs(std::cos(b.yaw_rad)), s = std::abs(std::sin(b.yaw_rad));
  const Vector3d half(c * b.half_size.x() + s * b.half_size.y(), s * b.half_size.x() + c * b.half_size.y(),
                      b.half_size.z());
  return {b.centre - half, b.centre + half};
}
// Only the part above the ground can be hit first.
Bounds bounds(const Bump& b) {
  const double r = std::sqrt(b.height * (2.0 * b.sphere_radius - b.height));
  return {{b.x - r, b.y - r, 0.0}, {b.x + r, b.y + r, b.height}};
}
Bounds bounds(const Shape& shape) {
  Bounds box = std::visit([](const auto& s) { return bounds(s); }, shape);
  box.min.array() -= kBoxPadding_m;
  box.max.array() += kBoxPadding_m;
  return box;
}

}  // namespace

double enterDistance(const Shape& shape, const Ray& ray) {
  return std::visit([&](const auto& s) { return enter(s, ray); }, shape);
}

AnalyticScene::AnalyticScene(std::vector<Shape> shapes) : shapes_(std::move(shapes)) {
  if (shapes_.empty()) return;
  std::vector<std::uint32_t> order(shapes_.size());
  std::iota(order.begin(), order.end(), 0u);
  build(0, static_cast<std::uint32_t>(order.size()), order);
  std::vector<Shape> sorted;
  sorted.reserve(shapes_.size());
  for (const std::uint32_t index : order) sorted.push_back(shapes_[index]);
  shapes_ = std::move(sorted);
}

void AnalyticScene::build(std::uint32_t first, std::uint32_t count, std::vector<std::uint32_t>& order) {
  Bounds all = bounds(shapes_[order[first]]);
  for (std::uint32_t i = first; i < first + count; ++i) {
    const Bounds box = bounds(shapes_[order[i]]);
    all.min = all.min.cwiseMin(box.min);
    all.max = all.max.cwiseMax(box.max);
  }
  const std::size_t self = nodes_.size();
  nodes_.push_back({all.min, all.max, first, count});
  if (count <= kShapesPerLeaf) return;

  int axis = 0;
  (all.max - all.min).maxCoeff(&axis);
  const auto centre = [&](std::uint32_t i) {
    const Bounds box = bounds(shapes_[i]);
    return box.min[axis] + box.max[axis];
  };
  const std::uint32_t half = count / 2;
  std::nth_element(order.begin() + first, order.begin() + first + half, order.begin() + first + count,
                   [&](std::uint32_t a, std::uint32_t b) { return centre(a) < centre(b); });
  nodes_[self].count = 0;
  build(first, half, order);
  nodes_[self].first = static_cast<std::uint32_t>(nodes_.size());
  build(first + half, count - half, order);
}

double AnalyticScene::castRay(const Ray& ray) const {
  double nearest = ray.direction.z() < 0.0 ? ahead(-ray.origin.z() / ray.direction.z()) : kMiss;
  if (nodes_.empty()) return nearest;
  std::array<std::uint32_t, 64> stack;  // halves every level, so 32 levels hold 2^32 shapes
  std::size_t depth = 0;
  stack[depth++] = 0;
  while (depth > 0) {
    const std::uint32_t index = stack[--depth];
    const Node& node = nodes_[index];
    const auto [t_in, t_out] = crossSlabs(node.min, node.max, ray.origin, ray.direction);
    if (!(t_in <= t_out) || t_out < 0.0 || t_in > nearest) continue;
    for (std::uint32_t i = 0; i < node.count; ++i) {
      nearest = std::min(nearest, enterDistance(shapes_[node.first + i], ray));
    }
    if (node.count == 0) {
      stack[depth++] = node.first;
      stack[depth++] = index + 1;
    }
  }
  return nearest;
}

}  // namespace accessvdb::samples

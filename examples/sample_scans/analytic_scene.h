// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A scene of exact shapes and the rays cast into it: no mesh, no sampling, so that ranges are exact to rounding.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <optional>
#include <variant>
#include <vector>

namespace accessvdb::samples {

struct Ray {
  Eigen::Vector3d origin;
  Eigen::Vector3d direction;  ///< unit
};

/// Metres throughout. Shapes are closed and rays start outside them.
struct Capsule {
  Eigen::Vector3d begin, end;
  double radius;
};
/// Vertical tapered cylinder with flat ends.
struct TaperedCylinder {
  Eigen::Vector3d base;  ///< centre of the lower end
  double height, base_radius, top_radius;
};
/// Box rotated about z.
struct Box {
  Eigen::Vector3d centre, half_size;
  double yaw_rad;
};
/// Cap of a large sphere that sticks out of the ground z = 0.
struct Bump {
  double x, y;
  double height, sphere_radius;
};
using Shape = std::variant<Capsule, TaperedCylinder, Box, Bump>;

/// Distance along the ray to where it enters the shape; infinity if it misses.
[[nodiscard]] double enterDistance(const Shape& shape, const Ray& ray);

/// Shapes on the ground plane z = 0, in a bounding volume hierarchy.
class AnalyticScene {
 public:
  explicit AnalyticScene(std::vector<Shape> shapes);

  /// Distance to the first surface, ground included; infinity if the ray hits nothing.
  [[nodiscard]] double castRay(const Ray& ray) const;
  [[nodiscard]] const std::vector<Shape>& shapes() const { return shapes_; }

 private:
  struct Node {
    Eigen::Vector3d min, max;
    std::uint32_t first;  ///< leaf: first shape; else the right child (the left one is the next node)
    std::uint32_t count;  ///< number of shapes of a leaf, 0 in inner nodes
  };
  void build(std::uint32_t first, std::uint32_t count, std::vector<std::uint32_t>& order);

  std::vector<Shape> shapes_;
  std::vector<Node> nodes_;
};

}  // namespace accessvdb::samples

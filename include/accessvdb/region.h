// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A part of a map, named by a person: what was cut, or what might be (AccessibilityField::removeRegion(), whatIf()).
/// The rules are in docs/design/change.md, "By hand".
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "accessvdb/export.h"

namespace accessvdb {

/// What is known of a place from which something was removed.
enum class RemovedAs : std::uint8_t {
  Unknown = 0,  ///< nothing: what was there still blocks, until the first scan that sees through it
  Free = 1      ///< that it is free now
};
/// "unknown", "free"
constexpr const char* name(RemovedAs as) { return as == RemovedAs::Free ? "free" : "unknown"; }

/// Only what the map has observed belongs to a region; what was never seen stays unknown, whatever lies around it.
class ACCESSVDB_API Region {
 public:
  enum class Kind : std::uint8_t { Box, Mesh, Points };

  /// Voxels whose centres lie in it, faces included. @throws InvalidArgument "region.box": not finite, or min above max
  static Region box(const Eigen::Vector3d& min_W, const Eigen::Vector3d& max_W);
  /// Voxels whose centres lie inside. Corners at the same place count as one. @throws UnusableInput "region.mesh": no
  /// triangle, a number that is not finite, a corner that does not exist, or not closed
  static Region mesh(std::vector<Eigen::Vector3d> vertices_W, std::vector<std::array<std::uint32_t, 3>> triangles);
  /// Surface points by SurfacePoint::id, each with its own voxel and the colliding voxels around it, up to tau and one
  /// voxel away, to which no other surface point is nearer. @throws InvalidArgument "region.empty"
  static Region points(std::vector<std::uint32_t> ids);

  [[nodiscard]] Kind kind() const { return kind_; }
  [[nodiscard]] const Eigen::Vector3d& min_W() const { return min_W_; }  ///< of a box or a mesh
  [[nodiscard]] const Eigen::Vector3d& max_W() const { return max_W_; }
  [[nodiscard]] const std::vector<Eigen::Vector3d>& vertices_W() const { return vertices_W_; }
  [[nodiscard]] const std::vector<std::array<std::uint32_t, 3>>& triangles() const { return triangles_; }
  [[nodiscard]] const std::vector<std::uint32_t>& ids() const { return ids_; }  ///< ascending, each once
  /// "box 0 0 1 to 0.5 0.5 2", "mesh of 812 triangles", "312 points"
  [[nodiscard]] std::string inWords() const;

 private:
  explicit Region(Kind kind) : kind_(kind) {}
  Kind kind_;
  Eigen::Vector3d min_W_ = {0, 0, 0}, max_W_ = {0, 0, 0};
  std::vector<Eigen::Vector3d> vertices_W_;
  std::vector<std::array<std::uint32_t, 3>> triangles_;
  std::vector<std::uint32_t> ids_;
};

/// What AccessibilityField::removeRegion() did.
struct Removal {
  RemovedAs as = RemovedAs::Unknown;
  std::uint64_t voxels = 0;            ///< observed voxels of the region
  std::uint64_t colliding_voxels = 0;  ///< those that blocked the tool
  std::uint64_t points = 0;            ///< surface points in them
  std::uint64_t flipped_voxels = 0;    ///< voxels that scoring sees differently from now on
};

}  // namespace accessvdb

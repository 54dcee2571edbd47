// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A tool as a triangle mesh in the tool frame: metres, tip at the origin, +x from the tip along the body (the
/// direction in which the tool withdraws), +z up. Right-handed.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/export.h"

namespace accessvdb {

enum class LengthUnit { Metre, Centimetre, Millimetre, Inch };
[[nodiscard]] ACCESSVDB_API double metresPer(LengthUnit unit);

/// How the mesh's own frame maps to the tool frame; all in the mesh's own units and axes.
struct ToolPose {
  std::optional<Eigen::Vector3d> tip;  ///< interaction point; default: the origin of the mesh file
  Eigen::Vector3d axis = {1, 0, 0};    ///< from the tip along the body
  Eigen::Vector3d up = {0, 0, 1};      ///< becomes +z as far as it is across the axis; if it is along it, x, y or z is
};

class ACCESSVDB_API ToolGeometry {
 public:
  /// Reads STL, OBJ, PLY, OFF, DAE, glTF or GLB through assimp, in a child process with limits on time and memory.
  /// @param unit  required for formats without one (STL, OBJ, PLY, OFF); overrides the others'
  /// @throws InputError (unreadable, malformed), UnusableInput (no faces, non-finite, size outside 1 mm .. 20 m),
  ///         InvalidArgument (no unit given but one is needed; axis or up of zero)
  static ToolGeometry fromMesh(const std::filesystem::path& path, std::optional<LengthUnit> unit,
                               const ToolPose& pose = {});
  /// From vertices in metres in the tool frame and triangles of vertex indices.
  static ToolGeometry fromTriangles(std::vector<Eigen::Vector3f> vertices_T,
                                    std::vector<std::array<std::uint32_t, 3>> triangles, std::string name);
  /// Another process's tool from what it says of itself: the mesh is taken as it is, not repaired again, so sha256() is
  /// the same. @throws as fromTriangles() for a mesh that no tool has, and as grownBy()
  static ToolGeometry restored(std::vector<Eigen::Vector3f> vertices_T,
                               std::vector<std::array<std::uint32_t, 3>> triangles, const std::string& name,
                               std::vector<std::string> notes, bool watertight, double margin_m);
  /// "builtin:pencil" (0.15 m long, 8 mm thick, 20 mm conical tip) or "builtin:pruner" (an arm of 0.6 m
  /// before a body of 0.5 m; its farthest vertex is 1.13 m from the tip). @throws InvalidArgument for any other name.
  static ToolGeometry builtin(const std::string& name);

  /// The same tool with everything within a margin of it (docs/tools.md, "How much room"): where it reaches a point,
  /// the tool does with that much room. It may collide with as many voxels as the tool without the margin. A margin of
  /// its own is replaced; 0 takes it away. Mesh, name and size are the tool's; sha256() is another.
  /// @throws InvalidArgument "tool.margin"  if it is negative, not finite, or larger than the tool
  [[nodiscard]] ToolGeometry grownBy(double margin_m) const;

  [[nodiscard]] const std::vector<Eigen::Vector3f>& vertices_T() const { return vertices_T_; }
  [[nodiscard]] const std::vector<std::array<std::uint32_t, 3>>& triangles() const { return triangles_; }
  [[nodiscard]] const std::string& name() const { return name_; }                 ///< file name or builtin name
  [[nodiscard]] const std::string& sha256() const { return sha256_; }             ///< of vertices, triangles and margin
  [[nodiscard]] const std::vector<std::string>& notes() const { return notes_; }  ///< repairs, oddities, in words
  [[nodiscard]] bool watertight() const { return watertight_; }
  [[nodiscard]] double margin_m() const { return margin_m_; }
  [[nodiscard]] Eigen::Vector3f min_T() const { return min_T_; }
  [[nodiscard]] Eigen::Vector3f max_T() const { return max_T_; }
  [[nodiscard]] float reach_m() const { return reach_m_; }  ///< farthest vertex from the tip

 private:
  /// Measures and hashes the mesh, which has faces.
  ToolGeometry(std::vector<Eigen::Vector3f> vertices_T, std::vector<std::array<std::uint32_t, 3>> triangles,
               const std::string& name, bool watertight);
  std::vector<Eigen::Vector3f> vertices_T_;
  std::vector<std::array<std::uint32_t, 3>> triangles_;
  std::string name_, sha256_;
  std::vector<std::string> notes_;
  bool watertight_ = false;
  Eigen::Vector3f min_T_ = Eigen::Vector3f::Zero(), max_T_ = Eigen::Vector3f::Zero();
  float reach_m_ = 0;
  double margin_m_ = 0;
};

}  // namespace accessvdb

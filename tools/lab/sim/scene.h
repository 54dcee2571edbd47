// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The scenes of docs/PAPER.md and others: a mesh to cast rays at, and the exact signed distance if known.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "accessvdb/tool_geometry.h"
#include "sim/signed_distance.h"
#include "sim/triangle_mesh.h"

namespace accessvdb::sim {

struct Scene {
  std::string name;                                ///< "torus", "sphere", ...
  std::string description;                         ///< one line with every dimension
  TriangleMesh mesh;                               ///< what rays hit
  std::shared_ptr<const SignedDistance> distance;  ///< null if the truth is unknown; then see distance_note
  std::string distance_note;                       ///< what the distance is, or why there is none
  double tessellation_error_m = 0;                 ///< largest distance between the mesh and the exact surface
  Eigen::Vector3d centre_W = {0, 0, 0};            ///< centre of the trajectories
};

/// Torus with vertical axis. @throws InvalidArgument unless 0 < minor_radius_m < major_radius_m
[[nodiscard]] Scene makeTorus(double major_radius_m, double minor_radius_m);
[[nodiscard]] Scene makeSphere(double radius_m);
/// Axis-parallel box centred at the origin; also the wall.
[[nodiscard]] Scene makeBox(const Eigen::Vector3d& size_m, const std::string& name = "box");
/// The same scene moved elsewhere, as its description says.
[[nodiscard]] Scene translated(Scene scene, const Eigen::Vector3d& offset_W);
/// A mesh file as a scene. Its distance is null, with a note, if the mesh is not closed.
[[nodiscard]] Scene makeMeshScene(const std::filesystem::path& path, std::optional<LengthUnit> unit);

}  // namespace accessvdb::sim

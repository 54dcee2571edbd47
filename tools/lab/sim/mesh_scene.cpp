// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <cstdio>
#include <string>
#include <utility>

#include "accessvdb/error.h"
#include "sim/mesh_distance.h"
#include "sim/scene.h"

namespace accessvdb::sim {
namespace {

void replaceAll(std::string& text, const std::string& from, const std::string& to) {
  for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size())) {
    text.replace(at, from.size(), to);
  }
}

/// The reader's messages speak of a tool, its usual input; here the problem is in a scene.
[[noreturn]] void rethrowAsScene(const Error& error) {
  std::string id = error.id(), problem = error.problem(), advice = error.advice();
  if (id.starts_with("tool.")) id.replace(0, 4, "scene");
  for (std::string* text : {&problem, &advice}) {
    replaceAll(*text, "LengthUnit", "--mesh-unit");
    replaceAll(*text, "the path of ToolGeometry::fromMesh", "the path of --scene");
    replaceAll(*text, "the tool mesh", "the mesh");
    replaceAll(*text, "the tool", "the mesh");
    replaceAll(*text, ", or builtin:pencil or builtin:pruner", "");
  }
  switch (error.code()) {
    case ErrorCode::Usage:
      throw InvalidArgument(id, error.subject(), problem, advice);
    case ErrorCode::Input:
      throw InputError(id, error.subject(), problem, advice);
    case ErrorCode::Unusable:
      throw UnusableInput(id, error.subject(), problem, advice);
    case ErrorCode::Resource:
      throw ResourceLimit(id, error.subject(), problem, advice);
    default:
      throw Error(error.code(), id, error.subject(), problem, advice);
  }
}

ToolGeometry readMesh(const std::filesystem::path& path, std::optional<LengthUnit> unit) {
  try {
    return ToolGeometry::fromMesh(path, unit);
  } catch (const Error& error) {
    rethrowAsScene(error);
  }
}

}  // namespace

Scene makeMeshScene(const std::filesystem::path& path, std::optional<LengthUnit> unit) {
  const ToolGeometry mesh = readMesh(path, unit);  // tip at the file's origin, axes unchanged: the mesh does not move
  Scene scene;
  scene.name = "mesh";
  scene.mesh = {mesh.vertices_T(), mesh.triangles()};
  const Eigen::Vector3f size_m = mesh.max_T() - mesh.min_T();
  scene.centre_W = 0.5 * (mesh.min_T() + mesh.max_T()).cast<double>();
  char text[160];
  std::snprintf(text, sizeof text, ", %zu triangles, %.4g x %.4g x %.4g m, sha256 ", scene.mesh.triangles.size(),
                static_cast<double>(size_m.x()), static_cast<double>(size_m.y()), static_cast<double>(size_m.z()));
  scene.description = "mesh " + mesh.name() + text + mesh.sha256();
  for (const std::string& note : mesh.notes()) {
    // Repairs matter here too; the tool's tip does not.
    if (note.find("tool") == std::string::npos && note.find("ToolPose") == std::string::npos)
      scene.description += "; " + note;
  }

  std::string why_not;
  scene.distance = makeMeshDistance(scene.mesh, why_not);
  scene.distance_note = scene.distance ? "distance to the triangles, inside by winding number"
                                       : "no distance, so no ground truth: " + why_not;
  return scene;
}

}  // namespace accessvdb::sim

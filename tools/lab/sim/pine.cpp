// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/pine.h"

#include <algorithm>
#include <cstdio>

#include "accessvdb/error.h"
#include "sim/mesh_distance.h"
#include "sim/pine_skeleton.h"
#include "sim/pine_tessellation.h"

namespace accessvdb::sim {
namespace {

/// A tenth of the voxel that the paper uses for its tree: invisible to a map at 10 mm.
constexpr double kChordError_m = 0.001;

TriangleMesh tessellate(const PineSkeleton& tree, double shoot_chord_error_m = kChordError_m) {
  TriangleMesh mesh;
  for (const auto* order : {&tree.trunk, &tree.branches, &tree.twigs})
    for (const RoundCone& cone : *order) appendRoundCone(cone, kChordError_m, mesh);
  for (const RoundCone& cone : tree.shoots) appendRoundCone(cone, shoot_chord_error_m, mesh);
  for (const RoundCone& needle : tree.needles) appendNeedle(needle, mesh);
  return mesh;
}

}  // namespace

TriangleMesh makePineMesh(const PineParams& params, double solid_foliage_m) {
  PineSkeleton tree = growPine(params);
  if (!(solid_foliage_m > 0)) return tessellate(tree);
  tree.needles.clear();
  for (RoundCone& shoot : tree.shoots) {
    shoot.radius_a_m = std::max(shoot.radius_a_m, 0.5 * solid_foliage_m);
    shoot.radius_b_m = std::max(shoot.radius_b_m, solid_foliage_m);
  }
  // The surface of such a body is not well defined: a fifth of its radius is fine enough.
  return tessellate(tree, std::max(kChordError_m, 0.2 * solid_foliage_m));
}

Scene makePine(const PineParams& params) {
  const PineSkeleton tree = growPine(params);
  Scene scene;
  scene.mesh = tessellate(tree);
  scene.name = "pine";
  char text[320];
  std::snprintf(
      text, sizeof text,
      "Pinus radiata, height %.2f m, trunk diameter %.3f m at 1.3 m, %d whorls with %d branches, %zu twig pieces, "
      "%zu shoots, %zu needle bundles, %zu triangles, seed %llu",
      params.height_m, tree.trunk_diameter_m, tree.whorls, tree.branch_count, tree.twigs.size(), tree.shoots.size(),
      tree.needles.size(), scene.mesh.triangles.size(), static_cast<unsigned long long>(params.seed));
  scene.description = text;
  std::string why_not;
  scene.distance = makeMeshDistance(scene.mesh, why_not);
  if (!scene.distance) throw InternalError("simulation.pine", "pine", why_not);
  scene.distance_note =
      "exact distance to the triangles that rays hit; the tree is these triangles, so nothing is lost by tessellation";
  scene.tessellation_error_m = 0;
  scene.centre_W = {0, 0, params.height_m / 2};
  return scene;
}

}  // namespace accessvdb::sim

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/pine.h"

#include <cstdio>

#include "accessvdb/error.h"
#include "sim/mesh_distance.h"
#include "sim/pine_skeleton.h"
#include "sim/pine_tessellation.h"

namespace accessvdb::sim {
namespace {

/// A tenth of the voxel that the paper uses for its tree: nothing that a map at 10 mm could see.
constexpr double kChordError_m = 0.001;

}  // namespace

Scene makePine(const PineParams& params) {
  const PineSkeleton tree = growPine(params);
  Scene scene;
  for (const auto* order : {&tree.trunk, &tree.branches, &tree.twigs, &tree.shoots})
    for (const RoundCone& cone : *order) appendRoundCone(cone, kChordError_m, scene.mesh);
  for (const RoundCone& needle : tree.needles) appendNeedle(needle, scene.mesh);

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

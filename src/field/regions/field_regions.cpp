// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/regions/field_regions.h"

#include <memory>
#include <string>
#include <vector>

#include "accessvdb/error.h"

namespace accessvdb::internal {

void requireRegions(const FieldStages& field) {
  const FieldParams& params = field.params;
  if (params.window || params.update.policy != UpdatePolicy::Exact || params.tsdf.region == UpdateRegion::Projective) {
    throw InvalidArgument("region.unsupported", "",
                          "regions need a map in one piece, the exact policy, and no projective fusion",
                          "Map the scene without tiles, with the default profile");
  }
}

void requireCurrentLabels(FieldStages& field) {
  requireRegions(field);
  if (field.tools.size() > 1) {
    throw InvalidArgument("region.tools", std::to_string(field.tools.size()) + " tools",
                          "what a cut would open can only be computed for a field with one tool",
                          "Map the scene with each tool alone");
  }
  field.steps.requireWhole();
  if (!field.labels.current || field.labels.backlog > 0) {
    throw InvalidArgument("region.stale", "", "the labels are not up to date, so it is unknown what is blocked now",
                          field.labels.backlog > 0 ? "Call update() until its backlog is 0" : "Call update() first");
  }
}

VoxelSet voxelsIn(const FieldStages& field, const Region& region) {
  return voxelsOf(region, {field.map, field.points, field.gate.origin_W()});
}

Removal removeRegion(FieldStages& field, const Region& region, RemovedAs as) {
  requireRegions(field);
  field.steps.requireWhole();
  const VoxelSet voxels = voxelsIn(field, region);
  Removal removal;
  removal.as = as;
  removal.voxels = countVoxels(voxels);
  removal.points = pointsIn(voxels, field.points).size();
  for (const LeafChange& change : flipsIfFree(field.map, voxels)) {
    removal.colliding_voxels += countBits(change.collides_off);
  }
  field.steps.run([&] {
    field.stopLeading();
    const bool free = as == RemovedAs::Free;
    const std::vector<LeafChange> changes = free ? removeAsFree(field.map, voxels) : removeAsUnknown(field.map, voxels);
    if (field.gone_cells) {
      field.gone_cells->noteRemoved(voxels);
      field.gone_points.noteRemoved(field.points, voxels, free);
    }
    for (const LeafChange& change : changes) removal.flipped_voxels += flippedVoxels(change);
    field.mirrors.takeRemoved(changes, free);
    field.scoreAllAgain();  // weights have fallen, which no scan does, and which no scheduler follows
    field.leadAgain();
  });
  return removal;
}

WhatIf whatIf(FieldStages& field, const VoxelSet& voxels) {
  requireCurrentLabels(field);
  const WhatIfTables& tables = whatIfTables(field);
  const ToolScoring& tool = field.tools.front();
  return field.steps.run([&] {
    return openedWithout(
        {field.map, *tool.scorer, tool.setup, tables, field.mirrors.facts(), field.gate.origin_W(), field.withheld()},
        voxels);
  });
}

const WhatIfTables& whatIfTables(FieldStages& field) {
  if (!field.what_if_tables) {
    field.what_if_tables = std::make_unique<WhatIfTables>(field.tools.front().setup, field.params.tsdf.voxel_size_m);
  }
  return *field.what_if_tables;
}

}  // namespace accessvdb::internal

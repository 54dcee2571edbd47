// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Parts of a map taken out by hand, and what would open without them.
#include "field/field_impl.h"

namespace accessvdb {

void AccessibilityField::Impl::requireRegions() const {
  if (params.window || params.update.policy != UpdatePolicy::Exact || params.tsdf.region == UpdateRegion::Projective) {
    throw InvalidArgument("region.unsupported", "",
                          "regions need a map in one piece, the exact policy, and no projective fusion",
                          "Map the scene without tiles, with the default profile");
  }
}

Removal AccessibilityField::Impl::removeRegion(const Region& region, RemovedAs as) {
  requireRegions();
  steps.requireWhole();
  const internal::VoxelSet voxels = internal::voxelsOf(region, regionPlace());
  Removal removal;
  removal.as = as;
  removal.voxels = internal::countVoxels(voxels);
  removal.points = internal::pointsIn(voxels, points).size();
  for (const LeafChange& change : internal::flipsIfFree(volume.packed(), voxels)) {
    removal.colliding_voxels += internal::countBits(change.collides_off);
  }
  steps.run([&] {
    const std::vector<LeafChange> changes = as == RemovedAs::Free ? internal::removeAsFree(volume.packed(), voxels)
                                                                  : internal::removeAsUnknown(volume.packed(), voxels);
    if (gone_cells) {
      gone_cells->noteRemoved(voxels);
      gone_points.noteRemoved(points, voxels, as == RemovedAs::Free);
    }
    for (const LeafChange& change : changes) removal.flipped_voxels += internal::flippedVoxels(change);
    mirror.apply(changes);
    if (distance_mirror && as == RemovedAs::Free) mirrorAllDistances();
    scoreAllAgain();
  });
  return removal;
}

/// That mirror cannot take a distance back, so it is made again.
void AccessibilityField::Impl::mirrorAllDistances() {
  distance_mirror.reset();
  distance_mirror = makeDistanceMirror();
  internal::forEachDistanceLeaf(volume.packed(), [this](auto distances) { distance_mirror->apply(distances); });
}

/// Forgets the state of all points. Weights have fallen, which no scan does, and which no scheduler follows.
void AccessibilityField::Impl::scoreAllAgain() {
  scheduler.reset();
  scorer.reset();
  scorer = std::make_unique<internal::PointScorer>(points, params, *backend, reads);
  further.forget();
  scheduler = further.makeSchedulers(*scorer, setup);
  scheduler->noteRestored();
  labels_current = false;
}

/// Switches bits of the mirror for a moment: a step, because one that fails half-way leaves obstacles out.
WhatIf AccessibilityField::Impl::whatIf(const internal::VoxelSet& voxels) {
  requireCurrentLabels();
  const internal::WhatIfTables& tables = whatIfTables();
  return steps.run([&] {
    return internal::openedWithout({volume.packed(), *scorer, setup, tables, mirror, gate.origin_W(), withheld()},
                                   voxels);
  });
}

void AccessibilityField::Impl::requireCurrentLabels() {
  requireRegions();
  if (!further.empty()) {
    throw InvalidArgument("region.tools", std::to_string(tools.size()) + " tools",
                          "what a cut would open can only be computed for a field with one tool",
                          "Map the scene with each tool alone");
  }
  steps.requireWhole();
  if (!labels_current || backlog > 0) {
    throw InvalidArgument("region.stale", "", "the labels are not up to date, so it is unknown what is blocked now",
                          backlog > 0 ? "Call update() until its backlog is 0" : "Call update() first");
  }
}

const internal::WhatIfTables& AccessibilityField::Impl::whatIfTables() {
  if (!what_if_tables) {
    what_if_tables = std::make_unique<internal::WhatIfTables>(setup, params.tsdf.voxel_size_m);
  }
  return *what_if_tables;
}

}  // namespace accessvdb

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/mirrors.h"

#include "launch/stopwatch.h"
#include "tsdf/leaf_facts.h"

namespace accessvdb::internal {

Mirrors::Mirrors(kernels::Backend& backend, const PackedMap& map, const FieldParams& resolved)
    : backend_(backend),
      map_(map),
      voxel_size_m_(resolved.tsdf.voxel_size_m),
      truncation_distance_m_(static_cast<float>(resolved.tsdf.truncation_distance_m)),
      facts_(std::in_place, backend.makeArena(), voxel_size_m_) {
  if (resolved.mirror_distance) distances_ = makeDistances();
}

std::unique_ptr<DistanceMirror> Mirrors::makeDistances() const {
  const DistanceLeaves leaves = {map_.distanceCode(), truncation_distance_m_};
  return std::make_unique<DistanceMirror>(backend_.makeArena(), voxel_size_m_, DistanceMirror::kDefaultRootCapacity,
                                          leaves);
}

void Mirrors::take(const MapChangesOfScan& changes, FrameStats& stats) {
  if (!changes.aged.empty()) facts_->applyLists(changes.aged);
  if (!changes.opened.empty()) facts_->apply(changes.opened);
  takeFacts(changes.fused.changes, stats);
  if (distances_) takeDistances(changes, stats);
}

void Mirrors::takeDistances(const MapChangesOfScan& changes, FrameStats& stats) {
  std::vector<DistanceChange> opened;  // no longer observed; as the scan left their leaves
  const auto rooms = std::make_unique_for_overwrite<LeafValues::Room[]>(changes.opened.size());
  for (const LeafChange& change : changes.opened) {
    const auto& [x, y, z] = change.origin_ijk;
    opened.push_back(distancesOf(map_, *map_.tree().probeConstLeaf({x, y, z}), rooms[opened.size()]));
  }
  if (!opened.empty()) distances_->apply(opened);
  const kernels::Stopwatch mirroring;
  distances_->applyLists(changes.fused.distances);
  for (const auto& part : changes.fused.distances) stats.distance_leaves += part.size();
  stats.distance_mirror_bytes = distances_->lastTraffic().bytes_written;
  stats.distance_mirror_ms = mirroring.milliseconds();
}

void Mirrors::takeFacts(std::span<const std::span<const LeafChange>> facts, FrameStats& stats) {
  const kernels::Stopwatch mirroring;
  facts_->applyLists(facts);
  for (const auto& part : facts) stats.changed_leaves += part.size();
  stats.mirror_bytes = facts_->lastTraffic().bytes_written;
  stats.mirror_ms = mirroring.milliseconds();
}

void Mirrors::take(std::span<const LeafChange> facts, std::span<const PackedLeaf* const> leaves) {
  facts_->apply(facts);
  if (!distances_) return;
  std::vector<DistanceChange> distances;
  const auto rooms = std::make_unique_for_overwrite<LeafValues::Room[]>(leaves.size());
  for (const PackedLeaf* leaf : leaves)
    if (LeafValues(*leaf)) distances.push_back(distancesOf(map_, *leaf, rooms[distances.size()]));
  distances_->apply(distances);
}

void Mirrors::makeFactsAgain() {
  // Never two of them at once.
  facts_.reset();
  facts_.emplace(backend_.makeArena(), voxel_size_m_);
  forEachPartOfFacts(map_, [this](auto facts) { facts_->apply(facts); });
}

void Mirrors::takeRemoved(std::span<const LeafChange> facts, bool distances_too) {
  facts_->apply(facts);
  if (!distances_ || !distances_too) return;
  distances_.reset();
  distances_ = makeDistances();
  forEachDistanceLeaf(map_, [this](auto distances) { distances_->apply(distances); });
}

}  // namespace accessvdb::internal

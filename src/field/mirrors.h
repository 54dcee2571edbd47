// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The mirrors of a field's map in the backend's memory: its facts, which scoring reads, and on demand its distances.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "accessvdb/distance_change.h"
#include "accessvdb/leaf_change.h"
#include "accessvdb/params.h"
#include "accessvdb/types.h"
#include "launch/backend.h"
#include "mirror/nanovdb_mirror.h"
#include "tsdf/packed_map.h"
#include "tsdf/scan_integrator.h"

namespace accessvdb::internal {

/// What a scan changed in the map, in the order in which it happened. Valid until the next scan.
struct MapChangesOfScan {
  std::vector<std::span<const LeafChange>> aged;  ///< free space that no ray confirmed in time
  std::vector<LeafChange> opened;                 ///< where rays go through what has gone
  IntegrationResult fused;

  [[nodiscard]] std::vector<std::span<const LeafChange>> facts() const {
    std::vector<std::span<const LeafChange>> all = aged;
    all.emplace_back(opened);
    all.insert(all.end(), fused.changes.begin(), fused.changes.end());
    return all;
  }
};

class Mirrors {
 public:
  /// @param map  must outlive them
  Mirrors(kernels::Backend& backend, const PackedMap& map, const FieldParams& resolved);

  /// In the backend's memory.
  [[nodiscard]] const kernels::OccupancyGrid* grid() const { return facts_ ? facts_->grid() : nullptr; }
  /// Null if there is no mirror of distances.
  [[nodiscard]] const DistanceMirror::Grid* distanceGrid() const { return distances_ ? distances_->grid() : nullptr; }
  [[nodiscard]] bool mirrorsDistances() const { return distances_ != nullptr; }
  /// For those who switch its bits for a moment.
  [[nodiscard]] NanoVdbMirror& facts() { return *facts_; }

  /// Call when the map has all of the scan. @param stats  of the mirrors, filled in
  void take(const MapChangesOfScan& changes, FrameStats& stats);
  /// What changed without a scan. @param stats  as above
  void takeFacts(std::span<const std::span<const LeafChange>> facts, FrameStats& stats);
  /// Leaves of a saved map, or what was left out of one. @param leaves  of the map, maybe without distances
  void take(std::span<const LeafChange> facts, std::span<const PackedLeaf* const> leaves);
  /// Makes the mirror of facts again, from the map, whatever was written to it; readers of the one before must have
  /// ended. Only where the map has all scans and nothing was left out, and without a mirror of distances.
  void makeFactsAgain();
  /// After a removal, which may also have taken distances away. That mirror cannot, so it is made again.
  void takeRemoved(std::span<const LeafChange> facts, bool distances_too);

  [[nodiscard]] std::uint64_t factBytes() const { return facts_ ? facts_->usedBytes() + facts_->hostBytes() : 0; }
  /// Of both, the host's own copies of their topology.
  [[nodiscard]] std::uint64_t hostBytes() const {
    return (facts_ ? facts_->hostBytes() : 0) + (distances_ ? distances_->hostBytes() : 0);
  }
  [[nodiscard]] std::uint64_t distanceBytes() const {
    return distances_ ? distances_->usedBytes() + distances_->hostBytes() : 0;
  }

 private:
  [[nodiscard]] std::unique_ptr<DistanceMirror> makeDistances() const;
  void takeDistances(const MapChangesOfScan& changes, FrameStats& stats);

  kernels::Backend& backend_;
  const PackedMap& map_;
  double voxel_size_m_;
  float truncation_distance_m_;
  std::optional<NanoVdbMirror> facts_;         ///< missing only once makeFactsAgain() failed
  std::unique_ptr<DistanceMirror> distances_;  ///< only for FieldParams::mirror_distance
};

}  // namespace accessvdb::internal

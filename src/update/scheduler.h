// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which points are scored when: the two policies behind one interface.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <span>

#include "accessvdb/distance_change.h"
#include "accessvdb/leaf_change.h"
#include "accessvdb/types.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

/// What a scan changed in the map; valid until the next one.
struct MapChanges {
  std::span<const std::span<const LeafChange>> facts;          ///< each leaf with flips at most once
  std::span<const std::span<const DistanceChange>> distances;  ///< likewise; empty unless Needs::distances
};

/// What a scheduler needs to be told.
struct Needs {
  bool news = false;       ///< for the next scan: noteReturns() needs PointStore::describeTouched()
  bool changes = false;    ///< always: each change of the map through noteChange(), before noteChanges()
  bool distances = false;  ///< always: MapChanges::distances
};

class UpdateScheduler {
 public:
  virtual ~UpdateScheduler() = default;

  [[nodiscard]] virtual Needs needs() const { return {}; }

  /// One scan's returns are in the store. The map may be on its way to have them: nobody reads it here. The points'
  /// backend may begin to work on them.
  /// @param p_L  [n] returns  @param q_L  [n] or [1] sensor positions
  virtual void noteReturns(const TouchedPoints& touched, std::span<const Eigen::Vector3f> p_L,
                           std::span<const Eigen::Vector3f> q_L) = 0;
  /// While the map takes the scan in: what flipped in one leaf. From several threads, also beside noteReturns(), but
  /// those of a part from one at a time. @param part  below kMostParts
  virtual void noteChange(std::size_t /*part*/, const LeafChange& /*change*/) {}
  static constexpr std::size_t kMostParts = 256;
  /// Now the map has them as well. After noteReturns(), once a scan.
  virtual void noteChanges(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                           const MapChanges& changes) = 0;

  /// The changes are noted, but the mirror may not have them yet: the backend may begin with them. After noteChanges(),
  /// at most once a scan; without it, update() does. @param tables  as update() will get them
  virtual void prepare(const ScoringTables& /*tables*/) {}

  /// Scores what is due. Of the times it gives score_ms; the field gives the rest of the update to update_ms.
  virtual UpdateStats update(const ScoringTables& tables) = 0;

  [[nodiscard]] virtual std::uint64_t bytes() const = 0;
  /// In the backend's memory, the state of the points not included.
  [[nodiscard]] virtual std::uint64_t deviceBytes() const { return 0; }
};

}  // namespace accessvdb::internal

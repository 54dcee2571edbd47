// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which points are scored when: one interface for both policies.
#pragma once

#include <tbb/parallel_for.h>

#include <Eigen/Core>
#include <cstddef>
#include <functional>
#include <memory>
#include <span>
#include <utility>

#include "accessvdb/distance_change.h"
#include "accessvdb/leaf_change.h"
#include "accessvdb/types.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

/// What a scan changed in the map; valid until the next scan.
struct MapChanges {
  /// Each leaf with flips at most once in each list, and the lists in the order in which they happened.
  std::span<const std::span<const LeafChange>> facts;
  std::span<const std::span<const DistanceChange>> distances;  ///< likewise; empty unless Needs::distances
};

/// What a scheduler needs to be told.
struct Needs {
  bool deltas = false;     ///< for the next scan: noteReturns() needs PointStore::describeTouched()
  bool changes = false;    ///< always: each change of the map via noteChange(), before noteChanges()
  bool distances = false;  ///< always: MapChanges::distances
};

class UpdateScheduler {
 public:
  virtual ~UpdateScheduler() = default;

  [[nodiscard]] virtual Needs needs() const { return {}; }

  /// Call when the store has put the new points of a scan into its index (PointStore::indexNew), while it sums up the
  /// returns; only if needs().deltas.
  /// @param changed  TouchedPoints::changed_blocks
  virtual void noteBlocks(std::span<const std::uint32_t> /*changed*/) {}
  /// Call when one scan's returns are in the store. The map may still be integrating them, so this must not read it.
  /// The points' backend may begin to work on them.
  /// @param p_L  [n] returns  @param q_L  [n] or [1] sensor positions
  virtual void noteReturns(const TouchedPoints& touched, std::span<const Eigen::Vector3f> p_L,
                           std::span<const Eigen::Vector3f> q_L) = 0;
  /// Reports what flipped in one leaf while the map integrates the scan. Called from several threads, also concurrently
  /// with noteReturns(), but for each list by one thread at a time. @param list  below kMostLists
  virtual void noteChange(std::size_t /*list*/, const LeafChange& /*change*/) {}
  static constexpr std::size_t kMostLists = 256;
  /// noteChange() for all of these, on several threads. @param lists  at most kMostLists
  void noteEachList(std::span<const std::span<const LeafChange>> lists) {
    tbb::parallel_for(std::size_t{0}, lists.size(), [&](std::size_t list) {
      for (const LeafChange& change : lists[list]) noteChange(list, change);
    });
  }
  /// Call when the map contains the returns, too: after noteReturns(), once per scan.
  virtual void noteChanges(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                           const MapChanges& changes) = 0;

  /// Call instead of these when the map changed without a scan.
  /// @param facts  in lists, as for noteChange(); each leaf at most once
  virtual void noteChangesAlone(std::span<const std::span<const LeafChange>> facts) {
    noteChanges({}, {}, {facts, {}});
  }

  /// Call instead of these when the points and the map came from a saved state: nothing was scored yet, and all points
  /// count as new.
  virtual void noteRestored() {}

  /// Call instead of noteRestored() when, besides, PointScorer::restore() got what an update had found out about all
  /// points. @return false if this scheduler cannot go on from there: then noteRestored()
  virtual bool noteScored() { return false; }

  /// Lets the backend begin with the noted changes; the mirror may not have them yet. After noteChanges(), at most once
  /// per scan; if not called, update() does this. @param mirror  in the backend's memory, the same as for update()
  virtual void prepare(const kernels::OccupancyGrid* /*mirror*/) {}
  /// The same with what flipped on a device that fuses (takeFlipsOf), before noteReturns(), while the scan's returns
  /// come to the store. prepare() is called nevertheless.
  virtual void prepareFlips(const kernels::OccupancyGrid* /*mirror*/) {}

  /// Whether it may read what flipped from a device that fuses.
  [[nodiscard]] virtual bool takesFlipsOnDevice() const { return false; }
  /// From now on what flips is read from there, in place of noteChange(). @param fuser  must outlive this, or null:
  /// then what it still has is taken
  virtual void takeFlipsOf(kernels::ScanFuser* /*fuser*/) {}

  /// Scores what is due. Fills in score_ms; the field attributes the rest of the update's time to update_ms.
  /// @param budget_points  most points to score, for each tool; the others wait. 0: no limit
  virtual UpdateStats update(const kernels::OccupancyGrid* mirror, int budget_points) = 0;
  /// Called in the next updates, from any thread, once they no longer read the points and the map on the host, nor what
  /// noteChange() writes; not all schedulers call it. @param release_map  may be empty
  void whenMapIsReleased(std::function<void()> release_map) { release_map_ = std::move(release_map); }

  [[nodiscard]] virtual std::uint64_t bytes() const = 0;
  /// In the backend's memory, without the state of the points.
  [[nodiscard]] virtual std::uint64_t deviceBytes() const { return 0; }

 protected:
  void releaseMap() const {
    if (release_map_) release_map_();
  }

 private:
  std::function<void()> release_map_;
};

}  // namespace accessvdb::internal

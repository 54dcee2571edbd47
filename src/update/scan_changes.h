// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What scans changed for the exact policy on the host: points whose normal or views are others now, and flips of the
/// map. Tools that are tried in the same directions share one, so that this is noted and found once for all of them.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "processor/prefetch.h"
#include "update/flip_set.h"
#include "update/moved_points.h"

namespace accessvdb::internal {

class ScanChanges {
 public:
  /// @param scorer  holds the weights, normals and views; the scheduler of this one notes returns and flips
  explicit ScanChanges(PointScorer& scorer) : scorer_(scorer), moved_points_(scorer) {}

  [[nodiscard]] const PointScorer& scorer() const { return scorer_; }
  void addReader() { ++readers_; }

  /// All that there is came from a saved state, with what an update found out about it (PointScorer::restore).
  void noteScored();
  void noteReturns(const TouchedPoints& touched) { moved_points_.note(touched); }
  void noteFlips(std::span<const std::span<const LeafChange>> facts);

  /// At the beginning of an update: finds the points that changed, and brings the scorer's normals, views and weights
  /// up to date. The first reader's call does it; what it found stays until the last one has called finish().
  void refresh();
  void finish();

  /// Points of which a weight may have changed.
  [[nodiscard]] const std::vector<std::uint32_t>& touched() const { return touched_; }
  [[nodiscard]] const PointScorer::Changed& changed() const { return changed_; }
  [[nodiscard]] std::size_t movedPoints() const { return moved_count_; }
  /// Into changed(); kNone if the point did not change.
  [[nodiscard]] std::uint32_t indexOf(std::uint32_t id) const { return index_of_[id]; }
  void prefetch(std::uint32_t id) const { prefetchRead(&index_of_[id]); }
  /// Whether points of a block changed.
  [[nodiscard]] bool changedIn(std::uint32_t block) const { return in_block_[block] != 0; }
  /// False if no point of the block has a neighbourhood, so none was ever scored.
  [[nodiscard]] bool anyScoredIn(std::uint32_t block) const { return moved_points_.anyIn(block); }
  [[nodiscard]] const FlipSet& flips() const { return flips_; }
  /// Voxels that stopped colliding in the flips' leaves, by cell.
  [[nodiscard]] const std::vector<std::uint64_t>& freed() const { return freed_; }

  [[nodiscard]] std::uint64_t bytes() const;

 private:
  [[nodiscard]] std::vector<std::uint32_t> findCrossed();

  PointScorer& scorer_;
  int readers_ = 0, reading_ = 0;  ///< those that have yet to call finish()
  MovedPoints moved_points_;
  FlipSet flips_;
  std::vector<std::uint64_t> freed_;
  std::vector<std::uint32_t> fresh_;  ///< below the confidence bound
  std::vector<std::uint32_t> touched_;
  PointScorer::Changed changed_;
  std::size_t moved_count_ = 0;
  ChunkedArray<std::uint32_t> index_of_;  ///< by id; all kNone between updates
  ChunkedArray<std::uint8_t> in_block_;   ///< all 0 between updates
  std::uint32_t known_points_ = 0;
  bool anything_scored_ = false;
};

}  // namespace accessvdb::internal

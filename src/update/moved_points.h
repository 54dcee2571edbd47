// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which neighbourhoods the returns since the last update may have changed (docs/DESIGN.md, "Exact updates", causes (b)
/// to (d)).
///
/// A neighbourhood is made of the k nearest points, so a touched point matters to another one only where its old or its
/// new mean lies no farther away than the k-th neighbour did: a point that was among the nearest was there, and a point
/// that becomes one of them comes there. Exact but for the slack of a float32 comparison, always to the safe side.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "points/near_kernels.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

class MovedPoints {
 public:
  explicit MovedPoints(const PointScorer& scorer) : scorer_(scorer) {}

  /// A scan touched these points. Nothing is kept before the first refreshed(): then no neighbourhood is known.
  void note(const TouchedPoints& touched);

  /// Ids of the touched points since the last clear(), ascending, each once.
  [[nodiscard]] const std::vector<std::uint32_t>& touched();

  /// Points with a neighbourhood that may not be valid any more, ascending.
  [[nodiscard]] std::vector<std::uint32_t> find();

  /// The neighbourhoods of these points are valid again.
  void refreshed(std::span<const std::uint32_t> ids);

  void clear();

  /// False where no point of the block has a neighbourhood, so none was ever scored.
  [[nodiscard]] bool anyIn(std::uint32_t block) const {
    return block < block_reach_m_.size() && block_reach_m_[block] >= 0;
  }

  [[nodiscard]] std::uint64_t bytes() const;

 private:
  struct Touched {
    std::uint32_t id;
    std::uint32_t views_changed;
    Eigen::Vector3f before_L;  ///< pca_L() at the last update; NaN where it is newer
  };
  /// The touched points of one block: [begin, end) of by_block_.
  struct Group {
    std::uint32_t block, begin, end;
  };

  void joinTouched();
  void groupByBlock();
  [[nodiscard]] std::vector<std::uint32_t> reachedBlocks();
  void findInBlock(std::uint32_t block, NearPositions& places, std::vector<std::uint32_t>& moved) const;
  template <typename Visit>
  void forEachNear(const Index3& leaf, float reach_m, const Visit& visit) const;

  const PointScorer& scorer_;
  bool any_known_ = false;  ///< does any point have a neighbourhood?
  std::size_t joined_ = 0;  ///< the first of touched_ are sorted, each id once
  std::vector<Touched> touched_;
  std::vector<std::uint32_t> ids_;
  std::vector<std::uint32_t> by_block_;  ///< indices into touched_
  std::vector<Group> groups_;
  ChunkedArray<std::uint32_t> group_of_block_;  ///< [blocks], kNone where nothing was touched
  ChunkedArray<std::uint8_t> reached_;          ///< [blocks], all zero between two calls
  ChunkedArray<float> block_reach_m_;           ///< [blocks] largest reach of its points, negative where none has one
};

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which neighbourhoods the returns since the last update may have changed (docs/DESIGN.md, "Exact updates", causes (b)
/// to (d)).
///
/// A neighbourhood consists of the k nearest points, so a touched point matters to another one only if its old or its
/// new mean is no farther away than the k-th neighbour was: a former neighbour was there, and a new one moves there.
/// Where not every point is scored (hostdev/surface_choice.h), a touched point also matters to those that it competes
/// with, whether its mean moved or not: its returns are counted.
/// Exact except for the slack of a float32 comparison, which always errs on the safe side.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "points/near_kernels.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

class MovedPoints {
 public:
  explicit MovedPoints(const PointScorer& scorer)
      : scorer_(scorer), competitors_voxels_(static_cast<float>(scorer.choice().reachVoxels())) {}

  /// Notes the points that a scan touched. Ignored before the first refreshed(), when no neighbourhood is known yet.
  void note(const TouchedPoints& touched);

  /// Ids of the points touched since the last clear(), ascending, each once.
  [[nodiscard]] const std::vector<std::uint32_t>& touched();

  /// Points whose neighbourhood may no longer be valid, and `others`: in order of their blocks, and in no particular
  /// order within a block. Neighbourhoods are computed fastest that way.
  /// @param others  each once, and none of them with a neighbourhood
  [[nodiscard]] std::vector<std::uint32_t> find(std::span<const std::uint32_t> others = {});

  /// Marks the neighbourhoods of these points as valid again.
  void refreshed(std::span<const std::uint32_t> ids);

  void clear();

  /// False if no point of the block has a neighbourhood, so none was ever scored.
  [[nodiscard]] bool anyIn(std::uint32_t block) const {
    return block < block_reach_m_.size() && block_reach_m_[block] >= 0;
  }

  [[nodiscard]] std::uint64_t bytes() const;

 private:
  struct Touched {
    std::uint32_t id;
    std::uint32_t views_changed;
    Eigen::Vector3f before_L;  ///< pca_L() at the last update; NaN for newer points
  };
  /// The touched points of one block: [begin, end) of by_block_.
  struct TouchedBlock {
    std::uint32_t block, begin, end;
    std::uint32_t places = 0;  ///< number of their entries in places_, which begin at 2 * begin
    LeafBits voxels = {};      ///< theirs; only if not every point is scored
  };
  /// Touched voxels of a leaf.
  struct TouchedLeaf {
    Index3 leaf;
    const LeafBits* voxels;
  };
  /// Scratch memory of a thread.
  struct NearTouched {
    NearPositions places;
    std::vector<TouchedLeaf> leaves;
  };

  void joinTouched();
  void groupByBlock();
  void listPlaces(TouchedBlock& touched_block);
  [[nodiscard]] std::vector<std::uint32_t> reachedBlocks();
  void findInBlock(std::uint32_t block, NearTouched& near, std::vector<std::uint32_t>& moved) const;
  void listTouchedLeaves(const Index3& leaf, std::vector<TouchedLeaf>& leaves) const;
  [[nodiscard]] bool competesWithAny(std::uint32_t id, const std::vector<TouchedLeaf>& leaves) const;
  [[nodiscard]] float reachVoxels(float reach_m) const;
  template <typename Visit>
  void forEachNear(const Index3& leaf, float reach_m, const Visit& visit) const;

  const PointScorer& scorer_;
  float competitors_voxels_;  ///< SurfaceChoice::reachVoxels()
  bool any_known_ = false;    ///< does any point have a neighbourhood?
  std::size_t joined_ = 0;    ///< this many at the front of touched_ are sorted, each id once
  std::vector<Touched> touched_;
  std::vector<std::uint32_t> ids_;
  std::vector<std::uint64_t> keys_;      ///< block << 32 | index into touched_
  std::vector<std::uint32_t> by_block_;  ///< indices into touched_
  std::vector<Eigen::Vector3f> places_;  ///< old and new means of touched points, block by block
  std::vector<TouchedBlock> touched_blocks_;
  ChunkedArray<std::uint32_t> touched_block_of_;  ///< [blocks], kNone if nothing was touched
  ChunkedArray<std::uint8_t> reached_;            ///< [blocks], all zero between calls
  ChunkedArray<float> block_reach_m_;             ///< [blocks] largest reach of its points, negative if none has one
};

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What has gone, by the evidence of rays that went through where it was and returned from behind
/// (docs/design/change.md, "Gone by evidence").
///
/// Cells of 4^3 voxels that have surface points count returns and passes. A verdict changes no voxel: while it stands,
/// each ray through a colliding voxel of the cell opens that very voxel, and one return in the cell revokes it.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "accessvdb/params.h"
#include "change/cell_record.h"
#include "change/leaf_flags.h"
#include "change/ray_evidence.h"
#include "points/chunked_array.h"
#include "points/point_store.h"
#include "points/voxel_column_box.h"
#include "tsdf/packed_map.h"
#include "tsdf/removed_voxels.h"

namespace accessvdb::internal {

class GoneCells {
 public:
  /// @param map, points  must outlive this  @param core  of a tile: other cells are judged by the tiles around it
  GoneCells(const PackedMap& map, const PointStore& points, const TsdfParams& resolved,
            const std::optional<VoxelColumnBox>& core = std::nullopt);

  /// Takes in one scan, whose returns are in the store but not yet in the map.
  /// @param touched  points that got a return, in the order of their leaves
  /// @return the voxels that its rays open
  std::vector<OpenedLeaf> takeScan(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                                   std::span<const std::uint32_t> touched);

  // The same for tiles, which go through a scan side by side: what a cell is judged by may lie in another tile. Each
  // calls these in turn, and none the next before all have called the one before.
  /// What scans without a ray or a return here would have done. @param scans  scans() of the larger map
  void catchUp(std::uint64_t scans);
  /// Around the core the tiles that judge there know better in which cells nothing is left to open.
  /// @param verdictOf  (cell) -> std::optional<Verdict>; nothing: as it is
  template <typename VerdictOf>
  void followOthers(const VerdictOf& verdictOf) {
    for (const CellPlace place : gone_) {
      if (at(place).verdict != Verdict::Gone || isOurs(cellAt(place))) continue;
      if (verdictOf(cellAt(place)) == Verdict::Open) setOpen(place);
    }
  }
  /// Hits, and the rays that pass. @param p_L, q_L  of all rays that come near the tile  @param touched  as above
  void count(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
             std::span<const std::uint32_t> touched);
  /// Cells of the core that have gone by this scan. Changes nothing.
  [[nodiscard]] std::vector<Index3> judged() const;
  /// @param cells  that have gone by this scan, of all tiles
  void noteGone(std::span<const Index3> cells);
  /// @return the voxels of the core that the scan's rays open
  [[nodiscard]] std::vector<OpenedLeaf> endScan();
  /// Whether anything that a saved state holds has changed since the last call.
  [[nodiscard]] bool takeChanged() { return std::exchange(changed_, false); }

  /// A person says that these voxels are no longer what they were: what was counted in their cells is forgotten. Cells
  /// in which nothing else stands have gone by that word: rays open what is left of them, and a return revokes it.
  void noteRemoved(const VoxelSet& voxels);

  /// Blocks of points, in an order that follows from their places: for a saved state.
  [[nodiscard]] std::vector<std::uint32_t> blocksInOrder() const;
  [[nodiscard]] const LeafCells& cellsOf(std::uint32_t block) const { return blocks_[block].cells; }
  /// Scans so far: once in a while, what has nothing left to open is no longer walked.
  [[nodiscard]] std::uint64_t scans() const { return scans_; }
  void restoreScans(std::uint64_t scans) { scans_ = scans; }
  /// Puts the cells of a saved state in place; the points come first. @param leaf  voxel index >> 3
  /// @return false if there are no points, or cells that cannot be
  [[nodiscard]] bool restore(const Index3& leaf, const LeafCells& cells);
  /// The verdict on the cell of a voxel; nothing if it has no points.
  [[nodiscard]] std::optional<Verdict> verdictAt(const Index3& voxel) const;

  [[nodiscard]] std::uint64_t bytes() const;

 private:
  struct CellPlace {
    std::uint32_t block, cell;
  };
  [[nodiscard]] CellRecord& at(CellPlace place) { return blocks_[place.block].cells[place.cell]; }
  void grow() { blocks_.grow(points_.index().blocks().size()); }
  /// Voxels of a block with a return, cell by cell.
  struct BlockHits {
    std::uint32_t block;
    std::array<std::uint8_t, 8> counts;
  };
  [[nodiscard]] std::vector<BlockHits> hitsOf(std::span<const std::uint32_t> touched) const;
  template <typename Visit>
  static void forEachHit(const std::vector<BlockHits>& hits, const Visit& visit);
  /// Passes through some blocks, all of those that there are, and what follows from them.
  struct PassedBlocks {
    std::span<const Pass> passes;  ///< ascending
    std::vector<CellPlace> cells;  ///< those passed, each once
    std::vector<Index3> suspect;   ///< leaves that are new among the suspect ones
  };
  [[nodiscard]] static std::vector<PassedBlocks> byBlocks(std::span<const Pass> passes);
  template <typename Visit>
  void forEachPart(const Visit& visit);
  void addPasses(PassedBlocks& passed);
  [[nodiscard]] bool hasGone(CellPlace place) const;
  [[nodiscard]] bool updateFlags(CellPlace place);
  void refreshFlags(CellPlace place);
  void walkAround(CellPlace place);
  void dropWhatIsDone();
  void setOpen(CellPlace place);
  [[nodiscard]] Index3 cellAt(CellPlace place) const;
  [[nodiscard]] bool isOurs(const Index3& cell) const { return !core_ || core_->contains(voxelOfCell(cell)); }

  const PackedMap& map_;
  const PointStore& points_;
  std::optional<VoxelColumnBox> core_;
  WalkShape shape_;
  std::uint64_t scans_ = 0;
  RayEvidence evidence_;             ///< of the scan that is under way
  std::vector<PassedBlocks> parts_;  ///< of its passes
  bool changed_ = false;
  ChunkedArray<BlockCells> blocks_;  ///< per block of points
  LeafFlags suspect_, opening_;
  std::vector<CellPlace> gone_;  ///< Verdict::Gone, in no order; others may be among them
};

/// How far behind a surface its voxels may collide, in cells.
[[nodiscard]] std::int32_t shadowCells(const TsdfParams& resolved);

/// Makes what a scan opened unobserved and confirmed to be free. @return what flipped
std::vector<LeafChange> openVoxels(PackedMap& map, std::span<const OpenedLeaf> opened);

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/shared_scan.h"

#include <algorithm>
#include <bit>
#include <iterator>
#include <optional>
#include <utility>

namespace accessvdb::tiles {
namespace {

using internal::FieldAccess;
using internal::GoneCells;
using internal::OpenedLeaf;

/// Of what was opened, all that the tile may hold.
std::vector<OpenedLeaf> nearTo(const TileIndex& id, const std::vector<OpenedLeaf>& opened, std::int32_t tile_voxels,
                               std::int32_t margin_voxels) {
  constexpr std::int32_t kLeafEdge = 8;
  internal::VoxelColumnBox box = internal::coreOf(TileId{id.first, id.second, {}}.window(tile_voxels));
  for (std::size_t axis = 0; axis < 2; ++axis) {
    box.low[axis] -= margin_voxels + kLeafEdge;
    box.high[axis] += margin_voxels + kLeafEdge;
  }
  std::vector<OpenedLeaf> near;
  std::ranges::copy_if(opened, std::back_inserter(near), [&box](const OpenedLeaf& leaf) {
    return box.contains({kLeafEdge * leaf.leaf[0], kLeafEdge * leaf.leaf[1], kLeafEdge * leaf.leaf[2]});
  });
  return near;
}

}  // namespace

SharedScan::SharedScan(const internal::GatedScan& scan, const Moment& moment, std::vector<TouchedTile> here,
                       StepSorter& sorter, RaySorter& ray_sorter)
    : scan_(scan), moment_(moment), here_(std::move(here)), sorter_(sorter), ray_sorter_(ray_sorter) {}

/// @param visit  (GoneCells&)
template <typename Visit>
void SharedScan::forEachCells(const Visit& visit) const {
  for (const TouchedTile& each : here_) FieldAccess::visitGoneCells(each.tile->field, visit);
}

std::vector<SharedScan::OfTile> SharedScan::fuse(std::int32_t tile_voxels, std::int32_t margin_voxels) const {
  catchUp(tile_voxels);
  begin();
  judge();
  const std::vector<OpenedLeaf> opened = open();
  std::vector<OfTile> fused;
  for (const TouchedTile& each : here_) {
    const std::vector<OpenedLeaf> near = nearTo(each.id, opened, tile_voxels, margin_voxels);
    const FrameStats stats = FieldAccess::endScan(each.tile->field, near);
    bool has_changed = !near.empty();
    FieldAccess::visitGoneCells(each.tile->field,
                                [&has_changed](GoneCells& cells) { has_changed = cells.takeChanged() || has_changed; });
    fused.push_back({stats, has_changed});
  }
  return fused;
}

/// With scans that came near others only, and with what others have found out by them.
void SharedScan::catchUp(std::int32_t tile_voxels) const {
  forEachCells([this](GoneCells& cells) { cells.catchUp(moment_.scans); });
  const int shift = std::countr_zero(static_cast<std::uint32_t>(tile_voxels));
  const auto verdictOf = [&](const internal::Index3& cell) -> std::optional<internal::Verdict> {
    const internal::Index3 voxel = internal::voxelOfCell(cell);
    const TileIndex id = {voxel[0] >> shift, voxel[1] >> shift};
    const auto owner = std::ranges::find(here_, id, &TouchedTile::id);
    if (owner == here_.end()) return std::nullopt;
    std::optional<internal::Verdict> verdict;
    FieldAccess::visitGoneCells(owner->tile->field, [&](const GoneCells& cells) { verdict = cells.verdictAt(voxel); });
    return verdict;
  };
  forEachCells([&](GoneCells& cells) { cells.followOthers(verdictOf); });
}

void SharedScan::begin() const {
  for (const TouchedTile& each : here_) {
    if (FieldAccess::agesUntil(each.tile->field, moment_.age_s)) each.tile->behind = true;
    FieldAccess::Returns returns = {{}, scan_.q_L};
    if (each.has_returns) {
      const StepSorter::Returns sorted = sorter_.returnsOf(each.id, scan_);
      returns = {sorted.p_L, sorted.q_L, sorted.attributes};
    }
    FieldAccess::beginScan(each.tile->field, returns, ray_sorter_.raysOf(each.id, scan_), moment_.stamp_s);
  }
}

void SharedScan::judge() const {
  std::vector<internal::Index3> gone;
  forEachCells([&gone](const GoneCells& cells) {
    const std::vector<internal::Index3> judged = cells.judged();
    gone.insert(gone.end(), judged.begin(), judged.end());
  });
  forEachCells([&gone](GoneCells& cells) { cells.noteGone(gone); });
}

std::vector<OpenedLeaf> SharedScan::open() const {
  std::vector<OpenedLeaf> opened;
  forEachCells([&opened](GoneCells& cells) {
    const std::vector<OpenedLeaf> of_tile = cells.endScan();
    opened.insert(opened.end(), of_tile.begin(), of_tile.end());
  });
  return opened;
}

}  // namespace accessvdb::tiles

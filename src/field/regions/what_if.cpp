// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/regions/what_if.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <span>
#include <utility>

#include "field/regions/region_voxels.h"
#include "field/tools/tool_heading.h"
#include "hostdev/cell_counts.h"
#include "hostdev/point_update.h"
#include "launch/stopwatch.h"
#include "update/flip_set.h"
#include "update/scored_arrays.h"

namespace accessvdb::internal {
namespace {

/// Which directions may read a voxel that goes, for all points of a block.
class Affected {
 public:
  Affected(const WhatIfTables& tables, const std::vector<LeafChange>& changes) : tables_(tables) {
    flips_.add(changes);
    for (const LeafChange& change : changes) {
      const Index3 leaf = parentOf(change.origin_ijk);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        low_[axis] = changes_ == 0 ? leaf[axis] : std::min(low_[axis], leaf[axis]);
        high_[axis] = changes_ == 0 ? leaf[axis] : std::max(high_[axis], leaf[axis]);
      }
      ++changes_;
      const std::uint64_t counts = kernels::countCells(change.collides_off.data());
      for (std::int32_t cell = 0; cell < 8; ++cell) {
        if ((counts >> (8 * cell) & 0xff) == 0) continue;
        freed_cells_.push_back(
            {2 * leaf[0] + (cell >> 2 & 1), 2 * leaf[1] + (cell >> 1 & 1), 2 * leaf[2] + (cell & 1)});
      }
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {  // blocks whose points read one of these leaves
      low_[axis] -= tables.footprint.high()[axis];
      high_[axis] -= tables.footprint.low()[axis];
    }
  }

  [[nodiscard]] bool none() const { return changes_ == 0; }
  [[nodiscard]] const Index3& low() const { return low_; }
  [[nodiscard]] const Index3& high() const { return high_; }

  [[nodiscard]] DirectionMask directions(const Index3& leaf) const {
    const LeafFootprint& footprint = tables_.footprint;
    const DirectionMask arm = byLeaf(footprint.armColumns(), leaf, FlipKind::ArmFreeOn);
    if (tables_.cells.empty()) return arm | byLeaf(footprint.toolColumns(), leaf, FlipKind::CollidesOff);
    DirectionMask tool = {};
    const Index3 &first = tables_.cells.low(), &size = tables_.cells.size();
    for (const Index3& cell : freed_cells_) {
      Index3 at;
      bool inside = true;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        at[axis] = cell[axis] - 2 * leaf[axis] - first[axis];
        inside = inside && at[axis] >= 0 && at[axis] < size[axis];
      }
      if (!inside) continue;
      tool = tool | tables_.cells.sets()[static_cast<std::size_t>((at[0] * size[1] + at[1]) * size[2] + at[2])];
    }
    return arm | tool;
  }

 private:
  [[nodiscard]] DirectionMask byLeaf(std::span<const kernels::FootprintColumn> columns, const Index3& leaf,
                                     FlipKind kind) const {
    DirectionMask directions = {};
    for (const kernels::FootprintColumn& column : columns) {
      for (std::int32_t z = column.z_low; z <= column.z_high; ++z) {
        const std::uint8_t kinds = flips_.kindsIn({leaf[0] + column.dx, leaf[1] + column.dy, leaf[2] + z});
        if ((kinds & bitOf(kind)) == 0) continue;
        directions = directions | column.directions;
        break;
      }
    }
    return directions;
  }

  const WhatIfTables& tables_;
  FlipSet flips_;
  std::size_t changes_ = 0;
  Index3 low_ = {}, high_ = {};
  std::vector<Index3> freed_cells_;  ///< of 4^3 voxels
};

std::vector<PointLabel> labelsOf(const PointScorer& scorer) {
  std::vector<PointLabel> labels(scorer.device().size());
  if (!labels.empty()) {
    scorer.backend().download(labels.data(), scorer.device().view().label, labels.size() * sizeof(PointLabel));
  }
  return labels;
}

/// Blocked points that may open, with the directions that may.
std::vector<kernels::ScoreItem> chooseItems(const WhatIfInputs& parts, const VoxelSet& voxels,
                                            const Affected& affected) {
  const PointStore& points = parts.scorer.points();
  const std::vector<PointLabel> labels = labelsOf(parts.scorer);
  const std::vector<std::uint32_t> gone = pointsIn(voxels, points);
  std::vector<std::uint32_t> blocks;
  points.index().forEachBlock(affected.low(), affected.high(), [&](std::uint32_t b) { blocks.push_back(b); });
  std::vector<std::vector<kernels::ScoreItem>> found(blocks.size());
  // Counting stops where a direction is blocked; below that it is exact.
  const auto limit = static_cast<std::uint16_t>(parts.setup.tool().collision_limit);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, blocks.size(), 16), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      const PointBlock& block = points.index().blocks()[blocks[n]];
      kernels::ScoreItem item;
      item.known_score = static_cast<std::uint16_t>(limit - 1);
      bool chosen = false;
      for (const std::uint32_t id : block.ids) {
        if (id >= labels.size() || labels[id] != PointLabel::Blocked) continue;
        if (id < parts.withheld.size() && parts.withheld[id] != 0) continue;
        if (!std::exchange(chosen, true)) item.candidates = affected.directions(block.leaf);
        if (!any(item.candidates)) break;
        if (std::binary_search(gone.begin(), gone.end(), id)) continue;
        item.id = id;
        found[n].push_back(item);
      }
    }
  });
  std::vector<kernels::ScoreItem> items;
  for (const auto& part : found) items.insert(items.end(), part.begin(), part.end());
  return items;
}

/// The same flips the other way round.
std::vector<LeafChange> undone(std::vector<LeafChange> changes) {
  for (LeafChange& change : changes) {
    std::swap(change.collides_on, change.collides_off);
    std::swap(change.arm_free_on, change.arm_free_off);
  }
  return changes;
}

std::vector<kernels::ScoreResult> tryAgain(const WhatIfInputs& parts, const std::vector<LeafChange>& changes,
                                           const std::vector<kernels::ScoreItem>& items) {
  std::vector<kernels::ScoreResult> results(items.size());
  if (items.empty()) return results;
  kernels::Backend& backend = parts.scorer.backend();
  // Results of trying points go here, not into their state.
  const kernels::PointStateView state = parts.scorer.device().view();
  ScoredArrays scratch(backend, parts.scorer.device().size(), state.roll != nullptr);
  const std::vector<PointLabel> blocked(scratch.label.size(), PointLabel::Blocked);
  scratch.label.upload(blocked.data(), blocked.size());
  const ScoringTables tables = parts.setup.tables(parts.mirror.grid());
  kernels::ScoreRequest request;
  request.map = tables.map;
  request.tool = tables.tool;
  request.approach = tables.approach;
  request.points = scratch.in(state);
  request.rule = tables.rule;
  request.rule.keep_best = false;
  request.prepared = tables.prepared;
  request.items = items.data();
  request.results = results.data();
  request.count = items.size();
  parts.mirror.apply(changes);
  backend.scorePoints(request);
  parts.mirror.apply(undone(changes));
  return results;
}

/// Observations behind a point's confidence once the voxels have gone, as point_weights.h has them.
std::uint16_t weightWithout(const WhatIfInputs& parts, const VoxelSet& voxels, std::uint32_t id) {
  const Index3 voxel = parts.scorer.points().voxelOf(parts.scorer.points().first_L(id));
  const std::int32_t reach = parts.scorer.params().scoring.neighbourhood_weight ? 1 : 0;
  float most = 0;
  bool beside = false;
  for (std::int32_t x = -reach; x <= reach; ++x) {
    for (std::int32_t y = -reach; y <= reach; ++y) {
      for (std::int32_t z = -reach; z <= reach; ++z) {
        const openvdb::Coord ijk(voxel[0] + x, voxel[1] + y, voxel[2] + z);
        if (contains(voxels, ijk)) {
          beside = true;
        } else {
          most = std::max(most, static_cast<float>(parts.map.at(ijk).weight));
        }
      }
    }
  }
  if (beside) return static_cast<std::uint16_t>(most);
  // Nothing changes, and what rays have opened around the point (gone_points.h) still counts.
  std::uint16_t now = 0;
  parts.scorer.reads().weights({&id, 1}, {&now, 1});
  return now;
}

SurfacePoint openedPoint(const WhatIfInputs& parts, const kernels::ScoreResult& result, const ToolHeading& heading,
                         std::uint32_t id) {
  SurfacePoint point;
  point.id = id;
  point.position_W = parts.origin_W + parts.scorer.points().first_L(id).cast<double>();
  parts.scorer.backend().download(point.normal_W.data(), parts.scorer.device().view().normal_L + std::size_t{3} * id,
                                  3 * sizeof(float));
  point.label = PointLabel::Accessible;
  point.reason = PointReason::None;
  point.score = result.score;
  point.direction = result.direction;
  point.roll = result.roll;
  point.yaw_rad = heading.yaw_rad;
  point.direction_W = heading.direction_W;
  point.orientation_WT = heading.orientation_WT;
  return point;
}

}  // namespace

WhatIfTables::WhatIfTables(const ScoringSetup& setup, double voxel_size_m)
    : footprint(setup.hostTool(), setup.hostApproach(), voxel_size_m, 0),
      cells(setup.hostTool(), setup.tool().num_directions, 0, /*as_sets=*/true) {}

WhatIf openedWithout(const WhatIfInputs& parts, const VoxelSet& voxels) {
  const kernels::Stopwatch choosing;
  WhatIf what_if;
  what_if.voxels = countVoxels(voxels);
  what_if.points_gone = pointsIn(voxels, parts.scorer.points()).size();
  const std::vector<LeafChange> changes = flipsIfFree(parts.map, voxels);
  for (const LeafChange& change : changes) {
    what_if.colliding_voxels += countBits(change.collides_off);
  }
  const Affected affected(parts.tables, changes);
  std::vector<kernels::ScoreItem> items;
  if (!affected.none()) items = chooseItems(parts, voxels, affected);
  what_if.points_tried = items.size();
  what_if.choose_ms = choosing.milliseconds();

  const kernels::Stopwatch scoring;
  const std::vector<kernels::ScoreResult> results = tryAgain(parts, changes, items);
  const ToolRolls& rolls = parts.setup.tool().rolls;
  const std::vector<ToolHeading> headings = toolHeadings(parts.scorer.params().approach, rolls);
  const auto half_weight = static_cast<float>(parts.scorer.params().scoring.confidence_half_weight);
  for (std::size_t n = 0; n < items.size(); ++n) {
    what_if.direction_tests += results[n].tests;
    if (results[n].reason != PointReason::None || results[n].scored == 0) continue;
    const std::uint16_t weight = weightWithout(parts, voxels, items[n].id);
    if (!parts.scorer.isConfident(weight)) continue;
    const std::size_t held =
        std::size_t{results[n].direction} * static_cast<std::size_t>(rolls.count) + results[n].roll;
    SurfacePoint& point = what_if.opens.emplace_back(openedPoint(parts, results[n], headings[held], items[n].id));
    point.weight = weight;
    point.confidence = kernels::confidenceOf(weight, half_weight);
  }
  std::sort(what_if.opens.begin(), what_if.opens.end(),
            [](const SurfacePoint& a, const SurfacePoint& b) { return a.id < b.id; });
  what_if.score_ms = scoring.milliseconds();
  return what_if;
}

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/direction_arcs.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <limits>
#include <map>
#include <utility>

#include "hostdev/direction_mask.h"

namespace accessvdb::internal {
namespace {

using kernels::ArcsOfColumn;
using kernels::ArcsView;
using kernels::CoveringArc;

/// First direction, and the one after the last.
using ArcEnds = std::pair<std::uint8_t, std::uint8_t>;
/// One for each height at which a voxel is covered.
using Heights = std::vector<bool>;

/// Runs of a set of directions around the circle, in `arcs`. All of them are two halves, because an arc is not as long
/// as that.
void findArcs(const kernels::DirectionMask& directions, int count, std::vector<ArcEnds>& arcs) {
  arcs.clear();
  kernels::DirectionMask begins, ends;
  std::uint64_t before = directions.test(count - 1) ? 1 : 0;  // whether the direction before is one of them
  for (int w = 0; w < kernels::kMaxDirectionWords; ++w) {
    const std::uint64_t bits = directions.word[w], shifted = bits << 1 | before;
    before = bits >> 63;
    begins.word[w] = bits & ~shifted;
    ends.word[w] = shifted & ~bits;
  }
  kernels::forEachDirection(begins, [&](int d) { arcs.emplace_back(static_cast<std::uint8_t>(d), std::uint8_t{0}); });
  if (arcs.empty()) {
    const auto half = static_cast<std::uint8_t>(count / 2);
    if (directions.test(0)) arcs.assign({{std::uint8_t{0}, half}, {half, std::uint8_t{0}}});
    return;
  }
  // The first end belongs to the last begin if that arc goes on over direction 0. One that ends there has its end.
  std::size_t n = directions.test(0) && arcs[0].first != 0 ? arcs.size() - 1 : 0;
  kernels::forEachDirection(ends, [&](int d) {
    if (d >= count || d == 0) return;
    arcs[n].second = static_cast<std::uint8_t>(d);
    n = (n + 1) % arcs.size();
  });
}

std::uint64_t keyOf(const CoveringArc& arc) {
  return std::uint64_t{arc.begin} << 32 | std::uint64_t{arc.end} << 16 | std::uint64_t{arc.lowest} << 8 | arc.heights;
}

/// Appends an arc for each run of heights.
void appendRuns(const ArcEnds& ends, const Heights& heights, std::vector<CoveringArc>& arcs) {
  for (std::size_t z = 0; z < heights.size(); ++z) {
    if (!heights[z]) continue;
    const std::size_t lowest = z;
    while (z + 1 < heights.size() && heights[z + 1]) ++z;
    arcs.push_back({kernels::stepPlace(ends.first), kernels::stepPlace(ends.second), static_cast<std::uint8_t>(lowest),
                    static_cast<std::uint8_t>(z - lowest)});
  }
}

/// The box of what any direction covers, with the margin. @return false if there is nothing
bool findBox(const kernels::ToolKernelView& tool, std::uint32_t columns, ArcsView& shape) {
  std::array<std::int32_t, 3> low, high;
  low.fill(std::numeric_limits<std::int32_t>::max());
  high.fill(std::numeric_limits<std::int32_t>::min());
  for (std::uint32_t n = 0; n < columns; ++n) {
    const kernels::VoxelColumn& c = tool.columns[n];
    if (c.bits == 0) continue;
    const std::array<std::int32_t, 3> bottom = {c.dx, c.dy, c.dz + std::countr_zero(c.bits)},
                                      top = {c.dx, c.dy, c.dz + 63 - std::countl_zero(c.bits)};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], bottom[axis]);
      high[axis] = std::max(high[axis], top[axis]);
    }
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (high[axis] < low[axis]) return false;
    shape.low[axis] = low[axis] - ArcsView::kMargin;
    shape.size[axis] = high[axis] - low[axis] + 1 + 2 * ArcsView::kMargin;
    if (shape.size[axis] > (axis == 2 ? ArcsView::kMostHeight : ArcsView::kMostSize)) return false;
  }
  return true;
}

}  // namespace

DirectionArcs::DirectionArcs(const kernels::ToolKernelView& tool, int num_directions) {
  if (tool.use_samples || tool.parts != 1 || num_directions < 2 ||
      2 * tool.collision_limit > kernels::known_count::kMost)
    return;
  const std::uint32_t columns = tool.column_begin[num_directions];
  ArcsView shape;
  if (!findBox(tool, columns, shape)) return;
  const auto size_x = static_cast<std::size_t>(shape.size[0]), size_y = static_cast<std::size_t>(shape.size[1]),
             size_z = static_cast<std::size_t>(shape.size[2]);
  std::vector<std::vector<std::uint32_t>> columns_at(size_x);
  std::vector<std::uint8_t> direction_of(columns);
  for (int d = 0; d < num_directions; ++d) {
    for (std::uint32_t n = tool.column_begin[d]; n < tool.column_begin[d + 1]; ++n) {
      direction_of[n] = static_cast<std::uint8_t>(d);
      if (tool.columns[n].bits == 0) continue;
      columns_at[static_cast<std::size_t>(tool.columns[n].dx - shape.low[0])].push_back(n);
    }
  }
  // The arcs of each column of voxels, and at which heights.
  std::vector<std::vector<std::map<ArcEnds, Heights>>> found(size_x);
  // With more than these it will not pay, however few columns are used: a thick tool in fine voxels would take
  // gigabytes.
  const auto most = static_cast<std::size_t>(kMostArcsPerColumn * static_cast<double>(size_x * size_y));
  std::atomic<std::size_t> listed = 0;
  tbb::parallel_for(std::size_t{0}, size_x, [&](std::size_t x) {
    found[x].resize(size_y);
    if (columns_at[x].empty()) return;
    std::vector<kernels::DirectionMask> masks(size_y * size_z);
    for (const std::uint32_t n : columns_at[x]) {
      const kernels::VoxelColumn& c = tool.columns[n];
      kernels::DirectionMask* const column = masks.data() + static_cast<std::size_t>(c.dy - shape.low[1]) * size_z;
      for (std::uint64_t bits = c.bits; bits != 0; bits &= bits - 1) {
        column[c.dz + std::countr_zero(bits) - shape.low[2]].set(direction_of[n]);
      }
    }
    std::vector<ArcEnds> arcs;
    for (std::size_t y = 0; y < size_y && listed <= most; ++y) {
      for (std::size_t z = 0; z < size_z; ++z) {
        if (!kernels::any(masks[y * size_z + z])) continue;
        findArcs(masks[y * size_z + z], num_directions, arcs);
        for (const ArcEnds& arc : arcs) {
          found[x][y].try_emplace(arc, size_z, false).first->second[z] = true;
        }
      }
      listed += found[x][y].size();
    }
  });
  if (listed > most) return;
  std::vector<ArcsOfColumn> table(size_x * size_y);
  std::vector<CoveringArc> more;
  std::map<std::vector<std::uint64_t>, std::size_t> places;  // in it
  std::size_t arcs = 0, used = 0;
  for (std::size_t n = 0; n < table.size(); ++n) {
    const std::map<ArcEnds, Heights>& column = found[n / size_y][n % size_y];
    if (column.empty()) continue;
    std::vector<CoveringArc> list;
    for (const auto& [ends, heights] : column) appendRuns(ends, heights, list);
    arcs += list.size();
    ++used;
    const std::int32_t dx = shape.low[0] + static_cast<std::int32_t>(n / size_y),
                       dy = shape.low[1] + static_cast<std::int32_t>(n % size_y);
    shape.reach_squared = std::max(shape.reach_squared, dx * dx + dy * dy);
    ArcsOfColumn& entry = table[n];
    entry.first = list[0];
    if (list.size() > 1) entry.second = list[1];
    if (list.size() <= 2) continue;
    // Many columns have the same ones.
    std::vector<std::uint64_t> key;
    for (std::size_t further = 2; further < list.size(); ++further) key.push_back(keyOf(list[further]));
    const auto [place, is_new] = places.try_emplace(std::move(key), more.size());
    if (is_new) more.insert(more.end(), list.begin() + 2, list.end());
    if (more.size() > std::size_t{std::numeric_limits<std::uint16_t>::max()} + 1) return;
    entry.more = static_cast<std::uint16_t>(place->second);
    entry.count = static_cast<std::uint16_t>(list.size() - 2);
  }
  if (static_cast<double>(arcs) > kMostArcsPerColumn * static_cast<double>(used)) return;
  if (more.empty()) more.emplace_back();
  shape_ = shape;
  table_ = std::move(table);
  more_ = std::move(more);
}

}  // namespace accessvdb::internal

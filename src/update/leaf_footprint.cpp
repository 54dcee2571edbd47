// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/leaf_footprint.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

#include "update/direction_masks.h"

namespace accessvdb::internal {
namespace {

/// Collects the leaf offsets that voxel offsets can fall into, one direction after another.
class FootprintBuilder {
 public:
  /// @param low, high  box of all voxel offsets that will be added, from the point's voxel
  /// @param last  points lie 0 .. last leaves farther along each axis than the first leaf
  FootprintBuilder(const Index3& low, const Index3& high, std::int32_t last) : last_(last) {
    std::size_t leaves = 1;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low_[axis] = low[axis] >> 3;
      size_[axis] = ((high[axis] + 7) >> 3) + last - low_[axis] + 1;
      leaves *= static_cast<std::size_t>(size_[axis]);
    }
    masks_.resize(leaves);
  }

  /// @param low, high  box of voxel offsets from the point's voxel
  void add(int d, const Index3& low, const Index3& high) {
    // The point may lie anywhere in its leaf: local coordinates 0 .. 7.
    for (std::int32_t x = low[0] >> 3; x <= (high[0] + 7) >> 3; ++x) {
      for (std::int32_t y = low[1] >> 3; y <= (high[1] + 7) >> 3; ++y) {
        DirectionMask* mask = masks_.data() + at(x, y, low[2] >> 3);
        for (std::int32_t z = low[2] >> 3; z <= (high[2] + 7) >> 3; ++z, ++mask) mask->set(d);
      }
    }
  }

  /// Allows for the points' other leaves.
  void spread() {
    for (std::size_t axis = 0; axis < 3; ++axis) spreadMasks(masks_, size_, axis, last_);
  }

  /// Calls visit(x, y, masks) for each horizontal offset; masks from the lowest leaf up, lowZ() on.
  template <typename Visit>
  void forEachStack(const Visit& visit) const {
    for (std::int32_t x = 0; x < size_[0]; ++x) {
      for (std::int32_t y = 0; y < size_[1]; ++y) {
        const std::size_t first = at(x + low_[0], y + low_[1], low_[2]);
        visit(x + low_[0], y + low_[1], std::span(masks_).subspan(first, static_cast<std::size_t>(size_[2])));
      }
    }
  }
  [[nodiscard]] std::int32_t lowZ() const { return low_[2]; }

 private:
  [[nodiscard]] std::size_t at(std::int32_t x, std::int32_t y, std::int32_t z) const {
    return (static_cast<std::size_t>(x - low_[0]) * static_cast<std::size_t>(size_[1]) +
            static_cast<std::size_t>(y - low_[1])) *
               static_cast<std::size_t>(size_[2]) +
           static_cast<std::size_t>(z - low_[2]);
  }

  Index3 low_ = {}, size_ = {};
  std::int32_t last_;
  std::vector<DirectionMask> masks_;  ///< [x][y][z]
};

/// A box that grows.
struct OffsetsBox {
  Index3 low = {0, 0, 0}, high = {0, 0, 0};
  void add(const Index3& from, const Index3& to) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], from[axis]);
      high[axis] = std::max(high[axis], to[axis]);
    }
  }
};

/// Rounding of float32 positions far from the origin, in voxels; ScanGate admits coordinates up to where it is 0.16.
constexpr double kRounding = 0.25;

/// Voxel offsets that an offset in metres can lead to: both ends are rounded independently.
std::pair<Index3, Index3> offsetBox(const float* offset_m, double voxel_size_m) {
  Index3 low, high;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double voxels = static_cast<double>(offset_m[axis]) / voxel_size_m;
    low[axis] = static_cast<std::int32_t>(std::floor(voxels - kRounding));
    high[axis] = static_cast<std::int32_t>(std::ceil(voxels + kRounding));
  }
  return {low, high};
}

}  // namespace

LeafFootprint::LeafFootprint(const kernels::ToolKernelView& tool, const kernels::ApproachView& approach,
                             double voxel_size_m, int group_log2) {
  const auto forEachOfTool = [&](const auto& visit) {
    for (int d = 0; d < approach.num_directions; ++d) {
      // All parts of a direction: the union of its rolls.
      const int first = d * tool.parts, end = first + tool.parts;
      if (tool.use_samples) {
        for (std::uint32_t n = tool.sample_begin[first]; n < tool.sample_begin[end]; ++n) {
          const auto [low, high] = offsetBox(tool.samples + 3 * static_cast<std::size_t>(n), voxel_size_m);
          visit(d, low, high);
        }
      } else {
        for (std::uint32_t n = tool.column_begin[first]; n < tool.column_begin[end]; ++n) {
          const kernels::VoxelColumn& c = tool.columns[n];
          const std::int32_t top = c.dz + 63 - std::countl_zero(c.bits);
          visit(d, Index3{c.dx, c.dy, c.dz}, Index3{c.dx, c.dy, top});
        }
      }
    }
  };
  const auto forEachOfArm = [&](const auto& visit) {
    for (int d = 0; d < approach.num_directions; ++d) {
      for (int n = 0; n < approach.num_arm; ++n) {
        const float* offset = approach.arm_offsets + 3 * (static_cast<std::ptrdiff_t>(d) * approach.num_arm + n);
        const auto [low, high] = offsetBox(offset, voxel_size_m);
        visit(d, low, high);
      }
    }
  };
  const bool by_leaf = approach.axes_xyz != nullptr, wide = kernels::isWide(approach.num_directions);
  const auto make = [&](const auto& forEach, Stacks& part) {
    OffsetsBox box;
    forEach([&](int, const Index3& low, const Index3& high) { box.add(low, high); });
    FootprintBuilder builder(box.low, box.high, (1 << group_log2) - 1);
    forEach([&](int d, const Index3& low, const Index3& high) { builder.add(wide ? 0 : d, low, high); });
    builder.spread();
    builder.forEachStack([&](std::int32_t x, std::int32_t y, std::span<const DirectionMask> masks) {
      std::size_t begin = 0, end = masks.size();
      while (end > 0 && !any(masks[end - 1])) --end;
      while (begin < end && !any(masks[begin])) ++begin;
      if (begin == end) return;
      const auto first = static_cast<std::uint32_t>(part.columns.size());
      const std::int32_t z_low = builder.lowZ() + static_cast<std::int32_t>(begin),
                         z_high = builder.lowZ() + static_cast<std::int32_t>(end) - 1;
      if (wide) {  // one direction stands for all: leaves that follow each other are one column
        for (std::size_t n = begin; n < end;) {
          const std::size_t run = n;
          while (n < end && any(masks[n])) ++n;
          part.columns.push_back({x, y, builder.lowZ() + static_cast<std::int32_t>(run),
                                  builder.lowZ() + static_cast<std::int32_t>(n) - 1, masks[run]});
          while (n < end && !any(masks[n])) ++n;
        }
      } else if (by_leaf) {
        for (std::int32_t z = z_low; z <= z_high; ++z) {
          part.columns.push_back({x, y, z, z, masks[static_cast<std::size_t>(z - builder.lowZ())]});
        }
      } else {
        DirectionMask all = {};
        for (std::size_t n = begin; n < end; ++n) all = all | masks[n];
        part.columns.push_back({x, y, z_low, z_high, all});
      }
      part.stacks.push_back({first, static_cast<std::uint32_t>(part.columns.size())});
    });
  };
  make(forEachOfTool, tool_);
  make(forEachOfArm, arm_);
  for (const Stacks* part : {&tool_, &arm_}) {
    for (const kernels::FootprintColumn& column : part->columns) {
      low_ = {std::min(low_[0], column.dx), std::min(low_[1], column.dy), std::min(low_[2], column.z_low)};
      high_ = {std::max(high_[0], column.dx), std::max(high_[1], column.dy), std::max(high_[2], column.z_high)};
    }
  }
}

AffectedDirections LeafFootprint::affected(const Index3& block_leaf, const FlipColumns& flips) const {
  AffectedDirections affected = {};
  const auto scan = [&](const Stacks& part, FlipKind better_kind, FlipKind worse_kind, DirectionMask& better,
                        DirectionMask& worse) {
    for (const Stack& stack : part.stacks) {
      const kernels::FootprintColumn& lowest = part.columns[stack.begin];
      if (!flips.anyIn(block_leaf[0] + lowest.dx, block_leaf[1] + lowest.dy)) continue;
      for (std::uint32_t n = stack.begin; n < stack.end; ++n) {
        const kernels::FootprintColumn& column = part.columns[n];
        const std::uint8_t kinds = flips.kindsIn(block_leaf[0] + column.dx, block_leaf[1] + column.dy,
                                                 block_leaf[2] + column.z_low, block_leaf[2] + column.z_high);
        if (kinds == 0) continue;
        if ((kinds & bitOf(better_kind)) != 0) better = better | column.directions;
        if ((kinds & bitOf(worse_kind)) != 0) worse = worse | column.directions;
      }
    }
  };
  scan(tool_, FlipKind::CollidesOff, FlipKind::CollidesOn, affected.better_tool, affected.worse_tool);
  scan(arm_, FlipKind::ArmFreeOn, FlipKind::ArmFreeOff, affected.better_arm, affected.worse_arm);
  return affected;
}

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/leaf_footprint.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <map>
#include <utility>

namespace accessvdb::internal {
namespace {

/// Collects the leaf offsets that voxel offsets can fall into, one direction after another.
class FootprintBuilder {
 public:
  struct Range {
    std::int32_t z_low, z_high;
    DirectionMask directions = {};
  };

  /// @param low, high  box of voxel offsets from the point's voxel
  void add(int d, const Index3& low, const Index3& high) {
    // The point may lie anywhere in its leaf: local coordinates 0 .. 7.
    const std::int32_t z_low = low[2] >> 3, z_high = (high[2] + 7) >> 3;
    for (std::int32_t x = low[0] >> 3; x <= (high[0] + 7) >> 3; ++x) {
      for (std::int32_t y = low[1] >> 3; y <= (high[1] + 7) >> 3; ++y) {
        Range& range = ranges_.try_emplace({x, y}, Range{z_low, z_high, {}}).first->second;
        range.z_low = std::min(range.z_low, z_low);
        range.z_high = std::max(range.z_high, z_high);
        range.directions.set(d);
      }
    }
  }
  [[nodiscard]] const auto& ranges() const { return ranges_; }

  /// Allows for points 0 .. last leaves farther along each axis.
  void spread(std::int32_t last) {
    std::map<std::pair<std::int32_t, std::int32_t>, Range> spread;
    for (const auto& [xy, range] : ranges_) {
      for (std::int32_t x = xy.first; x <= xy.first + last; ++x) {
        for (std::int32_t y = xy.second; y <= xy.second + last; ++y) {
          Range& to = spread.try_emplace({x, y}, Range{range.z_low, range.z_high + last, {}}).first->second;
          to.z_low = std::min(to.z_low, range.z_low);
          to.z_high = std::max(to.z_high, range.z_high + last);
          to.directions = to.directions | range.directions;
        }
      }
    }
    ranges_ = std::move(spread);
  }

 private:
  std::map<std::pair<std::int32_t, std::int32_t>, Range> ranges_;
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
  FootprintBuilder tool_builder, arm_builder;
  for (int d = 0; d < approach.num_directions; ++d) {
    if (tool.use_samples) {
      for (std::uint32_t n = tool.sample_begin[d]; n < tool.sample_begin[d + 1]; ++n) {
        const auto [low, high] = offsetBox(tool.samples + 3 * static_cast<std::size_t>(n), voxel_size_m);
        tool_builder.add(d, low, high);
      }
    } else {
      for (std::uint32_t n = tool.column_begin[d]; n < tool.column_begin[d + 1]; ++n) {
        const kernels::VoxelColumn& c = tool.columns[n];
        const std::int32_t top = c.dz + 63 - std::countl_zero(c.bits);
        tool_builder.add(d, {c.dx, c.dy, c.dz}, {c.dx, c.dy, top});
      }
    }
    for (int n = 0; n < approach.num_arm; ++n) {
      const float* offset = approach.arm_offsets + 3 * (static_cast<std::ptrdiff_t>(d) * approach.num_arm + n);
      const auto [low, high] = offsetBox(offset, voxel_size_m);
      arm_builder.add(d, low, high);
    }
  }
  for (FootprintBuilder* builder : {&tool_builder, &arm_builder}) builder->spread((1 << group_log2) - 1);
  const auto collect = [](const FootprintBuilder& builder, Columns& columns) {
    for (const auto& [xy, range] : builder.ranges()) {
      columns.push_back({xy.first, xy.second, range.z_low, range.z_high, range.directions});
    }
  };
  collect(tool_builder, tool_columns_);
  collect(arm_builder, arm_columns_);
  for (const Columns* columns : {&tool_columns_, &arm_columns_}) {
    for (const kernels::FootprintColumn& column : *columns) {
      low_ = {std::min(low_[0], column.dx), std::min(low_[1], column.dy), std::min(low_[2], column.z_low)};
      high_ = {std::max(high_[0], column.dx), std::max(high_[1], column.dy), std::max(high_[2], column.z_high)};
    }
  }
}

AffectedDirections LeafFootprint::affected(const Index3& block_leaf, const FlipColumns& flips) const {
  AffectedDirections affected = {};
  const auto scan = [&](const Columns& columns, FlipKind better_kind, FlipKind worse_kind, DirectionMask& better,
                        DirectionMask& worse) {
    for (const kernels::FootprintColumn& column : columns) {
      const std::uint8_t kinds = flips.kindsIn(block_leaf[0] + column.dx, block_leaf[1] + column.dy,
                                               block_leaf[2] + column.z_low, block_leaf[2] + column.z_high);
      if (kinds == 0) continue;
      if ((kinds & bitOf(better_kind)) != 0) better = better | column.directions;
      if ((kinds & bitOf(worse_kind)) != 0) worse = worse | column.directions;
    }
  };
  scan(tool_columns_, FlipKind::CollidesOff, FlipKind::CollidesOn, affected.better_tool, affected.worse_tool);
  scan(arm_columns_, FlipKind::ArmFreeOn, FlipKind::ArmFreeOff, affected.better_arm, affected.worse_arm);
  return affected;
}

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cpu/map_window.h"

#include <algorithm>
#include <bit>

namespace accessvdb::kernels {

MapWindow::MapWindow(const WindowedTool& tool, const WindowKernels& kernels)
    : tool_(tool), kernels_(kernels), shape_(tool.shape()) {
  const std::size_t words = shape_.columnsOfVoxels() * static_cast<std::size_t>(shape_.words() + 1);
  for (std::vector<std::uint64_t>& bits : bits_) bits.assign(words, 0);
  filled_.assign(shape_.columnsOfLeaves(), 0);
  ready_words_ = static_cast<std::size_t>(tool.parts() + 63) / 64;
  ready_.assign((std::size_t{1} << (2 * shape_.xy_log2)) * ready_words_, 0);
  const WindowedTool::LeafBox& box = tool_.corridorLeaves();
  samples_.stride = static_cast<std::uint32_t>(shape_.stride());
  samples_.size_x = static_cast<std::uint32_t>(box.high_x - box.low_x + 1) * 8;
  samples_.size_y = static_cast<std::uint32_t>(box.high_y - box.low_y + 1) * 8;
}

void MapWindow::moveTo(const OccupancyReader& map, const Coord& leaf) {
  map_ = &map;
  corridors_filled_ = false;
  const int log2[3] = {shape_.xy_log2, shape_.xy_log2, shape_.z_log2};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::int32_t first = leaf[static_cast<std::int32_t>(axis)] >> log2[axis] << log2[axis];
    low_[axis] = (first + shape_.low[axis]) * 8;
  }
  samples_.low_x = low_[0] + tool_.corridorLeaves().low_x * 8;
  samples_.low_y = low_[1] + tool_.corridorLeaves().low_y * 8;
  std::ranges::fill(filled_, std::uint8_t{0});
  std::ranges::fill(ready_, std::uint64_t{0});
}

void MapWindow::standAt(const float* position_L, const Coord& point_ijk, float inverse_voxel_size) {
  position_L_ = position_L;
  const std::int32_t x = point_ijk[0] - low_[0], y = point_ijk[1] - low_[1];
  height_ = point_ijk[2] - low_[2];
  column_ = static_cast<std::size_t>(x) * shape_.stride() + static_cast<std::size_t>(y);
  leaf_column_ = (x >> 3) * shape_.size[1] + (y >> 3);
  const std::int32_t last = (1 << shape_.xy_log2) - 1;
  const auto in_window = static_cast<std::size_t>((((x >> 3) + shape_.low[0]) & last) << shape_.xy_log2 |
                                                  (((y >> 3) + shape_.low[1]) & last));
  own_ready_ = ready_.data() + in_window * ready_words_;
  const WindowedTool::LeafBox& box = tool_.corridorLeaves();
  samples_.words = bits_[kArmFree].data() + static_cast<std::size_t>(height_ >> 6) * shape_.columnsOfVoxels() +
                   static_cast<std::size_t>(box.low_x) * 8 * shape_.stride() + static_cast<std::size_t>(box.low_y) * 8;
  samples_.bit = static_cast<unsigned>(height_) & 63;
  samples_.x_m = position_L[0], samples_.y_m = position_L[1];
  samples_.inverse_voxel_size = inverse_voxel_size;
}

/// Copies a column of leaves.
void MapWindow::fill(Fact fact, std::size_t column) {
  const auto x = static_cast<std::int32_t>(column / static_cast<std::size_t>(shape_.size[1]));
  const auto y = static_cast<std::int32_t>(column % static_cast<std::size_t>(shape_.size[1]));
  std::uint64_t* to =
      bits_[fact].data() + (static_cast<std::size_t>(x) * shape_.stride() + static_cast<std::size_t>(y)) * 8;
  for (std::int32_t z = 0; z < shape_.size[2]; z += 8, to += shape_.columnsOfVoxels()) {
    const std::uint64_t* leaves[8];
    const int count = std::min(8, shape_.size[2] - z);
    for (int n = 0; n < count; ++n) {
      const OccupancyLeaf* leaf = map_->leafAt(Coord(low_[0] + 8 * x, low_[1] + 8 * y, low_[2] + 8 * (z + n)));
      leaves[n] = leaf == nullptr     ? nullptr
                  : fact == kCollides ? reinterpret_cast<const std::uint64_t*>(&leaf->data()->mValues)
                                      : reinterpret_cast<const std::uint64_t*>(&leaf->data()->mValueMask);
    }
    kernels_.stack(leaves, count, to, shape_.stride());
  }
  filled_[column] = static_cast<std::uint8_t>(filled_[column] | 1u << fact);
}

bool MapWindow::test(Fact fact, const Coord& ijk) {
  std::uint32_t at[3];
  for (std::size_t axis = 0; axis < 3; ++axis) {
    at[axis] = static_cast<std::uint32_t>(ijk[static_cast<std::int32_t>(axis)] - low_[axis]);
    if (at[axis] >= static_cast<std::uint32_t>(shape_.size[axis]) * 8) {
      return fact == kCollides ? map_->collides(ijk) : map_->armFree(ijk);
    }
  }
  const std::size_t column = (at[0] >> 3) * static_cast<std::size_t>(shape_.size[1]) + (at[1] >> 3);
  if ((filled_[column] >> fact & 1u) == 0) fill(fact, column);
  const std::size_t word = (at[2] >> 6) * shape_.columnsOfVoxels() + at[0] * shape_.stride() + at[1];
  return (bits_[fact][word] >> (at[2] & 63) & 1u) != 0;
}

void MapWindow::fillCorridors() {
  const WindowedTool::LeafBox& box = tool_.corridorLeaves();
  for (std::int32_t x = box.low_x; x <= box.high_x; ++x) {
    for (std::int32_t y = box.low_y; y <= box.high_y; ++y) {
      const auto column = static_cast<std::size_t>(x * shape_.size[1] + y);
      if ((filled_[column] >> kArmFree & 1u) == 0) fill(kArmFree, column);
    }
  }
  corridors_filled_ = true;
}

ArmResult MapWindow::testArm(const ApproachView& approach, int d) {
  const std::span<const FlatSamples> corridor = tool_.corridor(d);
  if (corridor.empty()) return testEach(approach, d);
  if (!corridors_filled_) fillCorridors();
  int first = 0;
  for (const FlatSamples& samples : corridor) {
    const int left = approach.num_arm - first;
    const unsigned wanted = left < FlatSamples::kLanes ? (1u << left) - 1 : (1u << FlatSamples::kLanes) - 1;
    const SampleBits found = kernels_.look_up(samples_, samples);
    const unsigned blocked = wanted & ~(found.inside & found.set);
    if (blocked != 0) {
      const int n = std::countr_zero(blocked);
      if ((found.inside >> n & 1u) == 0) return testEach(approach, d);
      const Coord ijk = voxelOf(position_L_[0] + samples.x[n], position_L_[1] + samples.y[n], position_L_[2] + 0.0f,
                                samples_.inverse_voxel_size);
      return {first + n, test(kCollides, ijk) ? PointReason::Arm : PointReason::Unknown};
    }
    first += FlatSamples::kLanes;
  }
  return {approach.num_arm, PointReason::None};
}

/// One sample after the other.
ArmResult MapWindow::testEach(const ApproachView& approach, int d) {
  return kernels::testArm(Facts{*this}, approach, d, position_L_, samples_.inverse_voxel_size);
}

/// Copies what a part of the tool may read from the point's leaf.
void MapWindow::fillFor(int part) {
  std::uint64_t& ready = own_ready_[part >> 6];
  const std::uint64_t bit = std::uint64_t{1} << (part & 63);
  if ((ready & bit) != 0) return;
  ready |= bit;
  for (const std::int32_t offset : tool_.leaves(part)) {
    const auto column = static_cast<std::size_t>(leaf_column_ + offset);
    if ((filled_[column] >> kCollides & 1u) == 0) fill(kCollides, column);
  }
}

int MapWindow::countVoxels(int part, int stop_above) {
  fillFor(part);
  const std::size_t plane = shape_.columnsOfVoxels();
  const std::uint64_t* column = bits_[kCollides].data() + column_;
  const bool single = shape_.words() == 1;
  int count = 0;
  for (const WindowedTool::Layer& layer : tool_.layers(part)) {
    const auto z = static_cast<std::uint32_t>(height_ + layer.dz);
    const std::uint64_t* const map = column + (z >> 6) * plane;
    const WindowRun *const begin = tool_.runs() + layer.begin, *const end = tool_.runs() + layer.end;
    const int left = stop_above - count;
    count += single ? kernels_.count(begin, end, tool_.words(), map, z & 63, left)
                    : kernels_.count_two(begin, end, tool_.words(), map, map + plane, z & 63, left);
    if (count > stop_above) return count;
  }
  return count;
}

int MapWindow::countSamples(const ToolKernelView& tool, int part, int stop_above) {
  return countSampleCollisions(Facts{*this}, tool, part, position_L_, samples_.inverse_voxel_size, stop_above);
}

}  // namespace accessvdb::kernels

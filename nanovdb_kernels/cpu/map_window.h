// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The two facts of the voxels around a group of points, as columns of 64-bit words: bit z of word (x, y). The points
/// of the group share it, so the map's tree is walked once per leaf instead of once per row of voxels and direction.
/// Leaves are copied when they are first needed.
#pragma once

#include <cstdint>
#include <vector>

#include "cpu/windowed_tool.h"
#include "hostdev/direction_score.h"

namespace accessvdb::kernels {

/// Scratch memory of one thread.
class MapWindow {
 public:
  /// @param tool  must outlive this
  explicit MapWindow(const WindowedTool& tool, const WindowKernels& kernels = windowKernels());

  /// Moves to another group or another state of the map, of which nothing is copied yet.
  /// @param map  must outlive the window's use  @param leaf  any leaf of the group, voxel index >> 3
  void moveTo(const OccupancyReader& map, const Coord& leaf);

  /// Corridor of direction d, as testArm.
  [[nodiscard]] ArmResult testArm(const ApproachView& approach, int d, const float* position_L,
                                  float inverse_voxel_size);
  /// As countVoxelCollisions. @param point_ijk  in the group
  [[nodiscard]] int countVoxels(int part, const Coord& point_ijk, int stop_above);
  /// As countSampleCollisions. @param position_L  in the group
  [[nodiscard]] int countSamples(const ToolKernelView& tool, int part, const float* position_L,
                                 float inverse_voxel_size, int stop_above);

 private:
  enum Fact : std::uint8_t { kCollides, kArmFree };

  [[nodiscard]] bool test(Fact fact, const Coord& ijk);
  void fill(Fact fact, std::size_t column);
  void fillCorridors();
  [[nodiscard]] ArmResult testEach(const ApproachView& approach, int d, const float* position_L,
                                   float inverse_voxel_size);
  void fillFor(int part, const Coord& point_ijk);

  const WindowedTool& tool_;
  const WindowKernels& kernels_;
  const WindowShape shape_;
  const OccupancyReader* map_ = nullptr;
  bool corridors_filled_ = false;
  std::int32_t low_[3] = {0, 0, 0};     ///< lowest voxel
  std::vector<std::uint64_t> bits_[2];  ///< by fact: [words][x][y]
  std::vector<std::uint8_t> filled_;    ///< [x][y] of leaves: bit per fact
  std::size_t ready_words_ = 0;         ///< per leaf of a group
  std::vector<std::uint64_t> ready_;    ///< [x][y of the leaf in its group] parts whose leaves are filled
};

}  // namespace accessvdb::kernels

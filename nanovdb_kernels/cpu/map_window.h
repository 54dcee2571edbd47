// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The two facts of the voxels around adjacent points, as columns of 64-bit words: bit z of word (x, y). The points
/// share it, so the map's tree is walked once per leaf instead of once per row of voxels and direction.
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

  /// Moves to other points or another state of the map, of which nothing is copied yet.
  /// @param map  must outlive the window's use  @param leaf  any of their leaves, voxel index >> 3
  void moveTo(const OccupancyReader& map, const Coord& leaf);
  /// All later calls are about this point, which is one of them. Call it again after moveTo().
  /// @param position_L  must stay valid until the next call  @param point_ijk  its voxel
  void standAt(const float* position_L, const Coord& point_ijk, float inverse_voxel_size);

  /// Corridor of direction d, as testArm.
  [[nodiscard]] ArmResult testArm(const ApproachView& approach, int d);
  /// As countVoxelCollisions.
  [[nodiscard]] int countVoxels(int part, int stop_above);
  /// As countSampleCollisions.
  [[nodiscard]] int countSamples(const ToolKernelView& tool, int part, int stop_above);

 private:
  enum Fact : std::uint8_t { kCollides, kArmFree };
  /// The map through the window, for the rules in hostdev.
  struct Facts {
    MapWindow& window;
    [[nodiscard]] bool collides(const Coord& ijk) const { return window.test(kCollides, ijk); }
    [[nodiscard]] bool armFree(const Coord& ijk) const { return window.test(kArmFree, ijk); }
  };

  [[nodiscard]] bool test(Fact fact, const Coord& ijk);
  void fill(Fact fact, std::size_t column);
  void fillCorridors();
  [[nodiscard]] ArmResult testEach(const ApproachView& approach, int d);
  void fillFor(int part);

  const WindowedTool& tool_;
  const WindowKernels& kernels_;
  const WindowBox shape_;
  const OccupancyReader* map_ = nullptr;
  bool corridors_filled_ = false;
  std::int32_t low_[3] = {0, 0, 0};     ///< lowest voxel
  std::vector<std::uint64_t> bits_[2];  ///< by fact: [words][x][y]
  std::vector<std::uint8_t> filled_;    ///< [x][y] of leaves: bit per fact
  std::size_t ready_words_ = 0;         ///< per inner leaf
  std::vector<std::uint64_t> ready_;    ///< [x][y of the inner leaf] parts whose leaves are filled
  // Of the current point.
  const float* position_L_ = nullptr;
  std::int32_t height_ = 0;             ///< voxels above the window's lowest
  std::size_t column_ = 0;              ///< index of its column of voxels
  std::int32_t leaf_column_ = 0;        ///< index of its column of leaves
  std::uint64_t* own_ready_ = nullptr;  ///< the words of its leaf in ready_
  SampleWindow samples_ = {};           ///< where its corridors are looked up
};

}  // namespace accessvdb::kernels

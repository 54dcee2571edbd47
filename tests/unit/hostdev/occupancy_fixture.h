// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A small map given voxel by voxel, as the rules see it and for the test's own loops.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <random>
#include <set>
#include <vector>

#include "cpu/host_arena.h"
#include "hostdev/direction_search.h"
#include "mirror/nanovdb_mirror.h"

namespace accessvdb::test {

using Voxel = std::array<std::int32_t, 3>;

class OccupancyFixture {
 public:
  explicit OccupancyFixture(double voxel_size_m = 1.0)
      : mirror_(std::make_unique<kernels::HostArena>(), voxel_size_m), inverse_(static_cast<float>(1 / voxel_size_m)) {}

  void collide(const Voxel& voxel) {
    if (colliding_.insert(voxel).second) set(change(voxel).collides_on, voxel);
  }
  void freeArm(const Voxel& voxel) {
    if (free_.insert(voxel).second) set(change(voxel).arm_free_on, voxel);
  }
  void blockArm(const Voxel& voxel) {
    if (free_.erase(voxel) != 0) set(change(voxel).arm_free_off, voxel);
  }
  /// Frees all voxels of an inclusive box.
  void freeArm(const Voxel& low, const Voxel& high) {
    for (std::int32_t x = low[0]; x <= high[0]; ++x)
      for (std::int32_t y = low[1]; y <= high[1]; ++y)
        for (std::int32_t z = low[2]; z <= high[2]; ++z) freeArm({x, y, z});
  }
  [[nodiscard]] bool collides(const Voxel& voxel) const { return colliding_.contains(voxel); }
  [[nodiscard]] bool armFree(const Voxel& voxel) const { return free_.contains(voxel); }

  /// Sends what was set to the mirror. Earlier readers become invalid.
  [[nodiscard]] kernels::OccupancyView view() {
    std::vector<LeafChange> changes;
    for (const auto& [origin, leaf_change] : pending_) changes.push_back(leaf_change);
    mirror_.apply(changes);
    pending_.clear();
    return {mirror_.grid(), inverse_};
  }
  [[nodiscard]] kernels::OccupancyReader reader() { return kernels::OccupancyReader(view()); }
  [[nodiscard]] float inverseVoxelSize() const { return inverse_; }

 private:
  LeafChange& change(const Voxel& v) {
    const std::array<std::int32_t, 3> origin = {v[0] & ~7, v[1] & ~7, v[2] & ~7};
    LeafChange& leaf_change = pending_[origin];
    leaf_change.origin_ijk = origin;
    return leaf_change;
  }
  static void set(LeafBits& bits, const Voxel& v) {
    bits[static_cast<std::size_t>(v[0] & 7)] |= std::uint64_t{1} << ((v[1] & 7) * 8 + (v[2] & 7));
  }

  internal::NanoVdbMirror mirror_;
  float inverse_;
  std::set<Voxel> colliding_, free_;
  std::map<std::array<std::int32_t, 3>, LeafChange> pending_;
};

/// Directions at equal yaw steps, straight from cos and sin; corridor samples at the given distances.
struct ApproachFixture {
  std::vector<float> xy, axes, offsets;
  kernels::ApproachView view;

  ApproachFixture(int num_directions, const std::vector<double>& arm_distances_m,
                  double cone_rad = 1.2217304763960306) {
    for (int d = 0; d < num_directions; ++d) {
      const double yaw = 2 * 3.141592653589793 * d / num_directions;
      xy.push_back(static_cast<float>(std::cos(yaw)));
      xy.push_back(static_cast<float>(std::sin(yaw)));
      for (const double distance : arm_distances_m) {
        offsets.push_back(static_cast<float>(distance * std::cos(yaw)));
        offsets.push_back(static_cast<float>(distance * std::sin(yaw)));
        offsets.push_back(0);
      }
    }
    view.direction_xy = xy.data();
    view.arm_offsets = offsets.data();
    view.num_directions = num_directions;
    view.num_arm = static_cast<int>(arm_distances_m.size());
    view.normal_cos_min = static_cast<float>(std::cos(cone_rad));
  }
  /// Directions all over the sphere in place of the yaws: no two alike, some level, some vertical.
  void scatter(std::mt19937_64& random, const std::vector<double>& arm_distances_m) {
    axes.clear();
    offsets.clear();
    for (int d = 0; d < view.num_directions; ++d) {
      const auto part = [&] { return 2 * static_cast<double>(random() >> 11) * 0x1.0p-53 - 1; };
      double axis[3] = {part(), part(), d % 5 == 0 ? 0.0 : part()};
      if (d % 11 == 0) axis[0] = axis[1] = 0, axis[2] = d % 2 == 0 ? 1 : -1;
      const double length = std::sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
      for (const double x : axis) axes.push_back(static_cast<float>(x / length));
      for (const double distance : arm_distances_m) {
        for (const double x : axis) offsets.push_back(static_cast<float>(distance * x / length));
      }
    }
    view.direction_xy = nullptr;
    view.axes_xyz = axes.data();
    view.arm_offsets = offsets.data();
  }
  ApproachFixture(const ApproachFixture&) = delete;
  ApproachFixture& operator=(const ApproachFixture&) = delete;
};

/// A tool given as columns of each direction.
struct ToolFixture {
  std::vector<kernels::VoxelColumn> columns;
  std::vector<std::uint32_t> begin = {0};

  void endDirection() { begin.push_back(static_cast<std::uint32_t>(columns.size())); }
  [[nodiscard]] kernels::ToolKernelView view(int collision_limit) const {
    kernels::ToolKernelView tool;
    tool.columns = columns.data();
    tool.column_begin = begin.data();
    tool.collision_limit = static_cast<std::uint16_t>(collision_limit);
    return tool;
  }
  /// Voxel offsets of a direction, bit by bit.
  [[nodiscard]] std::vector<Voxel> voxels(int d) const {
    std::vector<Voxel> out;
    for (std::uint32_t n = begin[static_cast<std::size_t>(d)]; n < begin[static_cast<std::size_t>(d) + 1]; ++n) {
      for (int bit = 0; bit < 64; ++bit) {
        if ((columns[n].bits >> bit & 1) != 0) out.push_back({columns[n].dx, columns[n].dy, columns[n].dz + bit});
      }
    }
    return out;
  }
};

inline kernels::VoxelColumn column(int dx, int dy, int dz, std::uint64_t bits) {
  return {static_cast<std::int16_t>(dx), static_cast<std::int16_t>(dy), static_cast<std::int16_t>(dz), 0, bits};
}

inline double between(std::mt19937_64& random, double low, double high) {
  return low + (high - low) * static_cast<double>(random() >> 11) * 0x1.0p-53;
}
inline int below(std::mt19937_64& random, int n) { return static_cast<int>(random() % static_cast<std::uint64_t>(n)); }

}  // namespace accessvdb::test

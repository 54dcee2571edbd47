// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A map of distances that changes at random, as reported to the mirror, and the same map as an OpenVDB grid changed
/// voxel by voxel.
#pragma once

#include <array>
#include <map>
#include <vector>

#include "accessvdb/distance_change.h"
#include "mirror/distance_leaves.h"
#include "parity/mirror_checks.h"
#include "vdb/standard_grids.h"

namespace accessvdb::testing {

class DistanceWorld {
 public:
  static constexpr float kBackground_m = 0.375f;

  explicit DistanceWorld(std::uint64_t seed) : maker_(seed) { openvdb::initialize(); }

  /// All distances are whole numbers of steps of a power of two: exact, however they are computed.
  static internal::DistanceLeaves leaves() { return {{-0.5f, 1.0f / (1 << 21), 12}, kBackground_m}; }

  /// Observes voxels in some rows of a leaf, for the first time or again. Other voxels in the same rows stay
  /// unobserved, and occasionally whole rows do.
  DistanceChange change(const std::array<std::int32_t, 3>& origin_ijk) {
    std::array<std::uint32_t, 512>& packed = map_[origin_ijk];
    auto voxels = grid_->getAccessor();
    DistanceChange change = {origin_ijk, 0, packed.data()};
    const std::uint64_t share = maker_.below(3);
    for (std::uint32_t pair = 0; pair < 32; ++pair) {
      if (maker_.below(3) < share) continue;
      change.row_pairs |= 1u << pair;
      for (std::uint32_t n = 16 * pair; n < 16 * pair + 16; ++n) {
        if (maker_.below(5) < 2) continue;
        const auto mean = static_cast<std::uint32_t>(maker_.below(1 << 20));
        packed[n] = mean << 12 | static_cast<std::uint32_t>(1 + maker_.below(4095));
        voxels.setValueOn(
            openvdb::Coord(origin_ijk[0] + static_cast<int>(n >> 6), origin_ijk[1] + static_cast<int>(n >> 3 & 7),
                           origin_ijk[2] + static_cast<int>(n & 7)),
            -0.5f + static_cast<float>(mean) / (1 << 21));
      }
    }
    return change;
  }
  std::vector<DistanceChange> batch(std::size_t count) {
    std::vector<DistanceChange> changes;
    for (std::size_t n = 0; n < count; ++n) changes.push_back(change(maker_.origin()));
    return changes;
  }

  /// Every voxel of every leaf, then random ones, most of them background: acts on (ijk, value, active).
  template <class Act>
  void forEachVoxel(const Act& act) {
    auto reads = grid_->getConstAccessor();
    for (auto leaf = grid_->tree().cbeginLeaf(); leaf; ++leaf) {
      for (auto voxel = leaf->cbeginValueAll(); voxel; ++voxel) act(voxel.getCoord(), *voxel, voxel.isValueOn());
    }
    for (int n = 0; n < 20000; ++n) {
      const auto origin = maker_.origin();
      const auto near = [&](int c) { return c + static_cast<int>(maker_.below(300)) - 150; };
      const openvdb::Coord ijk(near(origin[0]), near(origin[1]), near(origin[2]));
      act(ijk, reads.getValue(ijk), reads.isValueOn(ijk));
    }
  }

  [[nodiscard]] const openvdb::FloatGrid& grid() const { return *grid_; }
  [[nodiscard]] ChangeMaker& maker() { return maker_; }

 private:
  ChangeMaker maker_;
  std::map<std::array<std::int32_t, 3>, std::array<std::uint32_t, 512>> map_;  ///< addresses are stable
  openvdb::FloatGrid::Ptr grid_ = openvdb::FloatGrid::create(kBackground_m);
};

}  // namespace accessvdb::testing

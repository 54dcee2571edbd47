// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Voxel coordinates and a dense map for the oracles.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

namespace accessvdb::test {

using VoxelCoord = std::array<std::int32_t, 3>;  ///< ijk; its value is at ijk * v

struct VoxelCoordHash {
  std::size_t operator()(const VoxelCoord& c) const {
    std::uint64_t h = 1469598103934665603ull;
    for (const std::int32_t x : c) h = (h ^ static_cast<std::uint32_t>(x)) * 1099511628211ull;
    return static_cast<std::size_t>(h ^ (h >> 29));
  }
};

/// What the map says about one voxel. The default is the state everywhere in an empty map.
struct MapVoxel {
  bool observed = false;
  float distance_m = 0;      ///< only where observed
  std::uint32_t weight = 0;  ///< observations
  bool cleared = false;
};

using MapLookup = std::function<MapVoxel(const VoxelCoord&)>;

/// Voxels of an inclusive box; outside it, the map is empty. Callable, so it serves as a MapLookup (std::ref).
class DenseMap {
 public:
  DenseMap(const VoxelCoord& min, const VoxelCoord& max) : min_(min) {
    std::size_t count = 1;
    for (std::size_t a = 0; a < 3; ++a) {
      size_[a] = static_cast<std::int64_t>(max[a]) - min[a] + 1;
      count *= static_cast<std::size_t>(size_[a]);
    }
    voxels_.resize(count);
  }
  /// A copy of another map inside the box.
  DenseMap(const VoxelCoord& min, const VoxelCoord& max, const MapLookup& source) : DenseMap(min, max) {
    for (std::int32_t i = min[0]; i <= max[0]; ++i)
      for (std::int32_t j = min[1]; j <= max[1]; ++j)
        for (std::int32_t k = min[2]; k <= max[2]; ++k) at({i, j, k}) = source({i, j, k});
  }

  [[nodiscard]] bool contains(const VoxelCoord& c) const {
    for (std::size_t a = 0; a < 3; ++a)
      if (c[a] < min_[a] || c[a] - static_cast<std::int64_t>(min_[a]) >= size_[a]) return false;
    return true;
  }
  /// @pre contains(c)
  [[nodiscard]] MapVoxel& at(const VoxelCoord& c) { return voxels_.at(index(c)); }
  [[nodiscard]] MapVoxel operator()(const VoxelCoord& c) const { return contains(c) ? voxels_[index(c)] : MapVoxel{}; }

 private:
  [[nodiscard]] std::size_t index(const VoxelCoord& c) const {
    return static_cast<std::size_t>(
        ((static_cast<std::int64_t>(c[0]) - min_[0]) * size_[1] + (static_cast<std::int64_t>(c[1]) - min_[1])) *
            size_[2] +
        (static_cast<std::int64_t>(c[2]) - min_[2]));
  }
  VoxelCoord min_;
  std::array<std::int64_t, 3> size_{};
  std::vector<MapVoxel> voxels_;
};

}  // namespace accessvdb::test

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/point_weights.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>

namespace accessvdb::internal {
namespace {

/// As PackedAccessor: inner nodes only.
using ConstAccessor = openvdb::tree::ValueAccessor2<const PackedTree, /*IsSafe=*/false, 1, 2>;
constexpr std::size_t kPointsPerTask = 1024;

openvdb::Coord coordOf(const PointStore& points, std::uint32_t id) {
  const Index3 voxel = points.voxelOf(points.first_L(id));
  return {voxel[0], voxel[1], voxel[2]};
}

std::uint32_t packedAt(ConstAccessor& map, const openvdb::Coord& ijk) {
  const PackedLeaf* leaf = map.probeConstLeaf(ijk);
  if (leaf == nullptr) return 0;
  const std::uint32_t* values = packedValues(*leaf);
  return values == nullptr ? 0 : values[PackedLeaf::coordToOffset(ijk)];
}

}  // namespace

MapReads makeMapReads(const PackedMap& map, const PointStore& points, bool neighbourhood_weight) {
  MapReads reads;
  const int reach = neighbourhood_weight ? 1 : 0;
  reads.weights = [&map, &points, reach](std::span<const std::uint32_t> ids, std::span<std::uint16_t> weights) {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, ids.size(), kPointsPerTask), [&](const auto& range) {
      ConstAccessor accessor(map.tree());
      for (std::size_t n = range.begin(); n != range.end(); ++n) {
        const openvdb::Coord centre = coordOf(points, ids[n]);
        std::uint32_t most = 0;
        for (int x = -reach; x <= reach; ++x) {
          for (int y = -reach; y <= reach; ++y) {
            for (int z = -reach; z <= reach; ++z) {
              most = std::max(most, weightOf(packedAt(accessor, centre.offsetBy(x, y, z))));
            }
          }
        }
        weights[n] = static_cast<std::uint16_t>(most);
      }
    });
  };
  reads.distances = [&map, &points](std::span<const std::uint32_t> ids, std::span<float> distances_m) {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, ids.size(), kPointsPerTask), [&](const auto& range) {
      ConstAccessor accessor(map.tree());
      for (std::size_t n = range.begin(); n != range.end(); ++n) {
        const std::uint32_t packed = packedAt(accessor, coordOf(points, ids[n]));
        distances_m[n] = weightOf(packed) > 0 ? map.distanceOf(meanOf(packed))
                                              : static_cast<float>(map.params().truncation_distance_m);
      }
    });
  };
  return reads;
}

}  // namespace accessvdb::internal

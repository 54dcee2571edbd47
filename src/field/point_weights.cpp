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

/// Largest weight of the (2 reach + 1)^3 voxels around one; each leaf that they lie in is looked up once.
std::uint32_t largestWeight(ConstAccessor& map, const openvdb::Coord& centre, int reach) {
  constexpr int kLast = PackedLeaf::DIM - 1;
  const openvdb::Coord low = centre.offsetBy(-reach), high = centre.offsetBy(reach);
  std::uint32_t most = 0;
  openvdb::Coord from, to;  // the part inside one leaf
  for (from.x() = low.x(); from.x() <= high.x(); from.x() = to.x() + 1) {
    to.x() = std::min(from.x() | kLast, high.x());
    for (from.y() = low.y(); from.y() <= high.y(); from.y() = to.y() + 1) {
      to.y() = std::min(from.y() | kLast, high.y());
      for (from.z() = low.z(); from.z() <= high.z(); from.z() = to.z() + 1) {
        to.z() = std::min(from.z() | kLast, high.z());
        const PackedLeaf* leaf = map.probeConstLeaf(from);
        const std::uint32_t* values = leaf == nullptr ? nullptr : packedValues(*leaf);
        if (values == nullptr) continue;
        for (int x = from.x(); x <= to.x(); ++x) {
          for (int y = from.y(); y <= to.y(); ++y) {
            const std::uint32_t* row = values + PackedLeaf::coordToOffset({x, y, from.z()});
            for (int z = 0; z <= to.z() - from.z(); ++z) most = std::max(most, weightOf(row[z]));
          }
        }
      }
    }
  }
  return most;
}

}  // namespace

MapReads makeMapReads(const PackedMap& map, const PointStore& points, bool neighbourhood_weight) {
  MapReads reads;
  const int reach = neighbourhood_weight ? 1 : 0;
  reads.weights = [&map, &points, reach](std::span<const std::uint32_t> ids, std::span<std::uint16_t> weights) {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, ids.size(), kPointsPerTask), [&](const auto& range) {
      ConstAccessor accessor(map.tree());
      for (std::size_t n = range.begin(); n != range.end(); ++n) {
        weights[n] = static_cast<std::uint16_t>(largestWeight(accessor, coordOf(points, ids[n]), reach));
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

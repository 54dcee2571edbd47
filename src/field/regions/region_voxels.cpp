// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/regions/region_voxels.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

#include "accessvdb/error.h"
#include "hostdev/position_voxel.h"
#include "tool/voxelize.h"
#include "tsdf/leaf_facts.h"

namespace accessvdb::internal {
namespace {

/// A box of voxels, inclusive.
struct IndexBox {
  Index3 low, high;
  [[nodiscard]] bool empty() const { return low[0] > high[0] || low[1] > high[1] || low[2] > high[2]; }
};

/// Coordinates of a map lie within +-10^6 voxels (ScanGate).
std::int32_t clamped(double voxels) { return static_cast<std::int32_t>(std::clamp(voxels, -2e6, 2e6)); }

/// Voxels whose centres lie between two corners, faces included: within rounding of one is on it.
IndexBox boxBetween(const Eigen::Vector3d& min_W, const Eigen::Vector3d& max_W, const RegionPlace& place) {
  const double v = place.map.params().voxel_size_m;
  IndexBox box;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<Eigen::Index>(axis);
    const double low = (min_W[a] - place.origin_W[a]) / v, high = (max_W[a] - place.origin_W[a]) / v;
    box.low[axis] = clamped(std::ceil(low - kernels::roundingAtFaces(low, 1 / v)));
    box.high[axis] = clamped(std::floor(high + kernels::roundingAtFaces(high, 1 / v)));
  }
  return box;
}

/// Calls visit(leaf) for each leaf of the map in a box, in ascending order.
template <typename Visit>
void forEachLeaf(const PackedMap& map, const IndexBox& box, const Visit& visit) {
  if (box.empty()) return;
  double places = 1;
  for (std::size_t axis = 0; axis < 3; ++axis) places *= (box.high[axis] >> 3) - (box.low[axis] >> 3) + 1;
  if (places > static_cast<double>(map.leaf_count)) {
    std::vector<const PackedLeaf*> leaves;
    map.tree().getNodes(leaves);
    std::erase_if(leaves, [&box](const PackedLeaf* leaf) {
      for (int axis = 0; axis < 3; ++axis) {
        const std::int32_t first = leaf->origin()[axis];
        const auto a = static_cast<std::size_t>(axis);
        if (first > box.high[a] || first + 7 < box.low[a]) return true;
      }
      return false;
    });
    std::sort(leaves.begin(), leaves.end(),
              [](const PackedLeaf* a, const PackedLeaf* b) { return a->origin() < b->origin(); });
    for (const PackedLeaf* leaf : leaves) visit(*leaf);
    return;
  }
  for (std::int32_t x = box.low[0] & ~7; x <= box.high[0]; x += 8) {
    for (std::int32_t y = box.low[1] & ~7; y <= box.high[1]; y += 8) {
      for (std::int32_t z = box.low[2] & ~7; z <= box.high[2]; z += 8) {
        if (const PackedLeaf* leaf = map.tree().probeConstLeaf({x, y, z})) visit(*leaf);
      }
    }
  }
}

void addIfAny(VoxelSet& voxels, const openvdb::Coord& origin, const LeafBits& bits) {
  std::uint64_t any = 0;
  for (const std::uint64_t word : bits) any |= word;
  if (any != 0) voxels.push_back({origin, bits});
}

/// Voxels of a leaf that lie in a box.
LeafBits bitsOfBox(const openvdb::Coord& origin, const IndexBox& box) {
  const auto span = [&](int axis) {
    const auto a = static_cast<std::size_t>(axis);
    return std::pair(std::max(0, box.low[a] - origin[axis]), std::min(7, box.high[a] - origin[axis]));
  };
  const auto [x0, x1] = span(0);
  const auto [y0, y1] = span(1);
  const auto [z0, z1] = span(2);
  LeafBits bits = {};
  if (x0 > x1 || y0 > y1 || z0 > z1) return bits;
  const std::uint64_t row = (0xffu << z0) & (0xffu >> (7 - z1));
  for (int x = x0; x <= x1; ++x) {
    for (int y = y0; y <= y1; ++y) bits[static_cast<std::size_t>(x)] |= row << (8 * y);
  }
  return bits;
}

LeafBits both(const LeafBits& a, const LeafBits& b) {
  LeafBits bits;
  for (std::size_t n = 0; n < bits.size(); ++n) bits[n] = a[n] & b[n];
  return bits;
}

VoxelSet voxelsOfBox(const Region& region, const RegionPlace& place) {
  const IndexBox box = boxBetween(region.min_W(), region.max_W(), place);
  VoxelSet voxels;
  forEachLeaf(place.map, box, [&](const PackedLeaf& leaf) {
    addIfAny(voxels, leaf.origin(), both(bitsOfBox(leaf.origin(), box), observedIn(leaf)));
  });
  return voxels;
}

VoxelSet voxelsOfMesh(const Region& region, const RegionPlace& place) {
  constexpr double kMostColumns = 1e8;
  const double v = place.map.params().voxel_size_m;
  const Eigen::Vector3d size = (region.max_W() - region.min_W()) / v;
  const double farthest = std::max((region.max_W() - place.origin_W).lpNorm<Eigen::Infinity>(),
                                   (region.min_W() - place.origin_W).lpNorm<Eigen::Infinity>());
  if (!((size.x() + 1) * (size.y() + 1) <= kMostColumns && farthest <= 2e6 * v)) {
    throw ResourceLimit("region.size", "", "the mesh of a region is too large for the map's voxels",
                        "Use a box, or check the mesh's unit");
  }
  std::vector<Eigen::Vector3d> vertices;
  vertices.reserve(region.vertices_W().size());
  for (const Eigen::Vector3d& p_W : region.vertices_W()) {
    // Corners that no triangle uses may lie anywhere.
    vertices.emplace_back((p_W - place.origin_W) / v);
  }
  const std::vector<VoxelRun> runs = voxelsInside(vertices, region.triangles());
  const auto before = [](const VoxelRun& run, const std::pair<std::int32_t, std::int32_t>& column) {
    return std::pair(run.i, run.j) < column;
  };
  VoxelSet voxels;
  forEachLeaf(place.map, boxBetween(region.min_W(), region.max_W(), place), [&](const PackedLeaf& leaf) {
    const openvdb::Coord& origin = leaf.origin();
    LeafBits inside = {};
    for (int x = 0; x < 8; ++x) {
      auto run = std::lower_bound(runs.begin(), runs.end(), std::pair(origin.x() + x, origin.y()), before);
      for (; run != runs.end() && run->i == origin.x() + x && run->j < origin.y() + 8; ++run) {
        const int low = std::max(0, run->lo - origin.z()), high = std::min(7, run->hi - origin.z());
        for (int z = low; z <= high; ++z) {
          inside[static_cast<std::size_t>(x)] |= std::uint64_t{1} << (8 * (run->j - origin.y()) + z);
        }
      }
    }
    addIfAny(voxels, origin, both(inside, observedIn(leaf)));
  });
  return voxels;
}

/// A surface point near a leaf.
struct NearbyPoint {
  Index3 voxel;
  std::uint32_t id;
};

std::int64_t squaredDistance(const Index3& a, const Index3& b) {
  std::int64_t sum = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::int64_t d = std::int64_t{a[axis]} - b[axis];
    sum += d * d;
  }
  return sum;
}

/// Least distance of a voxel to a leaf's box of voxels, squared.
std::int64_t squaredToLeaf(const Index3& voxel, const Index3& leaf) {
  Index3 nearest;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    nearest[axis] = std::clamp(voxel[axis], leaf[axis] * 8, leaf[axis] * 8 + 7);
  }
  return squaredDistance(voxel, nearest);
}

/// Voxels of a leaf that belong to the points of a region: their own, and each colliding voxel whose nearest point, the
/// first of several, is one of them and at most `reach` voxels away.
LeafBits bitsOfPoints(const PackedLeaf& packed, const Region& region, std::int32_t reach, const RegionPlace& place) {
  const PointStore& points = place.points;
  const openvdb::Coord& origin = packed.origin();
  const Index3 leaf = {origin.x() >> 3, origin.y() >> 3, origin.z() >> 3};
  const std::int64_t reach_squared = std::int64_t{reach} * reach;
  const std::int32_t leaves = (reach + 7) >> 3;
  std::vector<NearbyPoint> near;
  points.index().forEachBlock({leaf[0] - leaves, leaf[1] - leaves, leaf[2] - leaves},
                              {leaf[0] + leaves, leaf[1] + leaves, leaf[2] + leaves}, [&](std::uint32_t b) {
                                for (const std::uint32_t id : points.index().blocks()[b].ids) {
                                  const Index3 voxel = points.voxelOf(points.first_L(id));
                                  if (squaredToLeaf(voxel, leaf) <= reach_squared) near.push_back({voxel, id});
                                }
                              });
  const auto inRegion = [&](std::uint32_t id) {
    return std::binary_search(region.ids().begin(), region.ids().end(), id);
  };
  if (std::none_of(near.begin(), near.end(), [&](const NearbyPoint& point) { return inRegion(point.id); })) return {};
  const LeafBits observed = observedIn(packed), collides = factsOf(place.map, packed).collides_on;
  LeafBits bits = {};
  for (std::size_t n = 0; n < PackedLeaf::SIZE; ++n) {
    const std::uint64_t bit = std::uint64_t{1} << (n & 63);
    if ((observed[n >> 6] & bit) == 0) continue;
    const Index3 voxel = childOf(leaf, n);
    std::int64_t least = reach_squared;
    std::uint32_t nearest = kNone;
    for (const NearbyPoint& point : near) {
      const std::int64_t squared = squaredDistance(voxel, point.voxel);
      if (squared < least || (squared == least && point.id < nearest)) least = squared, nearest = point.id;
    }
    if (nearest == kNone || !inRegion(nearest)) continue;
    if (least == 0 || (collides[n >> 6] & bit) != 0) bits[n >> 6] |= bit;
  }
  return bits;
}

VoxelSet voxelsOfPoints(const Region& region, const RegionPlace& place) {
  const PointStore& points = place.points;
  if (region.ids().back() >= points.size()) {
    throw UnusableInput("region.ids", std::to_string(region.ids().back()),
                        "no point has this id; there are " + std::to_string(points.size()),
                        "Use the ids of this map's own points.ply");
  }
  const TsdfParams& p = place.map.params();
  const auto reach = static_cast<std::int32_t>(std::ceil(p.truncation_distance_m / p.voxel_size_m - 1e-9)) + 1;
  std::vector<openvdb::Coord> leaves;
  for (const std::uint32_t id : region.ids()) {
    const Index3 voxel = points.voxelOf(points.first_L(id));
    for (std::int32_t x = (voxel[0] - reach) & ~7; x <= voxel[0] + reach; x += 8) {
      for (std::int32_t y = (voxel[1] - reach) & ~7; y <= voxel[1] + reach; y += 8) {
        for (std::int32_t z = (voxel[2] - reach) & ~7; z <= voxel[2] + reach; z += 8) leaves.emplace_back(x, y, z);
      }
    }
  }
  std::sort(leaves.begin(), leaves.end());
  leaves.erase(std::unique(leaves.begin(), leaves.end()), leaves.end());
  std::vector<LeafBits> bits(leaves.size(), LeafBits{});
  tbb::parallel_for(std::size_t{0}, leaves.size(), [&](std::size_t n) {
    if (const PackedLeaf* leaf = place.map.tree().probeConstLeaf(leaves[n])) {
      bits[n] = bitsOfPoints(*leaf, region, reach, place);
    }
  });
  VoxelSet voxels;
  for (std::size_t n = 0; n < leaves.size(); ++n) addIfAny(voxels, leaves[n], bits[n]);
  return voxels;
}

}  // namespace

VoxelSet voxelsOf(const Region& region, const RegionPlace& place) {
  VoxelSet voxels;
  switch (region.kind()) {
    case Region::Kind::Box:
      voxels = voxelsOfBox(region, place);
      break;
    case Region::Kind::Mesh:
      voxels = voxelsOfMesh(region, place);
      break;
    case Region::Kind::Points:
      voxels = voxelsOfPoints(region, place);
      break;
  }
  if (voxels.empty()) {
    throw UnusableInput("region.outside", region.inWords(), "the map has observed nothing there",
                        "Check that the region is in the map's world frame, in metres");
  }
  return voxels;
}

std::vector<std::uint32_t> pointsIn(const VoxelSet& voxels, const PointStore& points) {
  std::vector<std::uint32_t> ids;
  for (const LeafVoxels& part : voxels) {
    const openvdb::Coord& origin = part.origin_ijk;
    const std::uint32_t b = points.index().blockAt({origin.x() >> 3, origin.y() >> 3, origin.z() >> 3});
    if (b == kNone) continue;
    const PointBlock& block = points.index().blocks()[b];
    std::size_t n = 0;
    for (std::size_t word = 0; word < 8; ++word) {
      for (std::uint64_t left = block.occupied[word]; left != 0; left &= left - 1, ++n) {
        if ((part.bits[word] & left & (~left + 1)) != 0) ids.push_back(block.ids[n]);
      }
    }
  }
  std::sort(ids.begin(), ids.end());
  return ids;
}

}  // namespace accessvdb::internal

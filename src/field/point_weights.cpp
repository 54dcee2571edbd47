// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/point_weights.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <array>
#include <vector>

#include "field/leading_map.h"
#include "field/reached_leaves.h"
#include "processor/prefetch.h"

namespace accessvdb::internal {
namespace {

/// Like PackedAccessor: inner nodes only.
constexpr std::size_t kPointsPerTask = 256;

/// The (2 reach + 1)^3 voxels around one, in the leaves that contain them: at most two along each axis. Read in four
/// steps, interleaved with those of other voxels, so that what the next step needs has arrived by then: voxels
/// scattered over the map wait for memory, not for arithmetic.
class WeightWindow {
 public:
  /// Step 1: the leaves' positions, and the nodes of the tree above them.
  void ask(ConstPackedAccessor& map, const Index3& centre, int reach) {
    std::array<std::array<Span, 2>, 3> spans;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::int32_t low = centre[axis] - reach, high = centre[axis] + reach;
      const std::int32_t last = std::min(low | kLast, high);
      spans[axis] = {Span{low, last}, Span{last + 1, high}};
    }
    parts_ = 0;
    for (const Span& x : spans[0]) {
      for (const Span& y : spans[1]) {
        for (const Span& z : spans[2]) {
          if (x.empty() || y.empty() || z.empty()) continue;
          const openvdb::Coord first(x.first, y.first, z.first);
          const PackedLowerNode* node = map.probeConstNode<PackedLowerNode>(first);
          if (node == nullptr) continue;
          const openvdb::Index in_node = PackedLowerNode::coordToOffset(first);
          prefetchRead(node->getTable() + in_node);
          prefetchRead(reinterpret_cast<const std::byte*>(&node->getChildMask()) + in_node / 8);
          const auto offset = static_cast<std::uint16_t>(PackedLeaf::coordToOffset(first));
          const bool holds_centre = x.holds(centre[0]) && y.holds(centre[1]) && z.holds(centre[2]);
          const std::int32_t to_centre = 64 * (centre[0] - x.first) + 8 * (centre[1] - y.first) + centre[2] - z.first;
          rows_[parts_++] = {node,      nullptr,   {},
                             in_node,   offset,    length(x),
                             length(y), length(z), static_cast<std::int16_t>(holds_centre ? to_centre : kElsewhere)};
        }
      }
    }
  }

  /// Step 2: the leaves.
  void find() {
    int found = 0;
    for (int n = 0; n < parts_; ++n) {
      LeafRows& rows = rows_[static_cast<std::size_t>(n)];
      if (!rows.node->isChildMaskOn(rows.in_node)) continue;
      rows.leaf = rows.node->getTable()[rows.in_node].getChild();
      prefetchRead(rows.leaf);
      rows_[static_cast<std::size_t>(found++)] = rows;
    }
    parts_ = found;
  }

  /// Step 3: their values.
  void fetch() {
    for (int n = 0; n < parts_; ++n) {
      LeafRows& rows = rows_[static_cast<std::size_t>(n)];
      rows.values = LeafValues(*rows.leaf);
      if (!rows.values) continue;
      if (rows.values.compact() != nullptr) {
        rows.values.prefetch(0);
        continue;
      }
      for (int x = 0; x < rows.x; ++x) {  // a cache line holds two rows
        for (int y = 0; y < rows.y; y += 2) rows.values.prefetch(rows.voxelAt(x, y));
        rows.values.prefetch(rows.voxelAt(x, rows.y - 1));
      }
    }
  }

  /// Step 4. @param needs_centre  0 if the central voxel has none: what was there has gone. @return the largest weight
  [[nodiscard]] std::uint16_t largest(bool needs_centre) const {
    std::uint32_t most = 0;
    bool centre = !needs_centre;
    for (int n = 0; n < parts_; ++n) {
      const LeafRows& rows = rows_[static_cast<std::size_t>(n)];
      if (!rows.values) continue;
      if (rows.to_centre != kElsewhere) {
        centre = centre || weightOf(rows.values[rows.offset + static_cast<std::size_t>(rows.to_centre)]) > 0;
      }
      for (int x = 0; x < rows.x; ++x) {
        for (int y = 0; y < rows.y; ++y) {
          const std::size_t first = rows.voxelAt(x, y);
          for (int z = 0; z < rows.z; ++z) {
            most = std::max(most, weightOf(rows.values[first + static_cast<std::size_t>(z)]));
          }
        }
      }
    }
    return static_cast<std::uint16_t>(centre ? most : 0);
  }

 private:
  static constexpr std::int16_t kElsewhere = -1;
  static constexpr std::int32_t kLast = PackedLeaf::DIM - 1;
  struct Span {
    std::int32_t first = 0, last = -1;
    [[nodiscard]] bool empty() const { return first > last; }
    [[nodiscard]] bool holds(std::int32_t x) const { return x >= first && x <= last; }
  };
  static std::int8_t length(const Span& span) { return static_cast<std::int8_t>(span.last - span.first + 1); }
  struct LeafRows {
    const PackedLowerNode* node;
    const PackedLeaf* leaf;
    LeafValues values;
    openvdb::Index in_node;  ///< index of the leaf
    std::uint16_t offset;    ///< offset of the first voxel in the leaf
    std::int8_t x, y, z;     ///< voxels
    std::int16_t to_centre;  ///< offset of the central voxel from the first, or kElsewhere
    [[nodiscard]] std::size_t voxelAt(int at_x, int at_y) const {
      return offset + static_cast<std::size_t>(64 * at_x + 8 * at_y);
    }
  };
  std::array<LeafRows, 8> rows_;
  int parts_ = 0;
};

/// A point whose own voxel is not observed has no weight: its return observed it, so someone took it out of the map
/// (removed_voxels.h). Projective fusion may leave the voxel of a return out.
bool needsOwnVoxel(const PackedMap& map) { return map.params().region != UpdateRegion::Projective; }

/// @param voxelOf  (n) -> Index3, for n in [begin, end)  @param take  (n, weight)
template <typename VoxelOf, typename Take>
void readWeights(const PackedMap& map, int reach, std::size_t begin, std::size_t end, const VoxelOf& voxelOf,
                 const Take& take) {
  constexpr std::size_t kApart = 8;              // other voxels between two steps of the same one
  std::array<WeightWindow, 4 * kApart> windows;  // of n, n + 1 ...
  const auto windowOf = [&](std::size_t n) -> WeightWindow& { return windows[n % windows.size()]; };
  // Is the step of voxel n - steps * kApart due at n?
  const auto due = [&](std::size_t n, std::size_t steps) {
    return n >= begin + steps * kApart && n < end + steps * kApart;
  };
  const bool needs_centre = needsOwnVoxel(map);
  ConstPackedAccessor accessor(map.tree());
  for (std::size_t n = begin; n < end + 3 * kApart; ++n) {
    if (due(n, 0)) windowOf(n).ask(accessor, voxelOf(n), reach);
    if (due(n, 1)) windowOf(n - kApart).find();
    if (due(n, 2)) windowOf(n - 2 * kApart).fetch();
    if (due(n, 3)) take(n - 3 * kApart, windowOf(n - 3 * kApart).largest(needs_centre));
  }
}

/// Where a point is, and its place in the request.
struct Site {
  std::uint64_t order;  ///< leafOrder()
  Index3 voxel;
  std::uint32_t index;
};

/// Leaves of a tree node are consecutive: 128 voxels per axis, then 8. Coordinates are within +-2^20.
std::uint64_t leafOrder(const Index3& voxel) {
  std::uint64_t node = 0, leaf = 0;
  for (const std::int32_t x : voxel) {
    node = node << 14 | static_cast<std::uint64_t>((x >> 7) + (1 << 13));
    leaf = leaf << 4 | static_cast<std::uint64_t>(x >> 3 & 15);
  }
  return node << 12 | leaf;
}

/// Ids follow the voxels of each scan, plane by plane, so neighbours in memory have distant ids.
std::vector<Site> sitesByLeaf(const PointStore& points, std::span<const std::uint32_t> ids) {
  std::vector<Site> sites(ids.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, ids.size(), kPointsPerTask), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      const Index3 voxel = points.voxelOf(points.first_L(ids[n]));
      sites[n] = {leafOrder(voxel), voxel, static_cast<std::uint32_t>(n)};
    }
  });
  tbb::parallel_sort(sites.begin(), sites.end(), [](const Site& a, const Site& b) { return a.order < b.order; });
  return sites;
}

/// Voxels around a point's own whose weights count.
int reachOf(bool neighbourhood_weight) { return neighbourhood_weight ? 1 : 0; }

}  // namespace

MapReads makeMapReads(const PackedMap& map, const PointStore& points, bool neighbourhood_weight,
                      const std::optional<VoxelColumnBox>& core) {
  MapReads reads;
  const int reach = reachOf(neighbourhood_weight);
  const auto read = [&map, reach, core](std::span<std::uint16_t> weights, const auto& voxelOf) {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, weights.size(), kPointsPerTask), [&](const auto& range) {
      readWeights(map, reach, range.begin(), range.end(), voxelOf, [&](std::size_t n, std::uint16_t weight) {
        weights[n] = core && !core->contains(voxelOf(n)) ? std::uint16_t{0} : weight;
      });
    });
  };
  reads.weights = [read, &points](std::span<const std::uint32_t> ids, std::span<std::uint16_t> weights) {
    const std::vector<Site> sites = sitesByLeaf(points, ids);
    std::vector<std::uint16_t> sorted(sites.size());
    read(sorted, [&](std::size_t n) { return sites[n].voxel; });
    for (std::size_t n = 0; n < sites.size(); ++n) weights[sites[n].index] = sorted[n];
  };
  reads.weights_at = [read](std::span<const Index3> voxels, std::span<std::uint16_t> weights) {
    read(weights, [&](std::size_t n) { return voxels[n]; });
  };
  reads.distance_code = map.distanceCode();
  reads.reached = [&map, reach](std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                                const TakeLeaves& take) {
    return forEachReachedLeaf(map.params(), p_L, q_L, reach, take);
  };
  return reads;
}

void readWeightsOfMap(const PackedMap& map, int reach, std::span<const Index3> voxels,
                      std::span<std::uint16_t> weights) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, weights.size(), kPointsPerTask), [&](const auto& range) {
    readWeights(
        map, reach, range.begin(), range.end(), [&](std::size_t n) { return voxels[n]; },
        [&](std::size_t n, std::uint16_t weight) { weights[n] = weight; });
  });
}

MapReads readsOfLead(const MapReads& map, const PointStore& points, bool neighbourhood_weight,
                     const std::unique_ptr<LeadingMap>& lead) {
  MapReads reads = map;
  const int reach = reachOf(neighbourhood_weight);
  reads.weights = [of_map = map.weights, reach, &points, &lead](std::span<const std::uint32_t> ids,
                                                                std::span<std::uint16_t> weights) {
    // As in LeadingMap::readWeightsAt(), where it is fewer that a scan may reach.
    if (!lead || !lead->leads() || (ids.size() >= kWeightsOnHost && lead->hostHasAll())) {
      of_map(ids, weights);
      return;
    }
    std::vector<Index3> voxels(ids.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, ids.size(), kPointsPerTask), [&](const auto& range) {
      for (std::size_t n = range.begin(); n != range.end(); ++n) voxels[n] = points.voxelOf(points.first_L(ids[n]));
    });
    lead->readWeightsAt(voxels, reach, weights);
  };
  reads.weights_at = [of_map = map.weights_at, reach, &lead](std::span<const Index3> voxels,
                                                             std::span<std::uint16_t> weights) {
    if (lead && lead->leads()) {
      lead->readWeightsAt(voxels, reach, weights);
    } else {
      of_map(voxels, weights);
    }
  };
  return reads;
}

MapReads readsWithGone(const MapReads& map, const PointStore& points, const GonePoints& gone) {
  MapReads reads = map;
  reads.weights = [of_map = map.weights, &gone](std::span<const std::uint32_t> ids, std::span<std::uint16_t> weights) {
    of_map(ids, weights);
    if (gone.size() == 0) return;
    for (std::size_t n = 0; n < ids.size(); ++n) weights[n] = std::max(weights[n], gone.leastWeight(ids[n]));
  };
  reads.weights_at = [of_map = map.weights_at, &points, &gone](std::span<const Index3> voxels,
                                                               std::span<std::uint16_t> weights) {
    of_map(voxels, weights);
    if (gone.size() == 0) return;
    for (std::size_t n = 0; n < voxels.size(); ++n) {
      const std::uint32_t id = points.index().find(voxels[n]);
      if (id != kNone) weights[n] = std::max(weights[n], gone.leastWeight(id));
    }
  };
  return reads;
}

}  // namespace accessvdb::internal

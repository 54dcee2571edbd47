// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "change/ray_evidence.h"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "change/box_walk.h"
#include "points/radix_sort.h"

namespace accessvdb::internal {
namespace {

using ConstAccessor = openvdb::tree::ValueAccessor2<const PackedTree, /*IsSafe=*/false, 1, 2>;

constexpr std::size_t kRaysPerTask = 256;
/// Of rays that are not needed for a suspect cell, one in so many is examined, chosen by the voxel of its return.
constexpr std::uint64_t kOneIn = 4;
constexpr double kDirectionStep = 0.1;  // two rays with directions nearer than this may be one line
/// A ray passes a place where a surface was within this, voxels. A mean is in its voxel, so that voxel's centre is
/// within half a diagonal more; the rest is for the rounding of float32 at up to 2^20 voxels.
constexpr double kNear = 0.5;
constexpr float kFarthest2 = 1.4f * 1.4f;
constexpr int kLeafEdge = 8, kWalkEdge = 64;  // voxels; points are indexed by 8^3 leaves

std::uint64_t mixed(std::uint64_t hash, std::int64_t value) {
  hash = (hash ^ static_cast<std::uint64_t>(value)) * 0x9e3779b97f4a7c15u;
  return hash ^ hash >> 29;
}

bool hasBit(const LeafBits& bits, std::size_t n) { return (bits[n >> 6] >> (n & 63) & 1) != 0; }

/// A return and its ray, in voxels; voxel n is [n, n + 1).
struct Ray {
  VoxelRay line;
  double length = 0;
  bool sampled = false;
};

/// Rays in an order in which those that follow each other have nearly the same direction. They go through the same
/// cells, which are then in the cache: a sensor's own order may jump from side to side.
template <typename From>
std::vector<std::uint32_t> sideBySide(std::span<const Eigen::Vector3f> p_L, const From& from_L) {
  constexpr float kSteps = 32;  // from 0 to 1, of a component of the direction
  std::vector<std::uint64_t> keyed(p_L.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, p_L.size(), 4 * kRaysPerTask), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      const Eigen::Vector3f ray = p_L[n] - from_L(n);
      const float length = ray.norm();
      std::uint64_t key = 0;
      for (Eigen::Index axis = 0; axis < 3 && length > 0; ++axis) {
        const auto step = static_cast<std::uint64_t>(kSteps * (1 + ray[axis] / length));
        for (int bit = 0; bit < 7; ++bit) key |= (step >> bit & 1) << (3 * bit + axis);
      }
      keyed[n] = key << 32 | n;
    }
  });
  std::vector<std::uint64_t> spare;
  radixSort(keyed, spare, [](std::uint64_t ray) { return ray >> 32; });
  std::vector<std::uint32_t> order(keyed.size());
  std::ranges::transform(keyed, order.begin(), [](std::uint64_t key) { return static_cast<std::uint32_t>(key); });
  return order;
}

/// A part of the rays, on one thread.
class Walk {
 public:
  Walk(const PackedMap& map, const PointStore& points, const WalkShape& shape, const WalkPlaces& places)
      : map_(map),
        points_(points),
        shape_(shape),
        places_(places),
        tree_(map.tree()),
        open_(map, points, shape, places) {}

  void take(const Eigen::Vector3f& p_L, const Eigen::Vector3f& q_L) {
    Ray ray;
    double length2 = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto a = static_cast<Eigen::Index>(axis);
      ray.line.from[axis] = static_cast<double>(q_L[a]) / shape_.voxel_size_m + 0.5;
      ray.line.along[axis] = (static_cast<double>(p_L[a]) - static_cast<double>(q_L[a])) / shape_.voxel_size_m;
      length2 += ray.line.along[axis] * ray.line.along[axis];
    }
    ray.length = std::sqrt(length2);
    const double end = ray.length - shape_.margin;
    if (!(end > 0)) return;
    for (double& u : ray.line.along) u /= ray.length;
    std::uint64_t hash = 0;
    for (const std::int32_t x : points_.voxelOf(p_L)) hash = mixed(hash, x);
    ray.sampled = (hash >> 40) % kOneIn == 0;
    if (!ray.sampled && places_.suspect.empty() && places_.opening.empty()) return;
    forEachBox(ray.line, kWalkEdge, 0, end, [&](const Index3& leaf_group, double begin, double stop) {
      crossLeafGroup(ray, leaf_group, begin, stop, end);
    });
  }

  std::vector<Pass> passes;
  std::vector<OpenedLeaf> opened;

 private:
  void crossLeafGroup(const Ray& ray, const Index3& leaf_group, double begin, double stop, double end) {
    const SurfaceIndex& index = points_.index();
    const LeafBits* suspect = places_.suspect.empty() ? nullptr : places_.suspect.in(leaf_group);
    const LeafBits* opening = places_.opening.empty() ? nullptr : places_.opening.in(leaf_group);
    if (!ray.sampled && suspect == nullptr && opening == nullptr) return;
    const std::uint32_t number = index.leafGroupAt(leaf_group);
    if (number == kNone && opening == nullptr) return;
    const LeafBits* with_points = number == kNone ? nullptr : &index.leavesIn(number);
    forEachBox(ray.line, kLeafEdge, begin, stop, [&](const Index3& leaf, double from, double to) {
      const std::size_t bit = bitInParent(leaf);
      const bool all = suspect != nullptr && hasBit(*suspect, bit);
      if (with_points != nullptr && (ray.sampled || all) && hasBit(*with_points, bit)) {
        pass(ray, index.blockIn(number, bit), end);
      }
      if (opening != nullptr && hasBit(*opening, bit)) open(ray, leaf, from, to);
    });
  }

  /// Which cells of a block the ray went through, near a place where a surface was.
  void pass(const Ray& ray, std::uint32_t number, double end) {
    const PointBlock& block = points_.index().blocks()[number];
    const BlockCells& cells = places_.blocks[number];
    const std::uint32_t asked = ray.sampled ? 0xffu : cells.suspect;
    if (asked == 0) return;
    const PackedLeaf* leaf = nullptr;
    LeafValues values;
    // The centre of the leaf's lowest voxel, from the point of the ray that comes nearest to the leaf's middle: small
    // numbers, which float32 holds exactly enough.
    double nearest = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      nearest += (8.0 * block.leaf[axis] + 4 - ray.line.from[axis]) * ray.line.along[axis];
    }
    std::array<float, 3> corner, u;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double at = ray.line.from[axis] + nearest * ray.line.along[axis];
      corner[axis] = static_cast<float>(8.0 * block.leaf[axis] + 0.5 - at);
      u[axis] = static_cast<float>(ray.line.along[axis]);
    }
    std::uint32_t found = 0;
    std::size_t n = 0;
    for (std::size_t word = 0; word < 8; ++word) {
      for (std::uint64_t bits = block.occupied[word]; bits != 0; bits &= bits - 1, ++n) {
        const std::size_t bit = word << 6 | static_cast<std::size_t>(std::countr_zero(bits));
        const std::uint32_t own = 1u << cellOfBit(bit);
        if ((asked & own & ~found) == 0) continue;
        // Means are scattered in memory: only those whose voxel comes near are read.
        const float ex = corner[0] + static_cast<float>(bit >> 6), ey = corner[1] + static_cast<float>(bit >> 3 & 7),
                    ez = corner[2] + static_cast<float>(bit & 7);
        const float s = ex * u[0] + ey * u[1] + ez * u[2];
        if (ex * ex + ey * ey + ez * ez - s * s > kFarthest2) continue;
        const Eigen::Vector3f& mean_L = points_.pca_L(block.ids[n]);
        double along = 0, distance2 = 0;
        for (std::size_t axis = 0; axis < 3; ++axis) {
          const double e = static_cast<double>(mean_L[static_cast<Eigen::Index>(axis)]) / shape_.voxel_size_m + 0.5 -
                           ray.line.from[axis];
          along += e * ray.line.along[axis];
          distance2 += e * e;
        }
        distance2 -= along * along;
        if (!(along > 0 && along < end && distance2 <= kNear * kNear)) continue;
        if (leaf == nullptr) {
          leaf = leafAt(block.leaf);
          if (leaf != nullptr) values = LeafValues(*leaf);
          if (!values) return;
        }
        // A point whose voxel does not collide is in no one's way: whether it is still there does not matter.
        if (weightOf(values[bit]) == 0 || meanOf(values[bit]) >= map_.collisionMean()) continue;
        found |= own;
      }
    }
    for (std::uint32_t left = found; left != 0; left &= left - 1) {
      const auto cell = static_cast<std::uint64_t>(std::countr_zero(left));
      passes.push_back((std::uint64_t{number} * 8 + cell) << 6 | lineIn(ray, block.leaf, cell));
    }
  }

  /// Rays of the same line get the same number, of 64: they cross the cell at the same place in the same direction.
  [[nodiscard]] std::uint64_t lineIn(const Ray& ray, const Index3& leaf, std::uint64_t cell) const {
    const std::array<double, 3> centre = {8.0 * leaf[0] + (cell & 4 ? 6 : 2), 8.0 * leaf[1] + (cell & 2 ? 6 : 2),
                                          8.0 * leaf[2] + (cell & 1 ? 6 : 2)};
    double along = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) along += (centre[axis] - ray.line.from[axis]) * ray.line.along[axis];
    std::uint64_t hash = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double at = ray.line.from[axis] + along * ray.line.along[axis];
      hash = mixed(hash, static_cast<std::int64_t>(std::floor(at / shape_.line_step)));
      hash = mixed(hash, static_cast<std::int64_t>(std::floor(ray.line.along[axis] / kDirectionStep)));
    }
    return hash >> 40 & 63;
  }

  void open(const Ray& ray, const Index3& leaf_index, double from, double to) {
    const PackedLeaf* leaf = leafAt(leaf_index);
    if (leaf == nullptr || !LeafValues(*leaf) || !open_.isWalked(leaf_index)) return;
    const LeafValues values(*leaf);
    const VoxelVotes* votes = map_.votesOf(*leaf);
    OpenedLeaf open_here = {leaf_index, {}};
    std::uint64_t any = 0;
    forEachBox(ray.line, 1, from, to, [&](const Index3& voxel, double, double) {
      if (parentOf(voxel) != leaf_index) return;  // by rounding, at its faces
      const std::size_t bit = bitInParent(voxel);
      const std::uint32_t packed = values[bit];
      if (weightOf(packed) == 0) return;
      if (meanOf(packed) >= map_.collisionMean() && (votes == nullptr || !votes->blockedAt(bit))) return;
      if (!open_.mayOpen(cellOfVoxel(voxel))) return;
      open_here.voxels[bit >> 6] |= std::uint64_t{1} << (bit & 63);
      any = 1;
    });
    if (any != 0) opened.push_back(open_here);
  }

  [[nodiscard]] const PackedLeaf* leafAt(const Index3& leaf) {
    const openvdb::Coord ijk(8 * leaf[0], 8 * leaf[1], 8 * leaf[2]);
    const auto* node = tree_.probeConstNode<PackedLowerNode>(ijk);
    if (node == nullptr) return nullptr;
    const openvdb::Index n = PackedLowerNode::coordToOffset(ijk);
    return node->isChildMaskOn(n) ? node->getTable()[n].getChild() : nullptr;
  }

  const PackedMap& map_;
  const PointStore& points_;
  const WalkShape& shape_;
  WalkPlaces places_;
  ConstAccessor tree_;
  OpenCells open_;
};

}  // namespace

bool OpenCells::mayOpen(const Index3& cell) {
  const std::uint32_t known = known_.find(cell);
  if (known != PlaceMap::kAbsent) return known == 1;
  const bool may = find(cell);
  known_.insert(cell, may ? 1 : 0);
  return may;
}

bool OpenCells::isWalked(const Index3& leaf) {
  const std::uint32_t known = walked_.find(leaf);
  if (known != PlaceMap::kAbsent) return known == 1;
  const bool walked = isNearGone(leaf);
  walked_.insert(leaf, walked ? 1 : 0);
  return walked;
}

bool OpenCells::isNearGone(const Index3& leaf) const {
  const std::int32_t reach = shape_.shadow_cells;
  const auto low = [&](std::size_t axis) { return 2 * leaf[axis] - reach; };
  const auto high = [&](std::size_t axis) { return 2 * leaf[axis] + 1 + reach; };
  Index3 near;
  for (near[0] = low(0) >> 1; near[0] <= high(0) >> 1; ++near[0]) {
    for (near[1] = low(1) >> 1; near[1] <= high(1) >> 1; ++near[1]) {
      for (near[2] = low(2) >> 1; near[2] <= high(2) >> 1; ++near[2]) {
        const std::uint32_t number = points_.index().blockAt(near);
        if (number == kNone || places_.blocks[number].gone == 0) continue;
        for (std::size_t n = 0; n < 8; ++n) {
          if (places_.blocks[number].cells[n].verdict != Verdict::Gone) continue;
          bool inside = true;
          for (std::size_t axis = 0; axis < 3; ++axis) {
            const std::int32_t cell = 2 * near[axis] + static_cast<std::int32_t>(n >> (2 - axis) & 1);
            inside = inside && cell >= low(axis) && cell <= high(axis);
          }
          if (inside) return true;
        }
      }
    }
  }
  return false;
}

bool OpenCells::stands(const Index3& cell) const {
  const std::uint32_t number = points_.index().blockAt({cell[0] >> 1, cell[1] >> 1, cell[2] >> 1});
  if (number == kNone) return false;
  const std::size_t own = cellInLeaf(cell);
  if ((places_.blocks[number].gone >> own & 1) != 0) return false;
  const PointBlock& block = points_.index().blocks()[number];
  const PackedLeaf* leaf = map_.tree().probeConstLeaf({8 * block.leaf[0], 8 * block.leaf[1], 8 * block.leaf[2]});
  const LeafValues values = leaf == nullptr ? LeafValues() : LeafValues(*leaf);
  if (!values) return false;
  for (std::size_t bit = 0; bit < 512; ++bit) {
    if (cellOfBit(bit) != own || !hasBit(block.occupied, bit)) continue;
    if (weightOf(values[bit]) > 0 && meanOf(values[bit]) < map_.collisionMean()) return true;
  }
  return false;
}

bool OpenCells::find(const Index3& cell) const {
  const auto cellIn = [this](const Index3& at, std::uint32_t& block) {
    block = points_.index().blockAt({at[0] >> 1, at[1] >> 1, at[2] >> 1});
    return cellInLeaf(at);
  };
  std::uint32_t block = kNone;
  const std::size_t own = cellIn(cell, block);
  if (block != kNone && (places_.blocks[block].gone >> own & 1) != 0) return true;
  bool near_gone = false;
  const std::int32_t reach = shape_.shadow_cells;
  Index3 at;
  for (at[0] = cell[0] - reach; at[0] <= cell[0] + reach; ++at[0]) {
    for (at[1] = cell[1] - reach; at[1] <= cell[1] + reach; ++at[1]) {
      for (at[2] = cell[2] - reach; at[2] <= cell[2] + reach; ++at[2]) {
        const bool beside =
            std::abs(at[0] - cell[0]) <= 1 && std::abs(at[1] - cell[1]) <= 1 && std::abs(at[2] - cell[2]) <= 1;
        if (beside && stands(at)) return false;
        const std::size_t n = cellIn(at, block);
        near_gone = near_gone || (block != kNone && (places_.blocks[block].gone >> n & 1) != 0);
      }
    }
  }
  return near_gone;
}

RayEvidence evidenceOf(const PackedMap& map, const PointStore& points, const WalkShape& shape, const WalkPlaces& places,
                       std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L) {
  const auto from_L = [&q_L](std::size_t n) -> const Eigen::Vector3f& { return q_L[q_L.size() == 1 ? 0 : n]; };
  const std::vector<std::uint32_t> order = sideBySide(p_L, from_L);
  tbb::enumerable_thread_specific<Walk> walks([&] { return Walk(map, points, shape, places); });
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, order.size(), kRaysPerTask), [&](const auto& range) {
    Walk& walk = walks.local();
    for (std::size_t n = range.begin(); n != range.end(); ++n) walk.take(p_L[order[n]], from_L(order[n]));
  });
  RayEvidence evidence;
  std::vector<OpenedLeaf> opened;
  for (const Walk& walk : walks) {
    evidence.passes.insert(evidence.passes.end(), walk.passes.begin(), walk.passes.end());
    opened.insert(opened.end(), walk.opened.begin(), walk.opened.end());
  }
  tbb::parallel_sort(evidence.passes);
  evidence.passes.erase(std::unique(evidence.passes.begin(), evidence.passes.end()), evidence.passes.end());
  std::sort(opened.begin(), opened.end(), [](const OpenedLeaf& a, const OpenedLeaf& b) { return a.leaf < b.leaf; });
  for (const OpenedLeaf& leaf : opened) {
    if (evidence.opened.empty() || evidence.opened.back().leaf != leaf.leaf) evidence.opened.push_back({leaf.leaf, {}});
    for (std::size_t x = 0; x < 8; ++x) evidence.opened.back().voxels[x] |= leaf.voxels[x];
  }
  return evidence;
}

}  // namespace accessvdb::internal

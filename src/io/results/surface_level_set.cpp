// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/results/surface_level_set.h"

#include <openvdb/tools/SignedFloodFill.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>

#include "io/results/enclosed_space.h"
#include "vdb/standard_grids.h"

namespace accessvdb::internal {
namespace {

using Leaf = openvdb::FloatTree::LeafNodeType;
using openvdb::Coord;
using openvdb::Vec3f;

// All lengths here are voxels.
constexpr int kDim = 8;
constexpr float kBand = 3.0f;      // OpenVDB's usual half width
constexpr float kReach = 2.0f;     // how far from a point, along the surface, its tangent plane still counts
constexpr float kSupport = 2.0f;   // points up to this much farther along the surface than the nearest are blended
constexpr float kSameSide = 0.5f;  // least cosine between two blended normals: not both faces of a thin board
constexpr float kLayer = 0.75f;    // half a voxel separates two sides over faces; the rest is for blended distances
constexpr float kNearest2 = kBand * kBand + kReach * kReach;  // farthest nearest point of an active voxel, squared
constexpr float kBlended2 = kNearest2 + kSupport * kSupport;  // farthest point that is blended, squared
// A point is up to half a voxel off its voxel's centre: ceil(sqrt(17) + 0.5) - 1 voxels away at most.
constexpr int kMargin = 4;

/// A point near a leaf, in voxels from the leaf's first voxel.
struct Sample {
  Vec3f p, n;
};

class LeafOfDistances {
 public:
  LeafOfDistances(const SurfacePoints& points, const SurfaceVoxels& surface, const Coord& origin)
      : points_(points), surface_(surface), origin_(origin) {
    for (int dx = -kDim; dx <= kDim; dx += kDim) {
      for (int dy = -kDim; dy <= kDim; dy += kDim) {
        for (int dz = -kDim; dz <= kDim; dz += kDim) gather(origin.offsetBy(dx, dy, dz));
      }
    }
  }

  /// Null if no voxel of the leaf is in the band.
  [[nodiscard]] std::unique_ptr<Leaf> make(float background) {
    if (samples_.empty()) return nullptr;
    findNearest();
    blend();
    const auto v = static_cast<float>(points_.voxel_size_m());
    std::unique_ptr<Leaf> leaf;
    for (openvdb::Index n = 0; n < Leaf::SIZE; ++n) {
      if (!(nearest2_[n] <= kNearest2)) continue;
      const float d = weighted_[n] / weight_[n];
      if (!(std::abs(d) < kBand) || nearest2_[n] - d * d > kReach * kReach) continue;
      if (!leaf) leaf = std::make_unique<Leaf>(origin_, background, false);
      leaf->setValueOn(n, d * v);
    }
    return leaf;
  }

 private:
  void gather(const Coord& leaf_origin) {
    const auto& entries = surface_.entries();
    const auto& begins = surface_.leafBegins();
    const auto originAt = [&](std::size_t begin) {
      const Coord& ijk = entries[begin].ijk;
      return Coord(ijk.x() & ~(kDim - 1), ijk.y() & ~(kDim - 1), ijk.z() & ~(kDim - 1));
    };
    const auto found = std::lower_bound(begins.begin(), begins.end() - 1, leaf_origin,
                                        [&](std::size_t begin, const Coord& key) { return originAt(begin) < key; });
    if (found == begins.end() - 1 || originAt(*found) != leaf_origin) return;
    for (std::size_t e = *found; e < *(found + 1); ++e) {
      const Coord at = entries[e].ijk - origin_;
      if (at.x() < -kMargin || at.y() < -kMargin || at.z() < -kMargin || at.x() >= kDim + kMargin ||
          at.y() >= kDim + kMargin || at.z() >= kDim + kMargin) {
        continue;
      }
      const SurfacePoint point = points_.at(entries[e].index);
      if (!(point.normal_W.squaredNorm() > 0.5f) || !point.normal_W.allFinite()) continue;
      const Eigen::Vector3d p = (point.position_W - points_.origin_W()) / points_.voxel_size_m() -
                                Eigen::Vector3d(origin_.x(), origin_.y(), origin_.z());
      samples_.push_back({Vec3f(static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z())),
                          Vec3f(point.normal_W.x(), point.normal_W.y(), point.normal_W.z())});
    }
  }

  /// Calls visit(voxel, from the point to the voxel's centre, squared distance) for the leaf's voxels within a radius.
  template <typename Visit>
  static void forVoxelsAround(const Vec3f& p, float radius2, const Visit& visit) {
    const float radius = std::sqrt(radius2);
    std::array<int, 3> low, high;
    for (int axis = 0; axis < 3; ++axis) {
      low[static_cast<std::size_t>(axis)] = std::max(0, static_cast<int>(std::ceil(p[axis] - radius)));
      high[static_cast<std::size_t>(axis)] = std::min(kDim - 1, static_cast<int>(std::floor(p[axis] + radius)));
    }
    for (int x = low[0]; x <= high[0]; ++x) {
      for (int y = low[1]; y <= high[1]; ++y) {
        for (int z = low[2]; z <= high[2]; ++z) {
          const Vec3f to(static_cast<float>(x) - p.x(), static_cast<float>(y) - p.y(), static_cast<float>(z) - p.z());
          const float squared = to.dot(to);
          if (squared <= radius2) visit(static_cast<std::size_t>((x * kDim + y) * kDim + z), to, squared);
        }
      }
    }
  }

  void findNearest() {
    nearest2_.fill(std::numeric_limits<float>::infinity());
    for (std::size_t s = 0; s < samples_.size(); ++s) {
      forVoxelsAround(samples_[s].p, kNearest2, [&](std::size_t voxel, const Vec3f&, float squared) {
        if (!(squared < nearest2_[voxel])) return;  // of two equally near ones, the first in voxel order
        nearest2_[voxel] = squared;
        nearest_[voxel] = static_cast<std::uint32_t>(s);
      });
    }
  }

  void blend() {
    weight_.fill(0);
    weighted_.fill(0);
    for (const Sample& sample : samples_) {
      forVoxelsAround(sample.p, kBlended2, [&](std::size_t voxel, const Vec3f& to, float squared) {
        const float nearness = 1 - (squared - nearest2_[voxel]) / (kSupport * kSupport);
        if (!(nearness > 0) || sample.n.dot(samples_[nearest_[voxel]].n) < kSameSide) return;
        const float w = nearness * nearness * nearness;
        weight_[voxel] += w;
        weighted_[voxel] += w * sample.n.dot(to);
      });
    }
  }

  const SurfacePoints& points_;
  const SurfaceVoxels& surface_;
  const Coord origin_;
  std::vector<Sample> samples_;
  std::array<float, Leaf::SIZE> nearest2_, weight_, weighted_;
  std::array<std::uint32_t, Leaf::SIZE> nearest_ = {};
};

void sortUnique(std::vector<Coord>& origins) {
  std::sort(origins.begin(), origins.end());
  origins.erase(std::unique(origins.begin(), origins.end()), origins.end());
}

/// Origins of the leaves with points, and of those around them.
std::vector<Coord> leavesAround(const SurfaceVoxels& surface) {
  std::vector<Coord> origins;
  const auto& begins = surface.leafBegins();
  for (std::size_t n = 0; n + 1 < begins.size(); ++n) {
    const Coord& ijk = surface.entries()[begins[n]].ijk;
    const Coord origin(ijk.x() & ~(kDim - 1), ijk.y() & ~(kDim - 1), ijk.z() & ~(kDim - 1));
    for (int k = 0; k < 27; ++k) {
      origins.push_back(origin.offsetBy((k / 9 - 1) * kDim, (k / 3 % 3 - 1) * kDim, (k % 3 - 1) * kDim));
    }
  }
  sortUnique(origins);
  return origins;
}

/// Adds inactive leaves, so that every active voxel's face neighbours are in a leaf: no sign changes between a
/// leaf and a tile.
void addRing(std::vector<std::unique_ptr<Leaf>>& leaves, float background) {
  std::vector<Coord> present, wanted;
  for (const auto& leaf : leaves) {
    present.push_back(leaf->origin());
    for (auto value = leaf->cbeginValueOn(); value; ++value) {
      const Coord at = value.getCoord() - leaf->origin();
      for (int axis = 0; axis < 3; ++axis) {
        if (at[axis] != 0 && at[axis] != kDim - 1) continue;
        Coord next = leaf->origin();
        next[axis] += at[axis] == 0 ? -kDim : kDim;
        if (wanted.empty() || wanted.back() != next) wanted.push_back(next);
      }
    }
  }
  std::sort(present.begin(), present.end());
  sortUnique(wanted);
  for (const Coord& origin : wanted) {
    if (!std::binary_search(present.begin(), present.end(), origin)) {
      leaves.push_back(std::make_unique<Leaf>(origin, background, false));
    }
  }
}

}  // namespace

openvdb::FloatGrid::Ptr surfaceLevelSet(const SurfacePoints& points, const SurfaceVoxels& surface) {
  // Rounded up: readers that require three voxels compare in doubles.
  const float background =
      std::nextafter(static_cast<float>(kBand * points.voxel_size_m()), std::numeric_limits<float>::infinity());
  auto grid = openvdb::FloatGrid::create(background);
  grid->setName("surface");
  grid->setGridClass(openvdb::GRID_LEVEL_SET);
  grid->setTransform(fieldTransform(points.voxel_size_m()));

  const std::vector<Coord> origins = leavesAround(surface);
  std::vector<std::unique_ptr<Leaf>> leaves(origins.size());
  tbb::parallel_for(std::size_t{0}, origins.size(),
                    [&](std::size_t n) { leaves[n] = LeafOfDistances(points, surface, origins[n]).make(background); });
  std::erase(leaves, nullptr);
  if (leaves.empty()) return grid;
  addRing(leaves, background);

  std::vector<Leaf*> all;
  for (const auto& leaf : leaves) all.push_back(leaf.get());
  signInactiveVoxels(all, kLayer * static_cast<float>(points.voxel_size_m()), background);
  for (auto& leaf : leaves) grid->tree().addLeaf(leaf.release());
  // Tiles take the sign of the leaves around them; the leaves themselves (level 0) are right already.
  openvdb::tools::signedFloodFillWithValues(grid->tree(), background, -background, true, 1, 1);
  return grid;
}

}  // namespace accessvdb::internal

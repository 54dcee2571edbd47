// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/left_out_points.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace accessvdb::internal {
namespace {

/// No position of a return is farther from the world's origin, in cubes: doubles have 2^53 steps.
constexpr double kFarthestCube = 0x1p52;
constexpr std::uint32_t kMostDoublings = 60;

}  // namespace

LeftOutPoints::LeftOutPoints(const WindowMargins& reach, const FieldParams& resolved)
    : reach_(reach.neighbours), edge_m_(reach.influence() * resolved.tsdf.voxel_size_m) {
  if (resolved.change.mode == ChangeMode::Full) {
    // GoneCells: a shadow is opened up to tau and a voxel from a cell that has gone.
    const double shadow = std::ceil(resolved.tsdf.truncation_distance_m / resolved.tsdf.voxel_size_m) + 1;
    reach_ = std::max(reach_, static_cast<std::int32_t>(shadow) + WindowMargins::kGoneCells);
  }
  near_leaves_ = (reach_ + 7) / 8;
}

std::size_t LeftOutPoints::Hash::operator()(const Cube& cube) const {
  std::uint64_t hash = 0;
  for (const std::int64_t x : cube) hash = (hash ^ static_cast<std::uint64_t>(x)) * 0x9e3779b97f4a7c15ull;
  return static_cast<std::size_t>(hash ^ hash >> 29);
}

void LeftOutPoints::noteLeaves(std::span<const openvdb::Coord> origins) {
  for (const openvdb::Coord& origin : origins) {
    const Index3 middle = {origin.x() >> 3, origin.y() >> 3, origin.z() >> 3};
    Index3 leaf;
    for (leaf[0] = middle[0] - near_leaves_; leaf[0] <= middle[0] + near_leaves_; ++leaf[0]) {
      for (leaf[1] = middle[1] - near_leaves_; leaf[1] <= middle[1] + near_leaves_; ++leaf[1]) {
        for (leaf[2] = middle[2] - near_leaves_; leaf[2] <= middle[2] + near_leaves_; ++leaf[2]) near_.add(leaf);
      }
    }
  }
}

bool LeftOutPoints::isNear(const Index3& leaf) const {
  const LeafBits* near = near_.in(parentOf(leaf));
  const std::size_t bit = bitInParent(leaf);
  return near != nullptr && ((*near)[bit >> 6] >> (bit & 63) & 1) != 0;
}

LeafBits LeftOutPoints::nearLeftOut(const OpenedLeaf& opened, const LeftOutVoxels& voxels) const {
  LeafBits near = {};
  if (near_.empty() || !isNear(opened.leaf)) return near;
  forEachBit(opened.voxels, [&](std::size_t bit) {
    if (reachesLeftOut(childOf(opened.leaf, bit), voxels)) near[bit >> 6] |= std::uint64_t{1} << (bit & 63);
  });
  return near;
}

void LeftOutPoints::closeCube(const Cube& cube) {
  if (closed_.contains(cube)) return;
  for (std::int64_t n = 0; n < 27; ++n) {
    shadow_.insert({cube[0] + n / 9 - 1, cube[1] + n / 3 % 3 - 1, cube[2] + n % 3 - 1});
  }
  closed_.insert(cube);  // last: what is closed has its shadow
}

/// Larger cubes close more, and there are fewer of them.
void LeftOutPoints::doubleCubes() {
  const std::set<Cube> small = std::move(closed_);
  closed_.clear();
  shadow_.clear();
  edge_m_ *= 2;
  ++doublings_;
  for (const Cube& cube : small) closeCube({cube[0] >> 1, cube[1] >> 1, cube[2] >> 1});
}

void LeftOutPoints::close(const Eigen::Vector3d& centre_W, double radius_m) {
  while (radius_m > edge_m_ && doublings_ < kMostDoublings) doubleCubes();
  const auto cubeOf = [this](double x) { return std::floor(x / edge_m_); };
  const Eigen::Array3d low = (centre_W.array() - radius_m).unaryExpr(cubeOf);
  const Eigen::Array3d high = (centre_W.array() + radius_m).unaryExpr(cubeOf);
  if (!(low.abs().maxCoeff() < kFarthestCube) || !(high.abs().maxCoeff() < kFarthestCube)) return;
  Cube cube;
  const auto first = [&low](Eigen::Index axis) { return static_cast<std::int64_t>(low[axis]); };
  const auto last = [&high](Eigen::Index axis) { return static_cast<std::int64_t>(high[axis]); };
  for (cube[0] = first(0); cube[0] <= last(0); ++cube[0]) {
    for (cube[1] = first(1); cube[1] <= last(1); ++cube[1]) {
      for (cube[2] = first(2); cube[2] <= last(2); ++cube[2]) closeCube(cube);
    }
  }
  while (closed_.size() > kMostCubes && doublings_ < kMostDoublings) doubleCubes();
}

bool LeftOutPoints::restoreCubes(std::uint32_t doublings, const std::vector<Cube>& cubes) {
  if (doublings > kMostDoublings || cubes.size() > kMostCubes) return false;
  for (; doublings_ < doublings; ++doublings_) edge_m_ *= 2;
  for (const Cube& cube : cubes) {
    for (const std::int64_t x : cube) {
      if (!(std::abs(static_cast<double>(x)) < kFarthestCube)) return false;
    }
    closeCube(cube);
  }
  return closed_.size() == cubes.size();
}

bool LeftOutPoints::reachesLeftOut(const Index3& voxel, const LeftOutVoxels& voxels) const {
  const auto low = [&](std::size_t axis) { return voxel[axis] - reach_; };
  const auto high = [&](std::size_t axis) { return voxel[axis] + reach_; };
  Index3 leaf;
  for (leaf[0] = low(0) >> 3; leaf[0] <= high(0) >> 3; ++leaf[0]) {
    for (leaf[1] = low(1) >> 3; leaf[1] <= high(1) >> 3; ++leaf[1]) {
      for (leaf[2] = low(2) >> 3; leaf[2] <= high(2) >> 3; ++leaf[2]) {
        const LeafBits* bits = voxels.find({8 * leaf[0], 8 * leaf[1], 8 * leaf[2]});
        if (bits == nullptr) continue;
        const auto from = [&](std::size_t axis) { return std::max(low(axis) - 8 * leaf[axis], 0); };
        const auto to = [&](std::size_t axis) { return std::min(high(axis) - 8 * leaf[axis], 7); };
        const std::uint64_t row = (0xffu << from(2)) & (0xffu >> (7 - to(2)));
        std::uint64_t rows = 0;
        for (std::int32_t y = from(1); y <= to(1); ++y) rows |= row << (8 * y);
        for (std::int32_t x = from(0); x <= to(0); ++x) {
          if (((*bits)[static_cast<std::size_t>(x)] & rows) != 0) return true;
        }
      }
    }
  }
  return false;
}

void LeftOutPoints::publish(const PointStore& points, const LeftOutVoxels& voxels,
                            const std::vector<std::uint8_t>& gone, const Eigen::Vector3d& origin_W) {
  any_ = !voxels.empty() || !closed_.empty();
  if (!any_) return;
  withheld_ = gone;
  withheld_.resize(std::max<std::size_t>(points.size(), gone.size()), 0);
  if (!voxels.empty()) {
    const ChunkedArray<PointBlock>& blocks = points.index().blocks();
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, blocks.size(), 256), [&](const auto& range) {
      for (std::size_t n = range.begin(); n != range.end(); ++n) {
        const PointBlock& block = blocks[n];
        if (!isNear(block.leaf)) continue;
        for (const std::uint32_t id : block.ids) {
          if (reachesLeftOut(points.voxelOf(points.first_L(id)), voxels)) withheld_[id] = kLeftOut;
        }
      }
    });
  }
  if (closed_.empty()) return;
  tbb::parallel_for(tbb::blocked_range<std::uint32_t>(0, points.size(), 4096), [&](const auto& range) {
    for (std::uint32_t id = range.begin(); id != range.end(); ++id) {
      const Eigen::Vector3d p_W = origin_W + points.first_L(id).template cast<double>();
      const auto cubeOf = [&](Eigen::Index axis) { return static_cast<std::int64_t>(std::floor(p_W[axis] / edge_m_)); };
      if (shadow_.contains({cubeOf(0), cubeOf(1), cubeOf(2)})) withheld_[id] = kLeftOut;
    }
  });
}

std::uint64_t LeftOutPoints::bytes() const {
  constexpr std::uint64_t kSetNode = sizeof(Cube) + 4 * sizeof(void*), kHashNode = sizeof(Cube) + 3 * sizeof(void*);
  return near_.bytes() + closed_.size() * kSetNode + shadow_.size() * kHashNode + withheld_.capacity();
}

}  // namespace accessvdb::internal

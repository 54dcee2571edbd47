// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/query/known_space.h"

#include <openvdb/math/DDA.h>
#include <openvdb/math/Ray.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <memory>

#include "hostdev/capsule.h"
#include "tsdf/leaf_facts.h"

namespace accessvdb::internal {
namespace {

using BoolLeaf = openvdb::BoolTree::LeafNodeType;
using WayRay = openvdb::math::Ray<double>;

std::unique_ptr<BoolLeaf> leafOf(const openvdb::Coord& origin, const LeafChange& facts) {
  auto leaf = std::make_unique<BoolLeaf>(origin, false, false);
  std::uint64_t* const collides = leaf->buffer().data();
  BoolLeaf::NodeMaskType known;
  for (openvdb::Index x = 0; x < 8; ++x) {
    collides[x] = facts.collides_on[x];
    known.getWord<std::uint64_t>(x) = facts.collides_on[x] | facts.arm_free_on[x];
  }
  leaf->setValueMask(known);
  return leaf;
}

bool collidesSomewhere(const BoolLeaf& leaf) {
  const std::uint64_t* const words = leaf.buffer().data();
  return std::any_of(words, words + 8, [](std::uint64_t word) { return word != 0; });
}

/// Whether all voxels of a leaf are known to be free.
bool isWhollyFree(const BoolLeaf& leaf) { return leaf.getValueMask().isOn() && !collidesSomewhere(leaf); }

}  // namespace

openvdb::Index freeVoxels(const BoolLeaf& leaf) {
  openvdb::Index count = 0;
  for (openvdb::Index x = 0; x < 8; ++x) {
    const std::uint64_t known = leaf.getValueMask().getWord<std::uint64_t>(x);
    count += static_cast<openvdb::Index>(std::popcount(known & ~leaf.buffer().data()[x]));
  }
  return count;
}

std::vector<openvdb::Coord> knownLeafOrigins(const PackedMap& map) {
  std::vector<openvdb::Coord> origins;
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) origins.push_back(leaf->origin());
  for (const auto& [origin, voxels] : map.leftOut().inOrder()) origins.push_back(origin);
  std::sort(origins.begin(), origins.end());
  origins.erase(std::unique(origins.begin(), origins.end()), origins.end());
  return origins;
}

KnownSpace::KnownSpace(const PackedMap& map) {
  const std::vector<openvdb::Coord> origins = knownLeafOrigins(map);
  std::vector<std::unique_ptr<BoolLeaf>> leaves(origins.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, origins.size(), 256), [&](const auto& range) {
    ConstPackedAccessor accessor(map.tree());
    for (std::size_t n = range.begin(); n < range.end(); ++n) {
      if (const auto facts = factsAt(map, accessor, origins[n])) leaves[n] = leafOf(origins[n], *facts);
    }
  });
  openvdb::tree::ValueAccessor<openvdb::BoolTree> accessor(tree_), surface(surface_);
  for (std::unique_ptr<BoolLeaf>& leaf : leaves) {
    if (leaf == nullptr) continue;
    if (collidesSomewhere(*leaf)) surface.addLeaf(new BoolLeaf(*leaf));
    accessor.addLeaf(leaf.release());
  }
}

bool KnownSpace::Reader::ballIsFree(const Eigen::Vector3d& centre, double radius) const {
  const double reach = radius + static_cast<double>(kernels::kHalfCellDiagonal), reach2 = reach * reach;
  const auto leafOfCoordinate = [](double x) { return static_cast<std::int32_t>(std::floor(x / 8)); };
  // Most balls that are not free are found here, at a thousandth of the cost.
  for (const double part : {0.9, 0.5}) {
    for (int n = 0; n < 27; ++n) {
      const Eigen::Vector3d way(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1);
      const Eigen::Vector3d p = n == 13 ? centre : Eigen::Vector3d(centre + part * radius * way.normalized());
      if (!isFree(openvdb::Coord::floor(openvdb::Vec3d(p.x(), p.y(), p.z())))) return false;
    }
  }
  openvdb::Coord low, high;
  for (int axis = 0; axis < 3; ++axis) {
    low[axis] = leafOfCoordinate(centre[axis] - reach);
    high[axis] = leafOfCoordinate(centre[axis] + reach);
  }
  openvdb::Coord at;
  for (at[0] = low[0]; at[0] <= high[0]; ++at[0]) {
    for (at[1] = low[1]; at[1] <= high[1]; ++at[1]) {
      for (at[2] = low[2]; at[2] <= high[2]; ++at[2]) {
        const openvdb::Coord origin(8 * at[0], 8 * at[1], 8 * at[2]);
        const BoolLeaf* const leaf = accessor_.probeConstLeaf(origin);
        if (leaf != nullptr && isWhollyFree(*leaf)) continue;
        for (openvdb::Index n = 0; n < BoolLeaf::SIZE; ++n) {
          const openvdb::Coord ijk = origin + BoolLeaf::offsetToLocalCoord(n);
          const Eigen::Vector3d middle(ijk[0] + 0.5, ijk[1] + 0.5, ijk[2] + 0.5);
          if ((middle - centre).squaredNorm() > reach2) continue;
          if (leaf == nullptr || !leaf->isValueOn(n) || leaf->getValue(n)) return false;
        }
      }
    }
  }
  return true;
}

std::array<int, 3> KnownSpace::Reader::collidingOn(const Eigen::Vector3d& from, const Eigen::Vector3d& along,
                                                   const std::array<double, 3>& ends, int most) const {
  std::array<int, 3> count = {};
  const WayRay ray(WayRay::Vec3T(from.x(), from.y(), from.z()), WayRay::Vec3T(along.x(), along.y(), along.z()), 0,
                   ends[2]);
  int all = 0;
  openvdb::math::DDA<WayRay, 3> leaves(ray);
  do {
    const BoolLeaf* const leaf = surface_.probeConstLeaf(leaves.voxel());
    if (leaf == nullptr) continue;
    openvdb::math::DDA<WayRay> voxels(ray, leaves.time(), std::max(leaves.time(), std::min(leaves.next(), ends[2])));
    do {
      // Rounding may begin or end the walk a voxel outside.
      if (leaf->origin() != (voxels.voxel() & ~7) || !leaf->getValue(voxels.voxel())) continue;
      ++count[voxels.time() < ends[0] ? 0 : voxels.time() < ends[1] ? 1 : 2];
      if (++all == most) return count;
    } while (voxels.step());
  } while (leaves.step());
  return count;
}

}  // namespace accessvdb::internal

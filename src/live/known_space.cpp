// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "live/known_space.h"

#include <algorithm>
#include <cmath>

#include "accessvdb/tsdf_volume.h"
#include "io/voxel_rule.h"
#include "tsdf/packed_map.h"

namespace accessvdb::internal {
namespace {

/// Leaf coordinates have 28 bits at most, of which a map of any use takes 21: 2^21 leaves of 1 mm voxels are 16 km.
constexpr int kKeyBits = 21;
constexpr std::int64_t kMostLeaf = std::int64_t{1} << (kKeyBits - 1);

bool fits(std::int64_t x, std::int64_t y, std::int64_t z) {
  const auto inside = [](std::int64_t v) { return v >= -kMostLeaf && v < kMostLeaf; };
  return inside(x) && inside(y) && inside(z);
}

std::uint64_t keyOf(std::int64_t x, std::int64_t y, std::int64_t z) {
  const auto part = [](std::int64_t v) { return static_cast<std::uint64_t>(v + kMostLeaf); };
  return (part(x) << (2 * kKeyBits)) | (part(y) << kKeyBits) | part(z);
}

}  // namespace

KnownSpace::KnownSpace(const AccessibilityField& field)
    : origin_W_(field.origin_W()), voxel_size_m_(field.params().tsdf.voxel_size_m) {
  const PackedMap& map = field.volume().packed();
  leaves_.reserve(map.leaf_count);
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
    const openvdb::Coord& ijk = leaf->origin();
    const std::int64_t x = ijk.x() >> 3, y = ijk.y() >> 3, z = ijk.z() >> 3;
    if (fits(x, y, z)) leaves_.push_back(keyOf(x, y, z));
  }
  std::sort(leaves_.begin(), leaves_.end());
}

bool KnownSpace::contains(const Eigen::Vector3d& p_W) const {
  constexpr double kMostVoxel = static_cast<double>(kMostLeaf) * 8 - 1;
  const Eigen::Vector3d p_L = p_W - origin_W_;
  const auto voxelOf = [this](double x_m) { return voxelOfCoordinate(x_m, voxel_size_m_); };
  const Eigen::Vector3d voxel(voxelOf(p_L.x()), voxelOf(p_L.y()), voxelOf(p_L.z()));
  if (!(voxel.cwiseAbs().maxCoeff() <= kMostVoxel) || !voxel.allFinite()) return false;
  const auto leaf = [&](int axis) { return static_cast<std::int64_t>(voxel[axis]) >> 3; };
  return std::binary_search(leaves_.begin(), leaves_.end(), keyOf(leaf(0), leaf(1), leaf(2)));
}

}  // namespace accessvdb::internal

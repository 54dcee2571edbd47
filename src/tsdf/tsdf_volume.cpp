// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "accessvdb/tsdf_volume.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <cstdint>
#include <vector>

#include "tsdf/packed_map.h"
#include "vdb/standard_grids.h"

namespace accessvdb {
namespace {

using internal::PackedLeaf;

/// The tile of a map that is not cut.
constexpr FieldWindow kEverything = {{INT32_MIN, INT32_MIN}, {INT32_MAX, INT32_MAX}};

std::vector<const PackedLeaf*> leavesOf(const internal::PackedTree& tree, const FieldWindow& tile = kEverything) {
  std::vector<const PackedLeaf*> leaves;
  leaves.reserve(tree.leafCount());
  tree.getNodes(leaves);
  std::erase_if(leaves, [&tile](const PackedLeaf* leaf) {
    const openvdb::Coord& ijk = leaf->origin();
    return ijk.x() < tile.core_low[0] || ijk.x() >= tile.core_high[0] || ijk.y() < tile.core_low[1] ||
           ijk.y() >= tile.core_high[1];
  });
  return leaves;
}

/// Builds a grid leaf by leaf in parallel, then links the leaves. `fill` returns false if the leaf is to be dropped.
template <typename GridT, typename Fill>
typename GridT::Ptr buildGrid(const internal::PackedMap& map, const FieldWindow& tile, const char* name,
                              const typename GridT::ValueType& background, const Fill& fill) {
  using Leaf = typename GridT::TreeType::LeafNodeType;
  const auto sources = leavesOf(map.tree(), tile);
  std::vector<Leaf*> built(sources.size(), nullptr);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, sources.size(), 256), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      auto leaf = std::make_unique<Leaf>(sources[n]->origin(), background, false);
      if (fill(*sources[n], *leaf)) built[n] = leaf.release();
    }
  });
  auto grid = GridT::create(background);
  grid->setName(name);
  grid->setTransform(openvdb::math::Transform::createLinearTransform(map.params().voxel_size_m));
  openvdb::tree::ValueAccessor<typename GridT::TreeType, false> accessor(grid->tree());
  for (Leaf* leaf : built) {
    if (leaf != nullptr) accessor.addLeaf(leaf);
  }
  return grid;
}

}  // namespace

TsdfVolume::TsdfVolume(const TsdfParams& params) : packed_(std::make_unique<internal::PackedMap>(params)) {
  openvdb::initialize();
}
TsdfVolume::~TsdfVolume() = default;
TsdfVolume::TsdfVolume(TsdfVolume&&) noexcept = default;
TsdfVolume& TsdfVolume::operator=(TsdfVolume&&) noexcept = default;

const TsdfParams& TsdfVolume::params() const { return packed_->params(); }
double TsdfVolume::voxelSize_m() const { return packed_->params().voxel_size_m; }
double TsdfVolume::truncationDistance_m() const { return packed_->params().truncation_distance_m; }
VoxelState TsdfVolume::at(const openvdb::Coord& ijk) const { return packed_->at(ijk); }

openvdb::FloatGrid::Ptr TsdfVolume::distance() const { return distance(kEverything); }
openvdb::FloatGrid::Ptr TsdfVolume::weight() const { return weight(kEverything); }
openvdb::BoolGrid::Ptr TsdfVolume::cleared() const { return cleared(kEverything); }

openvdb::FloatGrid::Ptr TsdfVolume::distance(const FieldWindow& tile) const {
  const internal::PackedMap& map = *packed_;
  const auto tau = static_cast<float>(map.params().truncation_distance_m);
  auto grid = buildGrid<openvdb::FloatGrid>(map, tile, "distance", tau, [&map](const PackedLeaf& from, auto& to) {
    internal::LeafValues::Room room;
    const std::uint32_t* packed = internal::LeafValues(from).all(room);
    if (packed == nullptr) return false;
    const internal::VoxelVotes* votes = map.votesOf(from);
    for (openvdb::Index n = 0; n < PackedLeaf::SIZE; ++n) {
      if (internal::weightOf(packed[n]) == 0) continue;
      const bool blocked = votes != nullptr && votes->blockedAt(n);
      to.setValueOn(n, blocked ? 0 : map.distanceOf(internal::meanOf(packed[n])));
    }
    return true;
  });
  grid->setGridClass(openvdb::GRID_UNKNOWN);  // clamped at zero: there is no zero crossing, so it is not a level set
  return grid;
}

openvdb::FloatGrid::Ptr TsdfVolume::weight(const FieldWindow& tile) const {
  return buildGrid<openvdb::FloatGrid>(*packed_, tile, "weight", 0.0f, [](const PackedLeaf& from, auto& to) {
    internal::LeafValues::Room room;
    const std::uint32_t* packed = internal::LeafValues(from).all(room);
    if (packed == nullptr) return false;
    for (openvdb::Index n = 0; n < PackedLeaf::SIZE; ++n) {
      const std::uint32_t weight = internal::weightOf(packed[n]);
      if (weight > 0) to.setValueOn(n, static_cast<float>(weight));
    }
    return true;
  });
}

openvdb::BoolGrid::Ptr TsdfVolume::cleared(const FieldWindow& tile) const {
  const internal::PackedMap& map = *packed_;
  return buildGrid<openvdb::BoolGrid>(map, tile, "cleared", false, [&map](const PackedLeaf& from, auto& to) {
    const LeafBits confirmed = map.confirmedIn(from);
    if (confirmed == LeafBits{}) return false;
    for (openvdb::Index n = 0; n < PackedLeaf::SIZE; ++n) {
      if ((confirmed[n >> 6] >> (n & 63) & 1) != 0) to.setValueOn(n, true);
    }
    return true;
  });
}

std::uint64_t TsdfVolume::leafCount() const { return packed_->leaf_count; }
std::uint64_t TsdfVolume::activeVoxelCount() const { return packed_->observed_voxels; }
std::uint64_t TsdfVolume::memoryBytes() const { return packed_->memoryBytes(); }

openvdb::CoordBBox TsdfVolume::leafBounds() const {
  // Not evalLeafBoundingBox(): it skips leaves without active voxels, and ours may be observed but never cleared.
  openvdb::CoordBBox box;
  for (const PackedLeaf* leaf : leavesOf(packed_->tree())) box.expand(leaf->getNodeBoundingBox());
  return box;
}

}  // namespace accessvdb

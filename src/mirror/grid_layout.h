// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where the parts of a NanoVDB grid patched in place are, and its head.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>

#include "hostdev/nanovdb_compat.h"
#include "launch/leaf_patch.h"

namespace accessvdb::internal {

/// Bytes of a leaf before its value mask.
inline constexpr std::uint32_t kHeadBytes = 16;

/// The grid layout that patches rely on. A NanoVDB version that changes it must not compile, and says what changed.
template <class Build>
struct GridLayout {
  using GridData = typename nanovdb::NanoGrid<Build>::DataType;
  using TreeData = typename nanovdb::NanoTree<Build>::DataType;
  using RootData = typename nanovdb::NanoRoot<Build>::DataType;
  using UpperData = typename nanovdb::NanoUpper<Build>::DataType;
  using LowerData = typename nanovdb::NanoLower<Build>::DataType;
  using LeafData = typename nanovdb::NanoLeaf<Build>::DataType;

  static constexpr std::uint64_t kTree = sizeof(GridData);
  static constexpr std::uint64_t kRoot = kTree + sizeof(TreeData);
  static constexpr std::uint64_t kTiles = kRoot + sizeof(RootData);

  static_assert(kTiles % NANOVDB_DATA_ALIGNMENT == 0, "NanoVDB: grid, tree and root are no longer aligned");
  static_assert(sizeof(UpperData) == 270400, "NanoVDB: another size of upper nodes");
  static_assert(sizeof(LowerData) == 33856, "NanoVDB: another size of lower nodes");
  static_assert(sizeof(typename UpperData::Tile) == 8, "NanoVDB: another size of an upper node's tiles");
  static_assert(sizeof(typename RootData::Tile) == 32, "NanoVDB: another size of the root's tiles");
  static_assert(sizeof(UpperData) % kernels::LeafPatch::kUnit == 0 &&
                    sizeof(LowerData) % kernels::LeafPatch::kUnit == 0 &&
                    sizeof(LeafData) % kernels::LeafPatch::kUnit == 0 &&
                    sizeof(typename RootData::Tile) % kernels::LeafPatch::kUnit == 0,
                "NanoVDB: nodes are no longer whole units of a patch");
  static_assert(offsetof(LeafData, mBBoxMin) == 0, "NanoVDB: a leaf no longer begins with its origin");
  static_assert(offsetof(LeafData, mValueMask) == kHeadBytes, "NanoVDB: a leaf's value mask is elsewhere");
  static_assert(std::is_same_v<typename RootData::KeyT, std::uint64_t>, "NanoVDB: another key of the root's tiles");

  struct Head {
    alignas(NANOVDB_DATA_ALIGNMENT) std::byte bytes[kTiles] = {};
  };
  /// Everything before the root tiles, for a grid without any.
  /// @param voxel_size_m  scale from index space to the local frame
  static Head head(const char* name, nanovdb::GridType type, double voxel_size_m, Build background,
                   std::uint64_t grid_bytes) {
    // NanoVDB's node data have no constructors: they are bytes reinterpreted.
    Head head;
    auto* grid = reinterpret_cast<GridData*>(head.bytes);
    grid->mMagic = kernels::kGridMagic;
    std::memset(static_cast<void*>(&grid->mChecksum), 0xFF, sizeof(grid->mChecksum));  // disabled: patches change it
    grid->mVersion = nanovdb::Version();
    grid->mFlags = 0;  // not breadth first, no boxes, no extrema: only the voxels are kept up to date
    grid->mGridIndex = 0;
    grid->mGridCount = 1;
    grid->mGridSize = grid_bytes;
    std::memcpy(grid->mGridName, name, std::strlen(name) + 1);
    grid->mMap.set(voxel_size_m, nanovdb::Vec3d(0.0), 1.0);
    grid->mWorldBBox = {};
    grid->mVoxelSize = nanovdb::Vec3d(voxel_size_m);
    grid->mGridClass = nanovdb::GridClass::Unknown;
    grid->mGridType = type;
    reinterpret_cast<TreeData*>(head.bytes + kTree)->mNodeOffset[3] = sizeof(TreeData);
    auto* root = reinterpret_cast<RootData*>(head.bytes + kRoot);
    root->mBBox = nanovdb::CoordBBox();
    root->mBackground = background;
    return head;
  }
};
static_assert(sizeof(GridLayout<bool>::LeafData) == 160, "NanoVDB: another size of leaves of bool");
static_assert(sizeof(GridLayout<float>::LeafData) == 2144, "NanoVDB: another size of leaves of float");

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A tool at any pose against the voxels of a map.
///
/// The tool is a bitmap in its own frame, several nodes to a voxel. It holds every node of which a voxel with its
/// centre there may be entered by the tool, whichever way it is turned: so each voxel is decided by one bit, no voxel
/// that the tool enters is missed, and one that counts is less than two voxels from the tool.
#pragma once

#include <cmath>
#include <cstdint>

#include "capsule.h"

namespace accessvdb::kernels {

/// Bits of nodes in the tool's frame.
struct NodeBitmap {
  const std::uint64_t* words = nullptr;  ///< [size[0] x size[1] x words_z] bit z % 64 of word z / 64
  std::int32_t size[3] = {0, 0, 0};      ///< nodes
  std::int32_t words_z = 0;
  float low[3] = {0, 0, 0};  ///< the first node's centre minus half a node; in nodes from the tip
  float nodes_per_voxel = 1;

  /// @param y  place in the tool's frame, in nodes from the first one's lower corner
  [[nodiscard]] ACCESSVDB_HOSTDEV bool has(float x, float y, float z) const {
    const auto i = static_cast<std::int32_t>(x), j = static_cast<std::int32_t>(y), k = static_cast<std::int32_t>(z);
    if (!(x >= 0 && y >= 0 && z >= 0) || i >= size[0] || j >= size[1] || k >= size[2]) return false;
    return (words[(i * size[1] + j) * static_cast<std::int64_t>(words_z) + (k >> 6)] >> (k & 63) & 1) != 0;
  }
};

/// @see src/tool/tool_bitmap.h
struct ToolBitmapView : NodeBitmap {
  /// Has the place of the centre of each block of 4^3 voxels of which any may be entered, and is coarser: most voxels
  /// around a tool are decided by it.
  NodeBitmap blocks;
};

/// Where a tool is, relative to the voxel of its tip, so that float32 is enough anywhere in the map.
struct ToolPlace {
  std::int32_t anchor[3] = {0, 0, 0};           ///< voxel of the tip
  float tip[3] = {0, 0, 0};                     ///< from its centre, voxels
  float turn[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};  ///< rows: the tool's axes in the map's frame
};

/// Whether a matrix turns, and does nothing else. @param R  [9] in any order
ACCESSVDB_HOSTDEV inline bool isRotation(const double* R) {
  constexpr double kSlackOfRotation = 1e-5;
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) {
      const double dot = R[3 * i] * R[3 * j] + R[3 * i + 1] * R[3 * j + 1] + R[3 * i + 2] * R[3 * j + 2];
      if (!(fabs(dot - (i == j ? 1 : 0)) <= kSlackOfRotation)) return false;
    }
  }
  return R[0] * (R[4] * R[8] - R[5] * R[7]) - R[1] * (R[3] * R[8] - R[5] * R[6]) + R[2] * (R[3] * R[7] - R[4] * R[6]) >
         0;
}

/// @param R_LT  [9] rotation, local frame from tool, column by column  @param tip_L  metres
/// @return false if it is no rotation or the tip has no voxel
ACCESSVDB_HOSTDEV inline bool makeToolPlace(const double* R_LT, const double* tip_L, float inverse_voxel_size,
                                            ToolPlace& place) {
  const double per_voxel = inverse_voxel_size;
  if (!hasVoxel(tip_L, per_voxel) || !isRotation(R_LT)) return false;
  for (int axis = 0; axis < 3; ++axis) {
    const double tip = tip_L[axis] * per_voxel, whole = floor(tip + 0.5);
    place.anchor[axis] = static_cast<std::int32_t>(whole);
    place.tip[axis] = static_cast<float>(tip - whole);
  }
  for (int n = 0; n < 9; ++n) place.turn[n] = static_cast<float>(R_LT[n]);
  return true;
}

/// What a tool meets, in voxels.
struct ToolFit {
  std::uint32_t collisions = 0, unknown = 0;
  bool valid = false;                  ///< false: a bad pose, or a tool that reaches too far; nothing was looked at
  std::uint8_t unused[3] = {0, 0, 0};  ///< so that each byte of an array of these is written
};

namespace tool_fit {

ACCESSVDB_HOSTDEV inline std::uint32_t countOf(std::uint64_t word) {
#if defined(__CUDA_ARCH__)
  return static_cast<std::uint32_t>(__popcll(word));
#else
  word = word - (word >> 1 & 0x5555555555555555u);
  word = (word & 0x3333333333333333u) + (word >> 2 & 0x3333333333333333u);
  return static_cast<std::uint32_t>(((word + (word >> 4)) & 0x0f0f0f0f0f0f0f0fu) * 0x0101010101010101u >> 56);
#endif
}

inline constexpr float kSlackOfBox = 0.02f;  ///< exceeds the rounding error of a position
inline constexpr std::int64_t kMostLeaves = 1 << 20;

/// A place in the tool's frame, in nodes from the bitmap's lower corner. @param x  [3] voxels from the anchor's centre
ACCESSVDB_HOSTDEV inline void toNodes(const ToolPlace& place, const NodeBitmap& tool, const float* x, float* y) {
  const float e[3] = {x[0] - place.tip[0], x[1] - place.tip[1], x[2] - place.tip[2]};
  for (int a = 0; a < 3; ++a) {
    const float* axis = place.turn + 3 * a;
    y[a] = (axis[0] * e[0] + axis[1] * e[1] + axis[2] * e[2]) * tool.nodes_per_voxel - tool.low[a];
  }
}

/// Whether any of a box of voxels may be in the bitmap's box. @param middle, half  [3] of the voxels' centres
ACCESSVDB_HOSTDEV inline bool mayReach(const ToolPlace& place, const ToolBitmapView& tool, const float* middle,
                                       const float* half) {
  float y[3];
  toNodes(place, tool, middle, y);
  for (int a = 0; a < 3; ++a) {
    const float* axis = place.turn + 3 * a;
    const float far = (fabsf(axis[0]) * half[0] + fabsf(axis[1]) * half[1] + fabsf(axis[2]) * half[2] + kSlackOfBox) *
                      tool.nodes_per_voxel;
    if (y[a] < -far || y[a] > static_cast<float>(tool.size[a]) + far) return false;
  }
  return true;
}

/// The leaves around the bitmap's box, turned. @param first, last  [3] out: leaves  @return their number
ACCESSVDB_HOSTDEV inline std::int64_t leavesAround(const ToolPlace& place, const ToolBitmapView& tool,
                                                   std::int32_t* first, std::int32_t* last) {
  std::int64_t leaves = 1;
  for (int axis = 0; axis < 3; ++axis) {
    float middle = place.tip[axis], half = kSlackOfBox;
    for (int a = 0; a < 3; ++a) {
      const float along = place.turn[3 * a + axis] / tool.nodes_per_voxel, size = static_cast<float>(tool.size[a]);
      middle += along * (tool.low[a] + 0.5f * size);
      half += fabsf(along) * 0.5f * size;
    }
    first[axis] = (place.anchor[axis] + static_cast<std::int32_t>(floorf(middle - half))) >> 3;
    last[axis] = (place.anchor[axis] + static_cast<std::int32_t>(ceilf(middle + half))) >> 3;
    leaves *= last[axis] - first[axis] + 1;
  }
  return leaves;
}

inline constexpr int kBlock = 4;  ///< voxels, along each edge of ToolBitmapView::blocks

/// Which blocks of a leaf the tool may enter: bit 4 x + 2 y + z of the block's place. @param corner  [3] as
/// toolVoxels()
ACCESSVDB_HOSTDEV inline std::uint32_t blocksOf(const ToolPlace& place, const ToolBitmapView& tool,
                                                const float* corner) {
  const float middle[3] = {corner[0] + 1.5f, corner[1] + 1.5f, corner[2] + 1.5f};
  float first[3];
  toNodes(place, tool.blocks, middle, first);
  std::uint32_t found = 0;
  for (int block = 0; block < 8; ++block) {
    float y[3];
    for (int a = 0; a < 3; ++a) {
      const float* axis = place.turn + 3 * a;
      const float along = ((block & 4) != 0 ? axis[0] : 0.0f) + ((block & 2) != 0 ? axis[1] : 0.0f) +
                          ((block & 1) != 0 ? axis[2] : 0.0f);
      y[a] = first[a] + static_cast<float>(kBlock) * along * tool.blocks.nodes_per_voxel;
    }
    found |= (tool.blocks.has(y[0], y[1], y[2]) ? 1U : 0U) << block;
  }
  return found;
}

/// The voxels of those blocks in slice x of the leaf.
ACCESSVDB_HOSTDEV inline std::uint64_t voxelsOf(std::uint32_t blocks, int x) {
  const std::uint32_t of_slice = blocks >> (x < kBlock ? 0 : 4);
  const std::uint64_t low = ((of_slice & 1) != 0 ? 0x0f0f0f0fu : 0u) | ((of_slice & 2) != 0 ? 0xf0f0f0f0u : 0u);
  const std::uint64_t high = ((of_slice & 4) != 0 ? 0x0f0f0f0fu : 0u) | ((of_slice & 8) != 0 ? 0xf0f0f0f0u : 0u);
  return low | high << 32;
}

/// Eight voxels above each other: bit z. @param y, step  [3] in nodes: the lowest, and from one to the next
struct PlainRows {
  ACCESSVDB_HOSTDEV std::uint32_t operator()(const ToolBitmapView& tool, const float* y, const float* step) const {
    std::uint32_t found = 0;
    for (int z = 0; z < 8; ++z) {
      const float up = static_cast<float>(z);
      const bool has = tool.has(y[0] + up * step[0], y[1] + up * step[1], y[2] + up * step[2]);
      found |= (has ? 1U : 0U) << z;
    }
    return found;
  }
};

/// Which of a slice of a leaf's voxels the tool may enter: bit 8 y + z, as a leaf has them.
/// @param corner  [3] the slice's lowest voxel minus the anchor  @param wanted  the voxels that matter
template <typename Rows>
ACCESSVDB_HOSTDEV std::uint64_t toolVoxels(const ToolPlace& place, const ToolBitmapView& tool, const float* corner,
                                           std::uint64_t wanted, const Rows& rows) {
  std::uint64_t found = 0;
  float first[3], across[3], step[3];  // nodes: of the lowest voxel, and from one to the next
  toNodes(place, tool, corner, first);
  for (int a = 0; a < 3; ++a) {
    across[a] = place.turn[3 * a + 1] * tool.nodes_per_voxel;
    step[a] = place.turn[3 * a + 2] * tool.nodes_per_voxel;
  }
  for (int row = 0; row < 8; ++row) {
    if ((wanted >> (8 * row) & 0xff) == 0) continue;
    const float up = static_cast<float>(row);
    const float y[3] = {first[0] + up * across[0], first[1] + up * across[1], first[2] + up * across[2]};
    found |= static_cast<std::uint64_t>(rows(tool, y, step)) << (8 * row);
  }
  return found & wanted;
}

}  // namespace tool_fit

/// What suffices: the counts are then lower bounds. 0: all are counted.
struct EnoughOfFit {
  std::uint32_t collisions = 0, unknown = 0;
  [[nodiscard]] ACCESSVDB_HOSTDEV bool has(std::uint32_t collisions_found, std::uint32_t unknown_found) const {
    return (collisions != 0 && collisions_found >= collisions) || (unknown != 0 && unknown_found >= unknown);
  }
};

/// @param rows     tool_fit::PlainRows, or what gives the same faster
template <typename Rows = tool_fit::PlainRows>
ACCESSVDB_HOSTDEV ToolFit toolFit(const OccupancyView& map, const ToolBitmapView& tool, const ToolPlace& place,
                                  const EnoughOfFit& enough = {}, const Rows& rows = {}) {
  ToolFit fit;
  std::int32_t first[3], last[3];
  const std::int64_t leaves = tool_fit::leavesAround(place, tool, first, last);
  if (leaves > tool_fit::kMostLeaves) return fit;
  fit.valid = true;
  const OccupancyReader reader(map);
  for (std::int32_t i = first[0]; i <= last[0]; ++i) {
    for (std::int32_t j = first[1]; j <= last[1]; ++j) {
      for (std::int32_t k = first[2]; k <= last[2]; ++k) {
        const Coord origin(i * 8, j * 8, k * 8);
        const float corner[3] = {static_cast<float>(origin[0] - place.anchor[0]),
                                 static_cast<float>(origin[1] - place.anchor[1]),
                                 static_cast<float>(origin[2] - place.anchor[2])};
        const float middle[3] = {corner[0] + 3.5f, corner[1] + 3.5f, corner[2] + 3.5f}, half[3] = {3.5f, 3.5f, 3.5f};
        if (!tool_fit::mayReach(place, tool, middle, half)) continue;
        const std::uint32_t blocks = tool_fit::blocksOf(place, tool, corner);
        if (blocks == 0) continue;
        const OccupancyLeaf* leaf = reader.leafAt(origin);
        const auto* collides =
            leaf == nullptr ? nullptr : reinterpret_cast<const std::uint64_t*>(&leaf->data()->mValues);
        const auto* free =
            leaf == nullptr ? nullptr : reinterpret_cast<const std::uint64_t*>(&leaf->data()->mValueMask);
        for (int x = 0; x < 8; ++x) {
          const std::uint64_t hit = collides == nullptr ? 0 : collides[x];
          const std::uint64_t unknown = leaf == nullptr ? ~std::uint64_t{0} : ~(free[x] | hit);
          const std::uint64_t wanted = (hit | unknown) & tool_fit::voxelsOf(blocks, x);
          if (wanted == 0) continue;
          const float low[3] = {corner[0] + static_cast<float>(x), corner[1], corner[2]};
          const std::uint64_t found = tool_fit::toolVoxels(place, tool, low, wanted, rows);
          fit.collisions += tool_fit::countOf(found & hit);
          fit.unknown += tool_fit::countOf(found & unknown);
          if (enough.has(fit.collisions, fit.unknown)) return fit;
        }
      }
    }
  }
  return fit;
}

}  // namespace accessvdb::kernels

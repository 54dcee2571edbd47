// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Finds the flips around a leaf with a warp: it looks up the tiles around it, and lists their columns that hold flips,
/// of which there are few.
#pragma once

#include <cstdint>

#include "cuda/search/warp.cuh"
#include "cuda/update/update_views.cuh"

namespace accessvdb::kernels {

/// Calls visit(n, whether it is wanted) with one flipped leaf of a column per lane; those in layers z_low .. z_high are
/// wanted. All lanes call it, and visit. @param n  the first leaf, or kNoIndex: there is none
template <class Visit>
__device__ void forEachInLayers(const FlipLink* links, std::uint32_t n, std::int32_t z_low, std::int32_t z_high,
                                const Visit& visit) {
  while (__any_sync(kAllLanes, n != kNoIndex)) {
    const FlipLink link = n != kNoIndex ? links[n] : FlipLink{kNoIndex, 0};
    visit(n, n != kNoIndex && link.z >= z_low && link.z <= z_high);
    n = link.next;
  }
}

/// A tile near some leaf; one tile per lane.
struct TileNear {
  std::uint32_t tile = kNoIndex;
  std::int32_t dx = 0, dy = 0, dz = 0;  ///< [leaves] to its lowest corner
  std::uint64_t occupied = 0;           ///< FlipsView::occupied
};

__device__ inline TileNear tileNear(const FlipsView& flips, std::uint64_t key, std::int32_t dx, std::int32_t dy,
                                    std::int32_t dz) {
  TileNear near = {kNoIndex, dx, dy, dz, 0};
  const std::uint32_t slot = flips.hash.find(key);
  if (slot == kNoIndex) return near;
  near.tile = flips.tile_at[slot];
  near.occupied = flips.occupied[near.tile];
  return near;
}

/// Columns of flips that a warp lists at a time.
constexpr int kMostListed = 256;

/// A column of flips near some leaf; one column per lane.
struct ColumnNear {
  bool there;
  std::uint32_t column;     ///< in FlipsView
  std::int32_t dx, dy, dz;  ///< [leaves] to its lowest leaf
};

/// @tparam Visit  visit(column), called by all lanes
template <class Visit>
class ColumnsNear {
 public:
  /// @param leaf  distances count from here  @param list  [kMostListed] shared by the warp
  __device__ ColumnsNear(const FlipsView& flips, const std::int32_t* leaf, std::uint16_t* list, int lane,
                         const Visit& visit)
      : flips_(flips), leaf_(leaf), list_(list), lane_(lane), visit_(visit) {}

  /// Visits the columns of all tiles that reach into a box. All lanes. @param lowest, highest  [leaves] inclusive
  __device__ void scan(const std::int32_t* lowest, const std::int32_t* highest) {
    constexpr int kLog2[3] = {FlipsView::kTileLog2, FlipsView::kTileLog2, 4};
    std::int32_t low[3], size[3];  // [tiles]
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = (leaf_[axis] + lowest[axis]) >> kLog2[axis];
      size[axis] = ((leaf_[axis] + highest[axis]) >> kLog2[axis]) - low[axis] + 1;
    }
    const int count = size[0] * size[1] * size[2];
    for (int base = 0; base < count; base += static_cast<int>(kWarp)) {
      const int n = base + lane_;
      TileNear near;
      if (n < count) {
        const std::int32_t x = low[0] + n / size[2] / size[1], y = low[1] + n / size[2] % size[1],
                           z = low[2] + n % size[2];
        near = tileNear(flips_, placeKey(x, y, z), (x << kLog2[0]) - leaf_[0], (y << kLog2[1]) - leaf_[1],
                        (z << kLog2[2]) - leaf_[2]);
      }
      scanTiles(near);
    }
  }

 private:
  /// One tile per lane.
  __device__ void scanTiles(const TileNear& mine) {
    int listed = 0;
    // Visits stand in a single place, which keeps kernels in the instruction cache.
    for (unsigned left = __ballot_sync(kAllLanes, mine.occupied != 0);;) {
      if (left != 0 && listed <= kMostListed - 64) {
        const int owner = __ffs(static_cast<int>(left)) - 1;
        left &= left - 1;
        const std::uint64_t occupied = __shfl_sync(kAllLanes, mine.occupied, owner);
#pragma unroll
        for (int half = 0; half < 2; ++half) {
          const auto some = static_cast<std::uint32_t>(occupied >> (32 * half));
          if ((some >> lane_ & 1u) != 0) {
            list_[listed + __popc(some & ((1u << lane_) - 1u))] =
                static_cast<std::uint16_t>(owner << 6 | half << 5 | lane_);
          }
          listed += __popc(some);
        }
        continue;
      }
      visitListed(mine, listed);
      if (left == 0) return;
      listed = 0;
    }
  }

  /// One column per lane.
  __device__ void visitListed(const TileNear& mine, int count) {
    __syncwarp();
    for (int first = 0; first < count; first += static_cast<int>(kWarp)) {
      const int n = first + lane_;
      const bool there = n < count;
      const std::uint32_t entry = list_[there ? n : 0], place = entry & 63u;
      const int owner = static_cast<int>(entry >> 6);
      const std::uint32_t column = __shfl_sync(kAllLanes, mine.tile, owner) * FlipsView::kColumns + place;
      visit_(ColumnNear{there, column, __shfl_sync(kAllLanes, mine.dx, owner) + static_cast<std::int32_t>(place >> 3),
                        __shfl_sync(kAllLanes, mine.dy, owner) + static_cast<std::int32_t>(place & 7u),
                        __shfl_sync(kAllLanes, mine.dz, owner)});
    }
    __syncwarp();  // the list is overwritten next
  }

  const FlipsView& flips_;
  const std::int32_t* leaf_;
  std::uint16_t* list_;
  int lane_;
  const Visit& visit_;
};

}  // namespace accessvdb::kernels

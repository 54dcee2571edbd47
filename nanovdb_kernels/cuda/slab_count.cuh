// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Counts the tool's collisions leaf by leaf: first the leaves that it touches are asked whether anything in them
/// collides at all, a leaf a lane; the few that are left meet the slabs of the tool, eight lanes a leaf.
#pragma once

#include <cstdint>

#include "cuda/warp.cuh"
#include "hostdev/views.h"

namespace accessvdb::kernels {

/// Leaves in which something collides, in shared memory, a list a warp.
struct BusyLeaves {
  static constexpr int kTurn = 16;  ///< leaves of a column asked at a time
  static constexpr int kMost = 5 * static_cast<int>(kWarp);
  struct Leaf {
    std::uint32_t entry;   ///< of the window
    std::uint32_t column;  ///< which column << 16 | which of its leaves
  };
  Leaf list[kMost];
};

/// What a warp counts: the tool at one direction, placed at the voxel of a point.
template <class Window>
class SlabCount {
 public:
  __device__ SlabCount(const Window& window, const ToolSlabsView& slabs, int d, const Coord& point_ijk,
                       BusyLeaves& busy, int lane)
      : window_(window),
        point_ijk_(point_ijk),
        busy_(busy),
        lane_(lane),
        box_(slabs.boxes[8 * d + (point_ijk[1] & 7)]) {
    words_ = slabs.words + box_.first;
    const std::uint32_t* begin = slabs.begin + (64 * d + 8 * (point_ijk[0] & 7) + (point_ijk[1] & 7));
    columns_ = slabs.columns + begin[0];
    num_columns_ = static_cast<int>(begin[1] - begin[0]);
    // Slabs of the tool begin at the voxel of the point, those of the map at multiples of eight: a leaf of the map
    // meets the lower part of one slab in its bits shift .. 7, and the upper part of the one below in the others.
    shift_ = point_ijk[2] & 7;
    high_ = (0xffu << shift_ & 0xffu) * 0x01010101u;
  }

  /// Stops once the collisions exceed `stop_above`; exact up to there.
  __device__ int upTo(int stop_above) const {
    int count = 0;
    for (int first = 0; first < num_columns_ && count <= stop_above; first += static_cast<int>(kWarp)) {
      const int n = first + lane_;
      const LeafColumn column = n < num_columns_ ? columns_[n] : LeafColumn{};
      const int leaves = column.count > 0 && shift_ != 0 ? column.count + 1 : column.count;
      const int most = __reduce_max_sync(kAllLanes, leaves);
      const int x = (point_ijk_[0] & ~7) + 8 * column.leaf_dx, y = (point_ijk_[1] & ~7) + 8 * column.leaf_dy,
                z = (point_ijk_[2] & ~7) + 8 * column.slab_dz;
      int listed = 0;
      for (int low = 0; low < most; low += BusyLeaves::kTurn) {
        const int asked = min(max(leaves - low, 0), BusyLeaves::kTurn);
        const std::uint32_t found = asked > 0 ? window_.busyLeaves(x, y, z + 8 * low, asked) : 0;
        for (std::uint32_t any = __reduce_or_sync(kAllLanes, found); any != 0; any &= any - 1) {
          const int k = __ffs(static_cast<int>(any)) - 1;
          const bool mine = (found >> k & 1u) != 0;
          const unsigned all = __ballot_sync(kAllLanes, mine);
          if (mine) {
            busy_.list[listed + __popc(all & ((1u << lane_) - 1u))] = {window_.entryOf(x, y, z + 8 * (low + k)),
                                                                       static_cast<std::uint32_t>(n << 16 | (low + k))};
          }
          listed += __popc(all);
          if (listed > BusyLeaves::kMost - static_cast<int>(kWarp)) {
            count += collisionsIn(listed);
            listed = 0;
          }
        }
      }
      if (listed > 0) count += collisionsIn(listed);
    }
    return count;
  }

 private:
  /// Collisions in the leaves on the list; all lanes.
  __device__ int collisionsIn(int listed) const {
    __syncwarp();
    const int own_x = lane_ & 7;
    int mine = 0;
    for (int first = 0; first < listed; first += static_cast<int>(kWarp) / 8) {
      const int n = first + (lane_ >> 3);
      if (n >= listed) break;
      const BusyLeaves::Leaf leaf = busy_.list[n];
      const LeafColumn column = columns_[leaf.column >> 16];
      const int x = 8 * column.leaf_dx + own_x - (point_ijk_[0] & 7) - box_.dx;
      if (x < 0 || x >= box_.size_x) continue;
      const int z = column.slab_dz + static_cast<int>(leaf.column & 0xffffu) - box_.slab_dz;
      const std::uint64_t* slab = words_ + ((column.leaf_dy - box_.leaf_dy) * box_.size_x + x) * box_.size_z + z;
      const std::uint64_t map = window_.slabOf(leaf.entry, own_x), upper = z < box_.size_z ? slab[0] : 0,
                          lower = z > 0 ? slab[-1] : 0;
      mine +=
          half(static_cast<std::uint32_t>(map), static_cast<std::uint32_t>(upper), static_cast<std::uint32_t>(lower)) +
          half(static_cast<std::uint32_t>(map >> 32), static_cast<std::uint32_t>(upper >> 32),
               static_cast<std::uint32_t>(lower >> 32));
    }
    __syncwarp();  // all have read the list
    return __reduce_add_sync(kAllLanes, mine);
  }
  __device__ int half(std::uint32_t map, std::uint32_t upper, std::uint32_t lower) const {
    // Bytes are shifted on their own: what comes in from the next one is masked.
    return __popc(map & ((upper << shift_ & high_) | (lower >> (8 - shift_) & ~high_)));
  }

  const Window& window_;
  const Coord& point_ijk_;
  BusyLeaves& busy_;
  int lane_;
  SlabBox box_;
  const std::uint64_t* words_;
  const LeafColumn* columns_;
  int num_columns_;
  int shift_;
  std::uint32_t high_;
};

}  // namespace accessvdb::kernels

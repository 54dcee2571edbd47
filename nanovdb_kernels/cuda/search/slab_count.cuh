// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Counts the tool's collisions leaf by leaf: first it looks up which leaves touched by the tool contain any collision
/// at all, one column of leaves per lane. These few go on a list and are compared with the tool's slabs, eight lanes
/// per leaf.
#pragma once

#include <cstdint>

#include "cuda/search/busy_window.cuh"
#include "hostdev/views.h"

namespace accessvdb::kernels {

/// Leaves in which something collides, one list per warp.
struct BusyLeaves {
  static constexpr int kTurn = 16;  ///< leaves of a column looked up at a time
  static constexpr int kMost = 4 * static_cast<int>(kWarp);
  struct Leaf {
    std::uint32_t entry;  ///< the leaf's entry in the window
    std::uint32_t place;  ///< (x + 8) << 16 | y << 8 | z, from the box of the direction's slabs
  };
  Leaf list[kMost];
};

/// What a warp needs in shared memory to count slabs.
struct SlabWork {
  ToolSlabsView tool;
  OccupancyView map;
  WindowShape shape;
  std::uint32_t* nodes;  ///< filled nodes of a BusyWindow of that shape
  const std::uint16_t* busy_bits;
  std::int32_t point_ijk[3];
  BusyLeaves busy;
};

/// The tool at one direction, placed at the voxel of a point.
/// @tparam kThick  whether ToolSlabsView::full is set  @tparam kRows  whether ToolSlabsView::rows is
template <bool kThick, bool kRows>
class SlabCount {
 public:
  __device__ SlabCount(SlabWork& work, int d, int lane)
      : point_ijk_(work.point_ijk[0], work.point_ijk[1], work.point_ijk[2]),
        window_(work.nodes, work.shape, work.map, work.busy_bits, point_ijk_),
        busy_(work.busy),
        lane_(lane),
        box_(work.tool.boxes[8 * d + (point_ijk_[1] & 7)]) {
    words_ = work.tool.words;
    if constexpr (kRows) {
      rows_ = work.tool.rows + box_.first;
    } else {
      words_ += box_.first;
    }
    const std::uint32_t* begin = work.tool.begin + (64 * d + 8 * (point_ijk_[0] & 7) + (point_ijk_[1] & 7));
    columns_ = work.tool.columns + begin[0];
    if constexpr (kThick) full_ = work.tool.full + begin[0];
    num_columns_ = static_cast<int>(begin[1] - begin[0]);
    // Tool slabs begin at the voxel of the point, map slabs at multiples of eight: a map leaf meets the lower part of
    // one tool slab in its bits shift .. 7, and the upper part of the slab below in its other bits.
    shift_ = point_ijk_[2] & 7;
    high_ = (0xffu << shift_ & 0xffu) * 0x01010101u;
  }

  /// Stops once the collisions exceed `stop_above`; exact up to there.
  __device__ int upTo(int stop_above) const {
    int count = 0;
#pragma unroll 1
    for (int first = 0; first < num_columns_ && count <= stop_above; first += static_cast<int>(kWarp)) {
      const int n = first + lane_;
      const LeafColumn column = n < num_columns_ ? columns_[n] : LeafColumn{};
      const int leaves = column.count > 0 && shift_ != 0 ? column.count + 1 : column.count;
      const int most = __reduce_max_sync(kAllLanes, leaves);
      const int from_x = 8 * column.leaf_dx - (point_ijk_[0] & 7) - box_.dx + 8, from_y = column.leaf_dy - box_.leaf_dy;
      const auto place = static_cast<std::uint32_t>(from_x << 16 | from_y << 8 | (column.slab_dz - box_.slab_dz));
      const Coord ijk = voxelAt(place);
#pragma unroll 1
      for (int low = 0; low < most; low += BusyLeaves::kTurn) {
        const int asked = min(max(leaves - low, 0), BusyLeaves::kTurn);
        std::uint32_t found = asked > 0 ? window_.busyLeaves(ijk[0], ijk[1], ijk[2] + 8 * low, asked) : 0;
        const std::uint32_t from = place + static_cast<std::uint32_t>(low);
        // Where much collides, leaves fully covered by the tool give many collisions at little cost.
        if constexpr (kThick) {
          if (__reduce_add_sync(kAllLanes, __popc(found)) >= kManyBusy) {
            const std::uint32_t full = found & fullOf(n, low);
            count += collisionsIn<true>(full, from);
            if (count > stop_above) return count;
            found &= ~full;
          }
        }
        count += collisionsIn<false>(found, from);
      }
    }
    return count;
  }

 private:
  /// First voxel of the leaf at a BusyLeaves::Leaf::place, where its slab at x = 0 begins.
  [[nodiscard]] __device__ Coord voxelAt(std::uint32_t place) const {
    return Coord(point_ijk_[0] + box_.dx + static_cast<int>(place >> 16) - 8,
                 (point_ijk_[1] & ~7) + 8 * (box_.leaf_dy + static_cast<int>(place >> 8 & 0xff)),
                 (point_ijk_[2] & ~7) + 8 * (box_.slab_dz + static_cast<int>(place & 0xff)));
  }
  /// Collisions in leaves of a column, one column per lane. All lanes call it. The leaves are listed first and then
  /// shared among lanes: otherwise a lane with many leaves would pay the memory latency for each.
  /// @tparam kWhole  the tool covers them fully  @param found  bit k: the k-th leaf above that at `place`
  template <bool kWhole>
  __device__ int collisionsIn(std::uint32_t found, std::uint32_t place) const {
    int count = 0, listed = 0;
#pragma unroll 1
    for (unsigned any = __ballot_sync(kAllLanes, found != 0); any != 0; any = __ballot_sync(kAllLanes, found != 0)) {
      if (found != 0) {
        busy_.list[listed + __popc(any & ((1u << lane_) - 1u))].place =
            place + static_cast<std::uint32_t>(__ffs(static_cast<int>(found)) - 1);
        found &= found - 1;
      }
      listed += __popc(any);
      if (listed > BusyLeaves::kMost - static_cast<int>(kWarp)) {
        count += collisionsInListed<kWhole>(listed);
        listed = 0;
      }
    }
    return listed > 0 ? count + collisionsInListed<kWhole>(listed) : count;
  }
  template <bool kWhole>
  __device__ int collisionsInListed(int listed) const {
    __syncwarp();
    int mine = 0;
#pragma unroll 1
    for (int n = lane_; n < listed; n += static_cast<int>(kWarp)) {
      BusyLeaves::Leaf& leaf = busy_.list[n];
      const Coord ijk = voxelAt(leaf.place);
      if constexpr (kWhole) {
        mine += static_cast<int>(window_.collisionsIn(ijk[0], ijk[1], ijk[2]));
      } else {
        leaf.entry = window_.entryOf(ijk[0], ijk[1], ijk[2]);
      }
    }
    __syncwarp();
    if constexpr (!kWhole) {
#pragma unroll 1
      for (int first = 0; first < listed; first += 2 * kAtATime) {
        const int n = first + (lane_ >> 3);  // reads of two leaves overlap
        mine += collisionsOf(n, listed) + collisionsOf(n + kAtATime, listed);
      }
      __syncwarp();  // all have read the list
    }
    return __reduce_add_sync(kAllLanes, mine);
  }
  /// Which of the leaves low .. low + 15 of the n-th column the tool covers fully: those between two full slabs.
  [[nodiscard]] __device__ std::uint32_t fullOf(int n, int low) const {
    const FullSlabs full = n < num_columns_ ? full_[n] : FullSlabs{};
    const int begin = full.begin + (shift_ != 0 ? 1 : 0), end = full.begin + full.count;
    return bitsUpTo(end - low) & ~bitsUpTo(begin - low);
  }
  [[nodiscard]] static __device__ std::uint32_t bitsUpTo(int n) { return (1u << min(max(n, 0), 31)) - 1u; }
  /// Collisions in one of the eight slabs of the n-th leaf.
  __device__ int collisionsOf(int n, int listed) const {
    const BusyLeaves::Leaf leaf = n < listed ? busy_.list[n] : BusyLeaves::Leaf{0, 0};
    const int own_x = lane_ & 7, x = static_cast<int>(leaf.place >> 16) + own_x - 8,
              z = static_cast<int>(leaf.place & 0xff);
    const bool meets = n < listed && x >= 0 && x < box_.size_x;
    const int row = static_cast<int>(leaf.place >> 8 & 0xff) * box_.size_x + x;
    std::uint64_t upper = 0, lower = 0;
    if constexpr (kRows) {
      const SlabRow slabs = meets ? rows_[row] : SlabRow{};
      const int at = z - static_cast<int>(slabs.begin);
      if (at >= 0 && at < slabs.count) upper = words_[slabs.first + static_cast<std::uint32_t>(at)];
      if (at > 0 && at <= slabs.count && shift_ != 0) lower = words_[slabs.first + static_cast<std::uint32_t>(at) - 1];
    } else {
      const int word = row * box_.size_z + z;
      upper = meets && z < box_.size_z ? words_[word] : 0;
      lower = meets && z > 0 && shift_ != 0 ? words_[word - 1] : 0;
    }
    const std::uint64_t map = meets ? window_.slabOf(leaf.entry, own_x) : 0;
    return half(static_cast<std::uint32_t>(map), static_cast<std::uint32_t>(upper), static_cast<std::uint32_t>(lower)) +
           half(static_cast<std::uint32_t>(map >> 32), static_cast<std::uint32_t>(upper >> 32),
                static_cast<std::uint32_t>(lower >> 32));
  }
  __device__ int half(std::uint32_t map, std::uint32_t upper, std::uint32_t lower) const {
    // Shifts each byte separately: bits that come in from its neighbour are masked out.
    return __popc(map & ((upper << shift_ & high_) | (lower >> (8 - shift_) & ~high_)));
  }

  static constexpr int kAtATime = static_cast<int>(kWarp) / 8;
  static constexpr int kManyBusy = 16;  ///< leaves of a turn in which something collides

  Coord point_ijk_;
  BusyWindow window_;
  BusyLeaves& busy_;
  int lane_;
  SlabBox box_;
  const std::uint64_t* words_;
  const SlabRow* rows_;  ///< of the box; only with kRows
  const LeafColumn* columns_;
  const FullSlabs* full_;  ///< one per column; only if the tool is thick
  int num_columns_;
  int shift_;
  std::uint32_t high_;
};

/// Collisions of the tool at direction d: exact up to `stop_above`, else some number above it that they reach. All
/// lanes call it. Not inlined, although it is most of the work: kernels larger than the instruction cache stall on it.
template <bool kThick, bool kRows>
static __device__ __noinline__ int countSlabs(SlabWork& work, int d, int stop_above, int lane) {
  return SlabCount<kThick, kRows>(work, d, lane).upTo(stop_above);
}

}  // namespace accessvdb::kernels

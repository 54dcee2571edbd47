// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Counts the tool's collisions leaf by leaf: first it looks up which leaves touched by the tool contain any collision
/// at all, one column of leaves per lane. These few go on a list and are compared with the tool's slabs, eight lanes
/// per leaf.
#pragma once

#include <cstdint>

#include "cuda/search/busy_window.cuh"
#include "cuda/search/read_entry.cuh"
#include "hostdev/views.h"

namespace accessvdb::kernels {

/// Leaves in which something collides, one list per warp.
struct BusyLeaves {
  static constexpr int kTurn = 16;  ///< leaves of a column looked up at a time
  static constexpr int kMost = 2 * static_cast<int>(kWarp);
  /// First a leaf is only `place`: LeafColumn::x << 16 | y << 8 | z.
  struct alignas(16) Leaf {
    std::uint32_t place;
    std::uint32_t entry;  ///< BusyPlaces::entryOf
    std::int32_t x;       ///< of its slab 0 in the box
    std::int32_t at;      ///< of that slab: its word, or its row if slabs are kept by row
  };
  Leaf list[kMost];
};

/// What a warp needs in shared memory to count slabs.
struct SlabWork {
  ToolSlabsView tool;
  OccupancyView map;
  WindowShape shape;
  const std::uint32_t* nodes;  ///< filled nodes of a BusyWindow of that shape
  const std::uint16_t* busy_bits;
  std::int32_t in_window[3];  ///< [voxels] the point's voxel from the window's corner
  BusyLeaves busy;
};

/// The tool at one direction, placed at the voxel of a point.
/// @tparam kThick  whether ToolSlabsView::thick is set  @tparam kRows  whether ToolSlabsView::rows is
template <bool kThick, bool kRows>
class SlabCount {
 public:
  __device__ SlabCount(SlabWork& work, int d, int lane)
      : places_(work.nodes, work.shape, work.map, work.busy_bits), busy_(work.busy), lane_(lane) {
    const int x = work.in_window[0], y = work.in_window[1], z = work.in_window[2];
    const SlabBox box = readEntry(work.tool.boxes + (8 * d + (y & 7)));
    words_ = work.tool.words;
    if constexpr (kRows) {
      rows_ = work.tool.rows + box.first;
    } else {
      words_ += box.first;
    }
    const std::uint32_t* begin = work.tool.begin + (64 * d + 8 * (x & 7) + (y & 7));
    const std::uint32_t first = readEntry(begin);
    columns_ = work.tool.columns + first;
    num_columns_ = static_cast<int>(readEntry(begin + 1) - first);
    size_x_ = box.size_x;
    size_z_ = box.size_z;
    corner_x_ = x + box.dx - 8;
    corner_y_ = (y >> 3) + box.leaf_dy;
    corner_z_ = (z >> 3) + box.slab_dz;
    // Tool slabs begin at the voxel of the point, map slabs at multiples of eight: a map leaf meets the lower part of
    // one tool slab in its bits shift .. 7, and the upper part of the slab below in its other bits.
    shift_ = z & 7;
    high_ = (0xffu << shift_ & 0xffu) * 0x01010101u;
  }

  /// Stops once the collisions exceed `stop_above`; exact up to there.
  __device__ int upTo(int stop_above) {
    const int one_more = shift_ != 0 ? 1 : 0, turns_end = size_z_ + one_more;
    LeafColumn column = {};
    int first = -static_cast<int>(kWarp), low = turns_end;
    std::uint32_t found = 0, place = 0;
    // One loop, so that there is one copy of what compares: kernels larger than the instruction cache stall on it.
#pragma unroll 1
    for (bool more = true; more;) {
      if (!__any_sync(kAllLanes, found != 0)) {  // all of the turn before are listed
        low += BusyLeaves::kTurn;
        if (low >= turns_end) {
          low = 0;
          first += static_cast<int>(kWarp);
          more = first < num_columns_;
          column = first + lane_ < num_columns_ ? readEntry(columns_ + (first + lane_)) : LeafColumn{};
        }
        const int leaves = column.count > 0 ? column.count + one_more : 0;
        const int asked = min(max(leaves - low, 0), BusyLeaves::kTurn);
        const int z = column.z + low;
        place = column.x << 16 | column.y << 8 | z;
        if (asked > 0) found = places_.leavesAbove(leafX(column.x), corner_y_ + column.y, corner_z_ + z, asked);
        // Where much collides, leaves fully covered by the tool give many collisions at little cost.
        if constexpr (kThick) {
          if (__reduce_add_sync(kAllLanes, __popc(found)) >= kManyBusy) {
            const std::uint32_t full = found & fullOf(column, low);
            countWhole(full, place);
            if (count_ > stop_above) return count_;
            found &= ~full;
          }
        }
      }
      list(found, place);
      if (listed_ >= kEnough || (!more && listed_ > 0)) {
        compareListed();
        if (count_ > stop_above) return count_;
      }
    }
    return count_;
  }

 private:
  /// In leaves from the window's corner. @param x  LeafColumn::x
  [[nodiscard]] __device__ int leafX(int x) const { return (corner_x_ + x) >> 3; }
  [[nodiscard]] __device__ Coord leafAt(std::uint32_t place) const {
    return Coord(leafX(static_cast<int>(place >> 16)), corner_y_ + static_cast<int>(place >> 8 & 0xff),
                 corner_z_ + static_cast<int>(place & 0xff));
  }

  /// Lists leaves of a column, one column per lane, as long as there is room. All lanes call it. They are listed first
  /// and then shared among lanes: otherwise a lane with many leaves would pay the memory latency for each.
  /// @param found  bit k: the k-th leaf above that at `place`; those that are listed are taken out
  __device__ void list(std::uint32_t& found, std::uint32_t place) {
#pragma unroll 1
    while (listed_ <= BusyLeaves::kMost - static_cast<int>(kWarp)) {
      const unsigned any = __ballot_sync(kAllLanes, found != 0);
      if (any == 0) return;
      if (found != 0) {
        busy_.list[listed_ + __popc(any & ((1u << lane_) - 1u))].place = place + lowest(found);
        found &= found - 1;
      }
      listed_ += __popc(any);
    }
  }
  /// Counts leaves of a column that the tool covers fully, one column per lane. All lanes call it.
  __device__ void countWhole(std::uint32_t full, std::uint32_t place) {
    auto* const places = reinterpret_cast<std::uint32_t*>(busy_.list + listed_);  // behind what is listed
    const int room = (BusyLeaves::kMost - listed_) * static_cast<int>(sizeof(BusyLeaves::Leaf) / sizeof(place));
    int mine = 0, waiting = 0;
#pragma unroll 1
    for (bool more = true; more;) {
      const unsigned any = __ballot_sync(kAllLanes, full != 0);
      more = any != 0;
      if (full != 0) {
        places[waiting + __popc(any & ((1u << lane_) - 1u))] = place + lowest(full);
        full &= full - 1;
      }
      waiting += __popc(any);
      if (more && waiting <= room - static_cast<int>(kWarp)) continue;
      __syncwarp();
#pragma unroll 1
      for (int n = lane_; n < waiting; n += static_cast<int>(kWarp)) {
        const Coord leaf = leafAt(places[n]);
        mine += static_cast<int>(places_.collisionsIn(leaf[0], leaf[1], leaf[2]));
      }
      __syncwarp();
      waiting = 0;
    }
    count_ += __reduce_add_sync(kAllLanes, mine);
  }
  [[nodiscard]] static __device__ std::uint32_t lowest(std::uint32_t bits) {
    return static_cast<std::uint32_t>(__ffs(static_cast<int>(bits)) - 1);
  }

  /// Counts the collisions in listed leaves. All lanes call it.
  __device__ void compareListed() {
    __syncwarp();
#pragma unroll 1
    for (int n = lane_; n < listed_; n += static_cast<int>(kWarp)) {
      const std::uint32_t place = busy_.list[n].place;
      const Coord leaf = leafAt(place);
      BusyLeaves::Leaf& to = busy_.list[n];
      to.entry = places_.entryOf(leaf[0], leaf[1], leaf[2]);
      const int x = static_cast<int>(place >> 16) - 8, row = static_cast<int>(place >> 8 & 0xff) * size_x_ + x;
      to.x = x;
      to.at = kRows ? row : row * (size_z_ + 1) + static_cast<int>(place & 0xff);
    }
    __syncwarp();
    int mine = 0;
#pragma unroll 1
    for (int first = 0; first < listed_; first += 2 * kAtATime) {
      const int n = first + (lane_ >> 3);  // reads of two leaves overlap
      mine += collisionsOf(n) + collisionsOf(n + kAtATime);
    }
    __syncwarp();  // all have read the list
    listed_ = 0;
    count_ += __reduce_add_sync(kAllLanes, mine);
  }
  /// Which of the leaves low .. low + 15 of a column the tool covers fully: those between two full slabs.
  [[nodiscard]] __device__ std::uint32_t fullOf(const LeafColumn& column, int low) const {
    const int begin = column.full + (shift_ != 0 ? 1 : 0), end = column.full + column.num_full;
    return bitsUpTo(end - low) & ~bitsUpTo(begin - low);
  }
  [[nodiscard]] static __device__ std::uint32_t bitsUpTo(int n) { return (1u << min(max(n, 0), 31)) - 1u; }
  /// Collisions in one of the eight slabs of the n-th listed leaf.
  __device__ int collisionsOf(int n) const {
    const BusyLeaves::Leaf leaf = busy_.list[n];
    const int own_x = lane_ & 7;
    const bool meets = n < listed_ && static_cast<unsigned>(leaf.x + own_x) < static_cast<unsigned>(size_x_);
    std::uint64_t upper = 0, lower = 0;
    if constexpr (kRows) {
      const SlabRow slabs = meets ? readEntry(rows_ + (leaf.at + own_x)) : SlabRow{};
      const int at = static_cast<int>(leaf.place & 0xff) - static_cast<int>(slabs.begin);
      const std::uint64_t* const slab = words_ + (slabs.first + static_cast<std::uint32_t>(at));
      if (at >= 0 && at < slabs.count) upper = readEntry(slab);
      if (at > 0 && at <= slabs.count && shift_ != 0) lower = readEntry(slab - 1);
    } else if (meets) {
      const std::uint64_t* slab = words_ + (leaf.at + own_x * (size_z_ + 1));
      upper = readEntry(slab);
      lower = readEntry(slab - 1);
    }
    const std::uint64_t map = meets ? places_.slabOf(leaf.entry, own_x) : 0;
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
  static constexpr int kEnough = 32;    ///< listed leaves that are compared before more are looked up

  BusyPlaces places_;
  BusyLeaves& busy_;
  int lane_;
  const std::uint64_t* words_;
  const SlabRow* rows_;  ///< of the box; only with kRows
  const LeafColumn* columns_;
  int num_columns_;
  int size_x_, size_z_;                 ///< of the box
  int corner_x_, corner_y_, corner_z_;  ///< of the box in the window, for LeafColumn: [voxels], [leaves], [leaves]
  int shift_;
  std::uint32_t high_;
  int listed_ = 0, count_ = 0;
};

/// Collisions of the tool at direction d: exact up to `stop_above`, else some number above it that they reach. All
/// lanes call it. Not inlined, although it is most of the work: kernels larger than the instruction cache stall on it.
template <bool kThick, bool kRows>
static __device__ __noinline__ int countSlabs(SlabWork& work, int d, int stop_above, int lane) {
  return SlabCount<kThick, kRows>(work, d, lane).upTo(stop_above);
}

}  // namespace accessvdb::kernels

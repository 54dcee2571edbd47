// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Counts the tool's collisions leaf by leaf. Which leaves around a leaf of points hold something that collides is
/// looked up once, a bit a leaf; a direction then asks for those that the tool touches, 64 leaves at a time, and the
/// few that are left meet the slabs of the tool, eight lanes a leaf.
#pragma once

#include <cstdint>

#include "cuda/leaf_window.cuh"
#include "hostdev/views.h"

namespace accessvdb::kernels {

/// Finds the leaves of a LeafBox in which something collides. A warp; its lanes wait for each other before they read.
/// @param rows  [box.words()] shared by the warp: level by level, row by row, a bit a leaf
template <class Window>
__device__ void fillBusyRows(const Window& window, const LeafBox& box, const Coord& point_ijk, std::uint64_t* rows,
                             int lane) {
  auto* halves = reinterpret_cast<std::uint32_t*>(rows);
  const int levels = box.levels(), of_row = 2 << box.words_log2;
  const int x0 = (point_ijk[0] & ~7) + 8 * box.low[0], y0 = (point_ijk[1] & ~7) + 8 * box.low[1],
            z0 = (point_ijk[2] & ~7) + 8 * box.low[2];
  for (int half = 0; half < of_row; ++half) {
    const int y = 32 * half + lane;
#pragma unroll 1
    for (int x = 0; x < box.size[0]; ++x) {
      std::uint32_t busy = 0;
#pragma unroll 1
      for (int low = 0; y < box.size[1] && low < levels; low += 16) {
        busy |= window.busyLeaves(x0 + 8 * x, y0 + 8 * y, z0 + 8 * low, min(levels - low, 16)) << low;
      }
      std::uint32_t mine = 0;
#pragma unroll 1
      for (int level = 0; level < levels; ++level) {
        const unsigned all = __ballot_sync(kAllLanes, (busy >> level & 1u) != 0);
        if (lane == level) mine = all;
      }
      if (lane < levels) halves[(lane * box.size[0] + x) * of_row + half] = mine;
    }
  }
}

/// Leaves that the tool may collide with, in shared memory, a list a warp.
struct BusyLeaves {
  static constexpr int kMost = 3 * static_cast<int>(kWarp);
  static constexpr int kEnough = 8;  ///< to be counted at a time
  struct Leaf {
    std::uint32_t entry;  ///< of the window
    std::uint32_t place;  ///< x << 16 | y << 5 | z, from the box of the direction's slabs; x is 8 more
  };
  Leaf list[kMost];
};

/// What a warp needs to count slabs, in shared memory.
struct SlabWork {
  ToolSlabsView tool;
  OccupancyView map;
  WindowShape shape;
  std::uint32_t* nodes;       ///< of a LowerWindow of that shape
  const std::uint64_t* rows;  ///< of fillBusyRows, for the leaf of the point
  std::int32_t point_ijk[3];
  BusyLeaves busy;
};

/// The tool at one direction, placed at the voxel of a point.
class SlabCount {
 public:
  __device__ SlabCount(SlabWork& work, int d, int lane)
      : point_ijk_(work.point_ijk[0], work.point_ijk[1], work.point_ijk[2]),
        window_(work.nodes, work.shape, work.map, point_ijk_),
        busy_(work.busy),
        lane_(lane),
        all_(work.tool.box),
        box_(work.tool.boxes[8 * d + (point_ijk_[1] & 7)]),
        leaves_(work.tool.leaves[64 * d + 8 * (point_ijk_[0] & 7) + (point_ijk_[1] & 7)]) {
    words_ = work.tool.words + box_.first;
    of_tool_ = work.tool.rows + leaves_.first;
    of_map_ = work.rows + leaves_.at;
    // Slabs of the tool begin at the voxel of the point, those of the map at multiples of eight: a leaf of the map
    // meets the lower part of one slab in its bits shift .. 7, and the upper part of the one below in the others.
    shift_ = point_ijk_[2] & 7;
    high_ = (0xffu << shift_ & 0xffu) * 0x01010101u;
  }

  /// Stops once the collisions exceed `stop_above`; exact up to there.
  __device__ int upTo(int stop_above) const {
    int count = 0, listed = 0;
    const int of_slabs = all_.size[2] * leaves_.count, end = of_slabs + (shift_ != 0 ? leaves_.count : 0);
#pragma unroll 1
    for (int first = 0; first < end; first += static_cast<int>(kWarp)) {
      const int n = first + lane_;
      std::uint64_t left = n < of_slabs ? of_tool_[n] : 0;
      if (shift_ != 0 && n >= leaves_.count && n < end) left |= of_tool_[n - leaves_.count];
      const int level =
          static_cast<int>(static_cast<std::uint32_t>(n) * leaves_.reciprocal >> LeafRows::kReciprocalLog2);
      const int at = n - level * leaves_.count;
      if (left != 0) left &= of_map_[level * all_.levelWords() + at];
#pragma unroll 1
      for (unsigned any = __ballot_sync(kAllLanes, left != 0); any != 0; any = __ballot_sync(kAllLanes, left != 0)) {
        if (left != 0) {
          const int bit = __ffsll(static_cast<long long>(left)) - 1;
          busy_.list[listed + __popc(any & ((1u << lane_) - 1u))] = leafAt(leaves_.at + at, bit, level);
          left &= left - 1;
        }
        listed += __popc(any);
        if (listed > BusyLeaves::kMost - static_cast<int>(kWarp)) {
          count += collisionsIn(listed);
          listed = 0;
          if (count > stop_above) return count;
        }
      }
      if (listed < BusyLeaves::kEnough) continue;
      count += collisionsIn(listed);
      listed = 0;
      if (count > stop_above) return count;
    }
    return listed > 0 ? count + collisionsIn(listed) : count;
  }

 private:
  /// @param word  of a level of the box   @param bit  in it
  __device__ BusyLeaves::Leaf leafAt(int word, int bit, int level) const {
    const int x = all_.low[0] + (word >> all_.words_log2),
              y = all_.low[1] + ((word & ((1 << all_.words_log2) - 1)) << 6) + bit, z = all_.low[2] + level;
    const std::uint32_t entry =
        window_.entryOf((point_ijk_[0] & ~7) + 8 * x, (point_ijk_[1] & ~7) + 8 * y, (point_ijk_[2] & ~7) + 8 * z);
    const int from_x = 8 * x - (point_ijk_[0] & 7) - box_.dx + 8, from_y = y - box_.leaf_dy, from_z = z - box_.slab_dz;
    return {entry, static_cast<std::uint32_t>(from_x << 16 | from_y << 5 | from_z)};
  }

  /// Collisions in the leaves on the list; all lanes.
  __device__ int collisionsIn(int listed) const {
    __syncwarp();
    int mine = 0;
#pragma unroll 1
    for (int first = 0; first < listed; first += 2 * kAtATime) {
      const int n = first + (lane_ >> 3);  // the reads of two leaves do not wait for each other
      mine += collisionsOf(n, listed) + collisionsOf(n + kAtATime, listed);
    }
    __syncwarp();  // all have read the list
    return __reduce_add_sync(kAllLanes, mine);
  }
  /// In one of the eight slabs of the n-th leaf.
  __device__ int collisionsOf(int n, int listed) const {
    const BusyLeaves::Leaf leaf = n < listed ? busy_.list[n] : BusyLeaves::Leaf{0, 0};
    const int own_x = lane_ & 7, x = static_cast<int>(leaf.place >> 16) + own_x - 8,
              z = static_cast<int>(leaf.place & 31);
    const bool meets = n < listed && x >= 0 && x < box_.size_x;
    const int word = (static_cast<int>(leaf.place >> 5 & 0x7ff) * box_.size_x + x) * box_.size_z + z;
    const std::uint64_t upper = meets && z < box_.size_z ? words_[word] : 0,
                        lower = meets && z > 0 && shift_ != 0 ? words_[word - 1] : 0,
                        map = meets ? window_.slabOf(leaf.entry, own_x) : 0;
    return half(static_cast<std::uint32_t>(map), static_cast<std::uint32_t>(upper), static_cast<std::uint32_t>(lower)) +
           half(static_cast<std::uint32_t>(map >> 32), static_cast<std::uint32_t>(upper >> 32),
                static_cast<std::uint32_t>(lower >> 32));
  }
  __device__ int half(std::uint32_t map, std::uint32_t upper, std::uint32_t lower) const {
    // Bytes are shifted on their own: what comes in from the next one is masked.
    return __popc(map & ((upper << shift_ & high_) | (lower >> (8 - shift_) & ~high_)));
  }

  static constexpr int kAtATime = static_cast<int>(kWarp) / 8;

  Coord point_ijk_;
  MapWindow<LowerWindow> window_;
  BusyLeaves& busy_;
  int lane_;
  const LeafBox& all_;
  SlabBox box_;
  LeafRows leaves_;
  const std::uint64_t *words_, *of_tool_, *of_map_;
  int shift_;
  std::uint32_t high_;
};

/// Collisions of the tool at direction d: exact up to `stop_above`, else some number above it that they reach. All
/// lanes. Kept out of line, though it is most of the work: kernels that are larger than the instruction cache wait for
/// it.
static __device__ __noinline__ int countSlabs(SlabWork& work, int d, int stop_above, int lane) {
  return SlabCount(work, d, lane).upTo(stop_above);
}

}  // namespace accessvdb::kernels

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a search warp keeps of the busy map (busy_map.h) around its point.
#pragma once

#include <cstdint>

#include "cuda/search/busy_map.h"
#include "cuda/search/leaf_window.cuh"

namespace accessvdb::kernels {

/// The nodes above the leaves, as in LowerWindow, and the bits of their leaves.
class BusyWindow : public MapWindow<LowerWindow> {
 public:
  static constexpr int kEntries = BusyMapView::kEntries;

  /// One warp calls it, and synchronises before it reads. @param nodes  kEntries words per node of the shape
  __device__ BusyWindow(std::uint32_t* nodes, const WindowShape& shape, const OccupancyView& map,
                        const BusyMapView& busy, const Coord& point_ijk, int lane)
      : MapWindow<LowerWindow>(nodes, shape, map, point_ijk), numbers_(nodes + shape.nodes()), bits_(busy.bits) {
    const int count = static_cast<int>(shape.nodes());
    for (int n = lane; n < count; n += static_cast<int>(kWarp)) {
      const Coord ijk = this->originOf(n);
      const std::uint32_t slot =
          busy.hash.find(placeKey(ijk[0] >> kLowerLog2, ijk[1] >> kLowerLog2, ijk[2] >> kLowerLog2));
      const std::uint32_t number = slot != kNoIndex ? busy.number_at[slot] : kNoIndex;
      numbers_[n] = number;
      nodes[n] = number != kNoIndex ? busy.nodes[number] : 0;
    }
  }

  /// The same window again, with nodes that are already filled. @param bits  BusyMapView::bits
  __device__ BusyWindow(std::uint32_t* nodes, const WindowShape& shape, const OccupancyView& map,
                        const std::uint16_t* bits, const Coord& point_ijk)
      : MapWindow<LowerWindow>(nodes, shape, map, point_ijk), numbers_(nodes + shape.nodes()), bits_(bits) {}

  /// The shape covers all that searches read: the tool and the corridor.
  [[nodiscard]] __device__ static constexpr bool holds(const Coord&) { return true; }

  /// Which of `count` leaves, at most 16, from that of voxel (x, y, z) upwards hold something that collides.
  [[nodiscard]] __device__ std::uint32_t busyLeaves(int x, int y, int z, int count) const {
    x -= this->origin_[0];
    y -= this->origin_[1];
    z -= this->origin_[2];
    const std::uint32_t first = this->index(x, y, z);
    const auto column = static_cast<std::uint32_t>((x >> kLeafLog2 & 15) << 4 | (y >> kLeafLog2 & 15));
    const int above = z >> kLeafLog2 & 15;
    std::uint32_t busy = bitsOf(first, column) >> above;
    if (above + count > 16) busy |= bitsOf(first + 1, column) << (16 - above);
    return busy & ((1u << count) - 1u);
  }

 private:
  [[nodiscard]] __device__ std::uint32_t bitsOf(std::uint32_t n, std::uint32_t column) const {
    const std::uint32_t number = numbers_[n];
    return number != kNoIndex ? bits_[std::size_t{number} * BusyMapView::kColumns + column] : 0;
  }

  std::uint32_t* numbers_;
  const std::uint16_t* bits_;
};

}  // namespace accessvdb::kernels

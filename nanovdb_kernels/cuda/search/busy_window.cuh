// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a search warp keeps of the busy map (busy_map.h) around its point.
#pragma once

#include <cstdint>

#include "cuda/search/busy_map.h"
#include "cuda/search/leaf_window.cuh"
#include "cuda/search/read_entry.cuh"

namespace accessvdb::kernels {

/// The nodes above the leaves, as in LowerWindow, and the bits of their leaves.
class BusyWindow : public WindowReader<LowerWindow> {
 public:
  static constexpr int kEntries = BusyMapView::kEntries;

  /// One warp calls it, and synchronises before it reads. @param nodes  kEntries words per node of the shape
  __device__ BusyWindow(std::uint32_t* nodes, const WindowShape& shape, const OccupancyView& map,
                        const BusyMapView& busy, const Coord& point_ijk, int lane)
      : WindowReader<LowerWindow>(nodes, shape, map, point_ijk) {
    const int count = static_cast<int>(shape.nodes());
    std::uint32_t* numbers = nodes + count;
    for (int n = lane; n < count; n += static_cast<int>(kWarp)) {
      const Coord ijk = this->originOf(n);
      const std::uint32_t slot =
          busy.hash.find(placeKey(ijk[0] >> kLowerLog2, ijk[1] >> kLowerLog2, ijk[2] >> kLowerLog2));
      const std::uint32_t number = slot != kNoIndex ? busy.number_at[slot] : kNoIndex;
      numbers[n] = number;
      nodes[n] = number != kNoIndex ? busy.nodes[number] : 0;
    }
  }

  /// The shape covers all that searches read: the tool and the corridor.
  [[nodiscard]] __device__ static constexpr bool holds(const Coord&) { return true; }
};

/// The leaves of a filled BusyWindow. Places are in leaves from the window's corner, never negative.
class BusyPlaces {
 public:
  /// @param nodes, shape  of the window  @param bits  BusyMapView::bits
  __device__ BusyPlaces(const std::uint32_t* nodes, const WindowShape& shape, const OccupancyView& map,
                        const std::uint16_t* bits)
      : nodes_(nodes),
        numbers_(nodes + shape.nodes()),
        size_y_(shape.size[1]),
        size_z_(shape.size[2]),
        grid_(reinterpret_cast<const std::uint8_t*>(map.grid)),
        bits_(bits) {}

  /// Which of `count` leaves, at most 16, from (x, y, z) upwards hold something that collides.
  [[nodiscard]] __device__ std::uint32_t leavesAbove(int x, int y, int z, int count) const {
    const std::uint32_t first = index(x, y, z);
    const auto column = static_cast<std::uint32_t>((x & 15) << 4 | (y & 15));
    const int above = z & 15;
    std::uint32_t busy = bitsOf(first, column) >> above;
    if (above + count > 16) busy |= bitsOf(first + 1, column) << (16 - above);
    return busy & ((1u << count) - 1u);
  }

  /// A leaf in which something collides, in four bytes.
  [[nodiscard]] __device__ std::uint32_t entryOf(int x, int y, int z) const {
    return offsetOfNode(grid_, leafAt(x, y, z));
  }
  /// What collides at x in it: bit 8 y + z.
  [[nodiscard]] __device__ std::uint64_t slabOf(std::uint32_t entry, int x) const {
    return readEntry(reinterpret_cast<const std::uint64_t*>(nodeAt(grid_, entry) + kValueBytes) + x);
  }
  /// Number of collisions in it.
  [[nodiscard]] __device__ std::uint32_t collisionsIn(int x, int y, int z) const {
    const std::uint64_t cells = readEntry(reinterpret_cast<const std::uint64_t*>(leafAt(x, y, z) + kCellCountsBytes));
    return __dp4a(static_cast<std::uint32_t>(cells), 0x01010101u,
                  __dp4a(static_cast<std::uint32_t>(cells >> 32), 0x01010101u, 0u));
  }

 private:
  [[nodiscard]] __device__ std::uint32_t index(int x, int y, int z) const {
    return static_cast<std::uint32_t>(((x >> 4) * size_y_ + (y >> 4)) * size_z_ + (z >> 4));
  }
  [[nodiscard]] __device__ std::uint32_t bitsOf(std::uint32_t n, std::uint32_t column) const {
    const std::uint32_t number = numbers_[n];
    return number != kNoIndex ? readEntry(bits_ + (std::size_t{number} * BusyMapView::kColumns + column)) : 0;
  }
  [[nodiscard]] __device__ const std::uint8_t* leafAt(int x, int y, int z) const {
    const std::uint8_t* lower = nodeAt(grid_, nodes_[index(x, y, z)]);
    const int place = (x & 15) << 8 | (y & 15) << 4 | (z & 15);
    return lower + readEntry(reinterpret_cast<const std::uint64_t*>(lower + kLowerTableBytes) + place);
  }

  const std::uint32_t *nodes_, *numbers_;
  int size_y_, size_z_;
  const std::uint8_t* grid_;
  const std::uint16_t* bits_;
};

}  // namespace accessvdb::kernels

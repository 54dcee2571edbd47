// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cuda/search/busy_map.h"

#include "cuda/memory/cuda_check.h"
#include "cuda/search/leaf_window.cuh"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kThreads = 256, kBlocks = 512;
constexpr std::uint32_t kWordsOfUpper = OccupancyUpper::SIZE / 64;

/// Calls `take(upper, tile, place)` for each lower node, with its place in the table of its upper node.
template <class Take>
__device__ void forEachLower(const OccupancyGrid* grid, const Take& take) {
  const auto& root = grid->tree().root();
  const std::uint32_t words = root.tileCount() * kWordsOfUpper;
  for (std::uint32_t n = blockIdx.x * kThreads + threadIdx.x; n < words; n += gridDim.x * kThreads) {
    const auto* tile = root.data()->tile(n / kWordsOfUpper);
    if (!tile->isChild()) continue;
    const OccupancyUpper* upper = root.data()->getChild(tile);
    const std::uint32_t word = n % kWordsOfUpper;
    for (std::uint64_t bits = reinterpret_cast<const std::uint64_t*>(&upper->data()->mChildMask)[word]; bits != 0;
         bits &= bits - 1) {
      take(upper, *tile, 64 * word + static_cast<std::uint32_t>(__ffsll(static_cast<long long>(bits)) - 1));
    }
  }
}

__global__ void countLowers(const OccupancyGrid* grid, std::uint32_t* lowers) {
  forEachLower(grid, [&](const OccupancyUpper*, const auto&, std::uint32_t) { atomicAdd(lowers, 1u); });
}

__global__ void listLowers(const OccupancyGrid* grid, BusyMapView busy, std::uint32_t* listed) {
  forEachLower(grid, [&](const OccupancyUpper* upper, const auto& tile, std::uint32_t place) {
    const auto* lower = reinterpret_cast<const std::uint8_t*>(upper->data()->getChild(place));
    const Coord tile_ijk = tile.origin(), local_ijk = OccupancyUpper::OffsetToLocalCoord(place);
    const std::uint32_t number = atomicAdd(listed, 1u);
    const std::uint32_t slot = busy.hash.insert(placeKey((tile_ijk[0] >> kLowerLog2) + local_ijk[0],
                                                         (tile_ijk[1] >> kLowerLog2) + local_ijk[1],
                                                         (tile_ijk[2] >> kLowerLog2) + local_ijk[2]));
    busy.number_at[slot] = number;
    busy.nodes[number] = static_cast<std::uint32_t>(
        static_cast<std::uint64_t>(lower - reinterpret_cast<const std::uint8_t*>(grid)) / kNodeBytes);
  });
}

/// One block per node, one thread per column of leaves.
__global__ void markLeaves(const OccupancyGrid* grid, BusyMapView busy) {
  const std::uint8_t* lower =
      reinterpret_cast<const std::uint8_t*>(grid) + static_cast<std::uint64_t>(busy.nodes[blockIdx.x]) * kNodeBytes;
  const auto* children = reinterpret_cast<const std::int64_t*>(lower + kLowerTableBytes) + 16 * threadIdx.x;
  std::uint32_t bits = 0;
#pragma unroll
  for (int z = 0; z < 16; ++z) {
    const std::int64_t child = children[z];
    if (child != 0 && collidesSomewhere(lower + child)) bits |= 1u << z;
  }
  busy.bits[std::size_t{blockIdx.x} * BusyMapView::kColumns + threadIdx.x] = static_cast<std::uint16_t>(bits);
}

}  // namespace

void launchCountLowers(const OccupancyGrid* grid, std::uint32_t* lowers, cudaStream_t stream) {
  countLowers<<<kBlocks, kThreads, 0, stream>>>(grid, lowers);
  checkLaunch("countLowers");
}

void launchBusyMap(const OccupancyGrid* grid, const BusyMapView& busy, std::uint32_t lowers, std::uint32_t* listed,
                   cudaStream_t stream) {
  if (lowers == 0) return;
  listLowers<<<kBlocks, kThreads, 0, stream>>>(grid, busy, listed);
  checkLaunch("listLowers");
  markLeaves<<<lowers, BusyMapView::kColumns, 0, stream>>>(grid, busy);
  checkLaunch("markLeaves");
}

}  // namespace accessvdb::kernels

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Sorts the flipped voxels of an update by tile, and in a tile by layer of leaves: those around a block of points then
/// lie in a few pieces. Within a layer their order is that of the threads; no result depends on it.
#include "cuda/memory/cuda_check.h"
#include "cuda/memory/growing.h"
#include "cuda/update/update_kernels.h"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kThreads = 256;
constexpr unsigned kThreadsPerLeaf = 8;

__device__ std::uint32_t& layerOf(const FlipsView& flips, const LeafFlips& flip) {
  const std::uint32_t tile = flips.tile_at[flips.hash.find(FlipsView::keyOf(flip.leaf))];
  return flips.layer_begin[tile * FlipsView::kLayers + (flip.leaf[2] & 15)];
}

__global__ void countVoxels(FlipsView flips, std::uint32_t count) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n < count && flips.list[n].voxels != 0) atomicAdd(&layerOf(flips, flips.list[n]), flips.list[n].voxels);
}

/// Turns the numbers of a tile's layers into where they end: sortVoxels() goes down from there to where they begin.
__global__ void placeLayers(FlipsView flips, std::uint32_t tiles) {
  const std::uint32_t tile = blockIdx.x * kThreads + threadIdx.x;
  if (tile >= tiles) return;
  std::uint32_t* const layers = flips.layer_begin + tile * FlipsView::kLayers;
  std::uint32_t all = 0;
  for (std::uint32_t n = 0; n + 1 < FlipsView::kLayers; ++n) all += layers[n];
  std::uint32_t end = atomicAdd(flips.layer_begin + tiles * FlipsView::kLayers, all);
  for (std::uint32_t n = 0; n + 1 < FlipsView::kLayers; ++n) layers[n] = end += layers[n];
  layers[FlipsView::kLayers - 1] = end;
}

__global__ void sortVoxels(FlipsView flips, std::uint32_t count) {
  const std::uint32_t thread = blockIdx.x * kThreads + threadIdx.x, n = thread / kThreadsPerLeaf;
  if (n >= count) return;
  const LeafFlips& flip = flips.list[n];
  const std::uint32_t first = thread % kThreadsPerLeaf, voxels = flip.voxels;
  if (first >= voxels) return;
  const std::uint32_t mine = (voxels - first + kThreadsPerLeaf - 1) / kThreadsPerLeaf;
  std::uint32_t at = atomicSub(&layerOf(flips, flip), mine) - mine;
  for (std::uint32_t v = first; v < voxels; v += kThreadsPerLeaf) {
    const std::uint32_t code = flips.voxels[flip.first_voxel + v];
    const auto inTile = [&](int axis, std::int32_t leaves) {
      return static_cast<std::uint32_t>(flip.leaf[axis] & leaves) << 3 | (code >> (7 - 3 * axis) & 7u);
    };
    flips.by_layer[at++] = TileVoxel::code(inTile(0, 7), inTile(1, 7), inTile(2, 15), (code & 1u) != 0);
  }
}

}  // namespace

void launchSortVoxels(const FlipsView& flips, std::uint32_t count, std::uint32_t tiles, cudaStream_t stream) {
  const auto blocksFor = [](std::uint64_t threads) {
    return static_cast<unsigned>((threads + kThreads - 1) / kThreads);
  };
  fillBytes(flips.layer_begin, 0, (tiles * FlipsView::kLayers + 1) * sizeof(std::uint32_t), stream);
  countVoxels<<<blocksFor(count), kThreads, 0, stream>>>(flips, count);
  checkLaunch("countVoxels");
  placeLayers<<<blocksFor(tiles), kThreads, 0, stream>>>(flips, tiles);
  checkLaunch("placeLayers");
  sortVoxels<<<blocksFor(std::uint64_t{count} * kThreadsPerLeaf), kThreads, 0, stream>>>(flips, count);
  checkLaunch("sortVoxels");
}

}  // namespace accessvdb::kernels

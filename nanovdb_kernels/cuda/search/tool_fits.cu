// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cuda/search/tool_fits.h"

#include "cuda/memory/cuda_check.h"
#include "cuda/search/warp.cuh"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kWarps = 4, kThreads = kWarps * kWarp;

/// The voxels of some blocks of a leaf that the tool may enter, two per lane: the bits of toolVoxels().
__device__ void fitBlocks(const FitRequest& request, const ToolPlace& place, const OccupancyLeaf* leaf,
                          const float* corner, std::uint32_t blocks, ToolFit& fit) {
  const unsigned lane = threadIdx.x % kWarp;
  const ToolBitmapView& tool = request.tool;
  const auto* collides = leaf == nullptr ? nullptr : reinterpret_cast<const std::uint64_t*>(&leaf->data()->mValues);
  const auto* free = leaf == nullptr ? nullptr : reinterpret_cast<const std::uint64_t*>(&leaf->data()->mValueMask);
#pragma unroll 1
  for (; blocks != 0; blocks &= blocks - 1) {
    const int block = __ffs(static_cast<int>(blocks)) - 1;
    const int row = (block & 2) * 2 + static_cast<int>(lane / 4 % 4), z = (block & 1) * 4 + static_cast<int>(lane % 4);
    const int bit = 8 * row + z;
#pragma unroll
    for (int half = 0; half < 2; ++half) {
      const int x = (block & 4) + 2 * half + static_cast<int>(lane / 16);
      const std::uint64_t hit = leaf == nullptr ? 0 : collides[x];
      const bool collides_here = (hit >> bit & 1) != 0;
      const bool unknown_here = leaf == nullptr || (!collides_here && (free[x] >> bit & 1) == 0);
      if (!collides_here && !unknown_here) continue;
      const float slice[3] = {corner[0] + static_cast<float>(x), corner[1], corner[2]};
      float y[3];
      tool_fit::toNodes(place, tool, slice, y);
      const float over = static_cast<float>(row), up = static_cast<float>(z);
      for (int a = 0; a < 3; ++a) {
        const float across = place.turn[3 * a + 1] * tool.nodes_per_voxel,
                    step = place.turn[3 * a + 2] * tool.nodes_per_voxel;
        y[a] = y[a] + over * across + up * step;
      }
      if (!tool.has(y[0], y[1], y[2])) continue;
      fit.collisions += collides_here ? 1 : 0;
      fit.unknown += unknown_here ? 1 : 0;
    }
  }
}

/// A pose per warp. Each lane looks which blocks of a leaf the tool may reach; then all of them look at each of these.
__global__ void __launch_bounds__(kThreads) fitTools(const __grid_constant__ FitRequest request) {
  const std::size_t n = std::size_t{blockIdx.x} * kWarps + threadIdx.x / kWarp;
  if (n >= request.count) return;
  const unsigned lane = threadIdx.x % kWarp;
  const ToolPlace place = request.places[n];
  ToolFit fit;
  std::int32_t first[3], last[3];
  const std::int64_t leaves = tool_fit::leavesAround(place, request.tool, first, last);
  fit.valid = leaves <= tool_fit::kMostLeaves;
  const std::int32_t size_z = last[2] - first[2] + 1, size_y = last[1] - first[1] + 1;
  const auto& root = request.map.grid->tree().root();
#pragma unroll 1
  for (std::int32_t begin = 0; fit.valid && begin < leaves; begin += static_cast<std::int32_t>(kWarp)) {
    const std::int32_t own = begin + static_cast<std::int32_t>(lane);
    const std::int32_t leaf_ijk[3] = {first[0] + own / (size_y * size_z), first[1] + own / size_z % size_y,
                                      first[2] + own % size_z};
    float corner[3];
    for (int axis = 0; axis < 3; ++axis) corner[axis] = static_cast<float>(leaf_ijk[axis] * 8 - place.anchor[axis]);
    const float middle[3] = {corner[0] + 3.5f, corner[1] + 3.5f, corner[2] + 3.5f}, half[3] = {3.5f, 3.5f, 3.5f};
    std::uint32_t blocks = 0;
    if (own < leaves && tool_fit::mayReach(place, request.tool, middle, half))
      blocks = tool_fit::blocksOf(place, request.tool, corner);
    const OccupancyLeaf* leaf =
        blocks != 0 ? root.probeLeaf(Coord(leaf_ijk[0] * 8, leaf_ijk[1] * 8, leaf_ijk[2] * 8)) : nullptr;
    for (unsigned left = __ballot_sync(kAllLanes, blocks != 0); left != 0; left &= left - 1) {
      const int from = __ffs(static_cast<int>(left)) - 1;
      const auto of = reinterpret_cast<const OccupancyLeaf*>(
          __shfl_sync(kAllLanes, reinterpret_cast<unsigned long long>(leaf), from));
      const float at[3] = {__shfl_sync(kAllLanes, corner[0], from), __shfl_sync(kAllLanes, corner[1], from),
                           __shfl_sync(kAllLanes, corner[2], from)};
      fitBlocks(request, place, of, at, __shfl_sync(kAllLanes, blocks, from), fit);
      __syncwarp();
    }
    if ((request.enough.collisions | request.enough.unknown) != 0 &&
        request.enough.has(__reduce_add_sync(kAllLanes, fit.collisions), __reduce_add_sync(kAllLanes, fit.unknown)))
      break;
  }
  fit.collisions = __reduce_add_sync(kAllLanes, fit.collisions);
  fit.unknown = __reduce_add_sync(kAllLanes, fit.unknown);
  if (lane == 0) request.fits[n] = fit;
}

}  // namespace

void launchToolFits(const FitRequest& request, cudaStream_t stream) {
  if (request.count == 0) return;
  fitTools<<<static_cast<unsigned>((request.count + kWarps - 1) / kWarps), kThreads, 0, stream>>>(request);
  checkLaunch("fitTools");
}

}  // namespace accessvdb::kernels

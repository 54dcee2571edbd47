// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which of the points that compete are scored (hostdev/surface_choice.h), one warp per point. Kernels of their own:
/// where every point is scored, none of this runs.
#include "cuda/memory/cuda_check.h"
#include "cuda/search/warp.cuh"
#include "cuda/update/update_kernels.h"
#include "hostdev/surface_choice.h"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kThreads = 128;

unsigned blocksFor(std::uint64_t threads) { return static_cast<unsigned>((threads + kThreads - 1) / kThreads); }

__global__ void admitReturns(CompetitionView competition, DeviceList<PointDelta> deltas, const std::uint32_t* returns,
                             bool touches) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= deltas.count) return;
  const PointDelta& delta = deltas.data[n];
  competition.returns[delta.id] = returns[n];
  if (!touches) return;
  const float* p = delta.position_L;
  const Coord voxel = voxelOf(p[0], p[1], p[2], competition.inverse_voxel_size);
  atomicOr(
      reinterpret_cast<unsigned long long*>(competition.touched_voxels + 8 * std::size_t{delta.block}) + (voxel[0] & 7),
      1ull << ((voxel[1] & 7) << 3 | (voxel[2] & 7)));
}

__device__ std::int64_t sumOfWarp(std::int64_t value) {
  for (int step = kWarp / 2; step > 0; step /= 2) value += __shfl_xor_sync(kAllLanes, value, step);
  return value;
}

/// Points of the cell and side that a warp lists. If there are more, it looks for them twice.
constexpr std::uint32_t kMostListed = 128;
struct ListedPoints {
  std::uint32_t id[kMostListed];
  std::uint32_t count;
};

/// Points of a cell and side, along the main axis of a point's normal.
class CompetitorsOfPoint {
 public:
  /// @param list  shared by the warp
  __device__ CompetitorsOfPoint(const PointsView& points, const CompetitionView& competition, std::uint32_t id,
                                int axis, ListedPoints& list)
      : points_(points),
        competition_(competition),
        axis_(axis),
        list_(list),
        own_(competing(id, voxelOfPoint(id))),
        voxels_(competition.choice, own_.voxel, axis),
        front_(isInFront(id)) {}

  /// Whether the point is the one to be scored. All lanes call it and get the same.
  [[nodiscard]] __device__ bool isOnSurface(std::uint32_t lane) const {
    WindowReturns around = {own_, competition_.choice.window};
    if (lane == 0) list_.count = 0;
    __syncwarp();
    forEach(lane, [&](std::uint32_t id, const CompetingPoint& point) {
      around.add(point);
      const std::uint32_t at = atomicAdd(&list_.count, 1u);
      if (at < kMostListed) list_.id[at] = id;
    });
    around.returns = sumOfWarp(around.returns);
    around.moment = sumOfWarp(around.moment);
    __syncwarp();
    const std::uint32_t count = list_.count;
    bool nearest = true;
    if (count <= kMostListed) {
      for (std::uint32_t n = lane; n < count; n += kWarp) {
        nearest = nearest && !around.isNearer(competing(list_.id[n], voxelOfPoint(list_.id[n])));
      }
    } else {
      forEach(lane,
              [&](std::uint32_t /*id*/, const CompetingPoint& point) { nearest = nearest && !around.isNearer(point); });
    }
    return __all_sync(kAllLanes, nearest);
  }

 private:
  /// Calls visit(id, point) for all of them, among them the point itself. Each lane gets others.
  template <class Visit>
  __device__ void forEach(std::uint32_t lane, const Visit& visit) const {
    const BlockIndexView& index = points_.index;
#pragma unroll 1
    for (std::int32_t x = voxels_.low[0] >> 3; x <= voxels_.high[0] >> 3; ++x) {
#pragma unroll 1
      for (std::int32_t y = voxels_.low[1] >> 3; y <= voxels_.high[1] >> 3; ++y) {
#pragma unroll 1
        for (std::int32_t z = voxels_.low[2] >> 3; z <= voxels_.high[2] >> 3; ++z) {
          const std::uint32_t block = index.find(x, y, z);
          if (block == kNoIndex) continue;
          const std::uint32_t first = index.first[block], count = index.count[block];
#pragma unroll 1
          for (std::uint32_t n = lane; n < count; n += kWarp) {
            const std::uint32_t id = index.ids[first + n];
            // Most points are in other cells: what else is known of these is not read.
            const Coord voxel = voxelOfPoint(id);
            const std::int32_t at[3] = {voxel[0], voxel[1], voxel[2]};
            if (voxels_.hold(at) && isInFront(id) == front_) visit(id, competing(id, voxel));
          }
        }
      }
    }
  }
  [[nodiscard]] __device__ Coord voxelOfPoint(std::uint32_t id) const {
    const float* p = points_.points.position_L + 3 * static_cast<std::size_t>(id);
    return voxelOf(p[0], p[1], p[2], competition_.inverse_voxel_size);
  }
  [[nodiscard]] __device__ CompetingPoint competing(std::uint32_t id, const Coord& voxel) const {
    return {competition_.choice.heightOf(points_.meanOf(id)[axis_]),
            competition_.returns[id],
            {voxel[0], voxel[1], voxel[2]}};
  }
  [[nodiscard]] __device__ bool isInFront(std::uint32_t id) const {
    return points_.state.to_sensor_L[3 * static_cast<std::size_t>(id) + static_cast<std::size_t>(axis_)] >= 0;
  }

  const PointsView& points_;
  const CompetitionView& competition_;
  int axis_;
  ListedPoints& list_;
  CompetingPoint own_;
  CompetingVoxels voxels_;
  bool front_;
};

__global__ void __launch_bounds__(kThreads)
    chooseOnSurface(const __grid_constant__ PointsView points, const __grid_constant__ CompetitionView competition,
                    const __grid_constant__ PointChunk part, FoundNeighbourhood* neighbourhoods) {
  __shared__ ListedPoints lists[kThreads / kWarp];
  const std::uint32_t n = (blockIdx.x * kThreads + threadIdx.x) / kWarp, lane = threadIdx.x % kWarp;
  if (!part.holds(n)) return;
  float* const normal = neighbourhoods[n].normal;
  if (normal[0] == 0 && normal[1] == 0 && normal[2] == 0) return;  // too few neighbours
  const int axis = mainAxis(normal);
  const CompetitorsOfPoint competitors(points, competition, part.ids[part.first + n], axis, lists[threadIdx.x / kWarp]);
  const bool chosen = competitors.isOnSurface(lane);
  if (lane == 0 && !chosen) writeBesideSurface(axis, normal);
}

}  // namespace

void launchAdmitReturns(const CompetitionView& competition, DeviceList<PointDelta> deltas, const std::uint32_t* returns,
                        bool touches, cudaStream_t stream) {
  if (deltas.count == 0) return;
  admitReturns<<<blocksFor(deltas.count), kThreads, 0, stream>>>(competition, deltas, returns, touches);
  checkLaunch("admitReturns");
}

void launchChooseOnSurface(const PointsView& points, const CompetitionView& competition, const PointChunk& part,
                           FoundNeighbourhood* neighbourhoods, cudaStream_t stream) {
  if (part.count == 0) return;
  chooseOnSurface<<<blocksFor(std::uint64_t{part.count} * kWarp), kThreads, 0, stream>>>(points, competition, part,
                                                                                         neighbourhoods);
  checkLaunch("chooseOnSurface");
}

}  // namespace accessvdb::kernels

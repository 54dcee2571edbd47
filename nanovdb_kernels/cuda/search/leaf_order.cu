// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The order in which points are searched: leaf by leaf, with nearby leaves close together, so that points searched at
/// the same time read the same part of the map.
#include <cub/device/device_radix_sort.cuh>

#include "cuda/memory/cuda_check.h"
#include "cuda/search/score_kernels.h"
#include "hostdev/occupancy_query.h"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kThreads = 256;
constexpr int kBitsPerAxis = 10;  ///< leaves 1024 apart share a key, which only costs a little time

/// Spreads 10 bits to every third bit position.
__device__ std::uint32_t spread(std::uint32_t x) {
  x &= 0x3ffu;
  x = (x | x << 16) & 0x030000ffu;
  x = (x | x << 8) & 0x0300f00fu;
  x = (x | x << 4) & 0x030c30c3u;
  return (x | x << 2) & 0x09249249u;
}

__device__ std::uint32_t leafKey(std::int32_t x, std::int32_t y, std::int32_t z) {
  return spread(static_cast<std::uint32_t>(x)) | spread(static_cast<std::uint32_t>(y)) << 1 |
         spread(static_cast<std::uint32_t>(z)) << 2;
}

__global__ void leafKeys(ScoreChunk chunk, std::uint32_t* keys, std::uint32_t* order) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= chunk.count) return;
  const float* p = chunk.points.position_L + 3 * static_cast<std::size_t>(chunk.items[n].id);
  const Coord ijk = voxelOf(p[0], p[1], p[2], chunk.map.inverse_voxel_size);
  keys[n] = leafKey(ijk[0] >> 3, ijk[1] >> 3, ijk[2] >> 3);
  order[n] = n;
}

__global__ void blockKeys(const std::int32_t* leaf, const std::uint32_t* blocks, std::uint32_t count,
                          std::uint32_t* keys) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= count) return;
  const std::int32_t* of = leaf + 3 * static_cast<std::size_t>(blocks[n]);
  keys[n] = leafKey(of[0], of[1], of[2]);
}

}  // namespace

void launchLeafOrder(const ScoreChunk& chunk, std::uint32_t* keys, std::uint32_t* sorted, std::uint32_t* order_in,
                     std::uint32_t* order, void* scratch, std::size_t& bytes, cudaStream_t stream) {
  if (scratch != nullptr) {
    leafKeys<<<(chunk.count + kThreads - 1) / kThreads, kThreads, 0, stream>>>(chunk, keys, order_in);
    checkLaunch("leafKeys");
  }
  ACCESSVDB_CUDA(CUB_NS_QUALIFIER::DeviceRadixSort::SortPairs(
      scratch, bytes, keys, sorted, order_in, order, static_cast<int>(chunk.count), 0, 3 * kBitsPerAxis, stream));
}

void launchBlockOrder(const std::int32_t* leaf, const std::uint32_t* blocks, std::uint32_t count, std::uint32_t* keys,
                      std::uint32_t* sorted, std::uint32_t* order, void* scratch, std::size_t& bytes,
                      cudaStream_t stream) {
  if (scratch != nullptr) {
    blockKeys<<<(count + kThreads - 1) / kThreads, kThreads, 0, stream>>>(leaf, blocks, count, keys);
    checkLaunch("blockKeys");
  }
  ACCESSVDB_CUDA(CUB_NS_QUALIFIER::DeviceRadixSort::SortPairs(scratch, bytes, keys, sorted, blocks, order,
                                                              static_cast<int>(count), 0, 3 * kBitsPerAxis, stream));
}

}  // namespace accessvdb::kernels

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "parity/device_reads.h"

#include <stdexcept>

namespace accessvdb::test {
namespace {

__global__ void readVoxels(const kernels::OccupancyGrid* grid, const nanovdb::Coord* voxels, std::uint8_t* out,
                           std::size_t count) {
  const std::size_t n = blockIdx.x * std::size_t(blockDim.x) + threadIdx.x;
  if (n >= count) return;
  const auto accessor = grid->getAccessor();
  out[n] = static_cast<std::uint8_t>((accessor.getValue(voxels[n]) ? 1 : 0) | (accessor.isActive(voxels[n]) ? 2 : 0));
}

__global__ void readDistances(const kernels::DistanceGrid* grid, const nanovdb::Coord* voxels, DistanceRead* out,
                              std::size_t count) {
  const std::size_t n = blockIdx.x * std::size_t(blockDim.x) + threadIdx.x;
  if (n >= count) return;
  const auto accessor = grid->getAccessor();
  out[n].value = accessor.getValue(voxels[n]);
  out[n].active = accessor.isActive(voxels[n]);
}

/// One thread per voxel.
template <class Grid, class Read>
std::vector<Read> readEach(kernels::DeviceMemory& memory, const Grid* grid, const std::vector<nanovdb::Coord>& voxels,
                           void (*kernel)(const Grid*, const nanovdb::Coord*, Read*, std::size_t)) {
  kernels::DeviceArray<nanovdb::Coord> coords(memory, voxels.size());
  coords.upload(voxels.data(), voxels.size());
  kernels::DeviceArray<Read> out(memory, voxels.size());
  kernel<<<static_cast<unsigned>((voxels.size() + 255) / 256), 256>>>(grid, coords.data(), out.data(), voxels.size());
  if (cudaDeviceSynchronize() != cudaSuccess) throw std::runtime_error("reading the grid on the device failed");
  std::vector<Read> found(voxels.size());
  memory.download(found.data(), out.data(), found.size() * sizeof(Read));
  return found;
}

}  // namespace

std::vector<std::uint8_t> readOnDevice(kernels::DeviceMemory& memory, const kernels::OccupancyGrid* grid,
                                       const std::vector<nanovdb::Coord>& voxels) {
  return readEach(memory, grid, voxels, readVoxels);
}

std::vector<DistanceRead> readDistancesOnDevice(kernels::DeviceMemory& memory, const kernels::DistanceGrid* grid,
                                                const std::vector<nanovdb::Coord>& voxels) {
  return readEach(memory, grid, voxels, readDistances);
}

}  // namespace accessvdb::test

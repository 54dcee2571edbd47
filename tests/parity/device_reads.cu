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

}  // namespace

std::vector<std::uint8_t> readOnDevice(kernels::DeviceMemory& memory, const kernels::OccupancyGrid* grid,
                                       const std::vector<nanovdb::Coord>& voxels) {
  kernels::DeviceArray<nanovdb::Coord> coords(memory, voxels.size());
  coords.upload(voxels.data(), voxels.size());
  kernels::DeviceArray<std::uint8_t> out(memory, voxels.size());
  readVoxels<<<static_cast<unsigned>((voxels.size() + 255) / 256), 256>>>(grid, coords.data(), out.data(),
                                                                          voxels.size());
  if (cudaDeviceSynchronize() != cudaSuccess) throw std::runtime_error("reading the grid on the device failed");
  std::vector<std::uint8_t> bits(voxels.size());
  memory.download(bits.data(), out.data(), bits.size());
  return bits;
}

}  // namespace accessvdb::test

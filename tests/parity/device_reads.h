// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Reads of a mirrored grid on the device, by NanoVDB's own accessor in a kernel.
#pragma once

#include <cstdint>
#include <vector>

#include "hostdev/nanovdb_compat.h"
#include "launch/device_array.h"

namespace accessvdb::test {

/// Bit 0: value, bit 1: active, for each voxel. @param grid  on the device
[[nodiscard]] std::vector<std::uint8_t> readOnDevice(kernels::DeviceMemory& memory, const kernels::OccupancyGrid* grid,
                                                     const std::vector<nanovdb::Coord>& voxels);

/// Value and active state of each voxel.
struct DistanceRead {
  float value = 0;
  bool active = false;
};
[[nodiscard]] std::vector<DistanceRead> readDistancesOnDevice(kernels::DeviceMemory& memory,
                                                              const kernels::DistanceGrid* grid,
                                                              const std::vector<nanovdb::Coord>& voxels);

}  // namespace accessvdb::test

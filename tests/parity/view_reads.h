// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Queries to a DeviceView in a kernel, on the caller's own stream.
#pragma once

#include <cstdint>
#include <vector>

#include "accessvdb/device_view.h"
#include "launch/device_array.h"

namespace accessvdb::test {

/// A position, and a capsule from it.
struct ViewQuestion {
  double a_W[3], b_W[3], radius_m;
};
struct ViewAnswer {
  Occupancy at_a = Occupancy::Unknown;
  PathOccupancy along;
  float distance_m = 0, interpolated_m = 0;  ///< at a
};

[[nodiscard]] std::vector<ViewAnswer> askOnDevice(kernels::DeviceMemory& memory, const DeviceView& view,
                                                  const std::vector<ViewQuestion>& questions);

/// What broken memory may do on a device that fuses: of the leaves at these positions, each two get each other's
/// values.
/// @return how many
[[nodiscard]] std::uint32_t swapValuesOnDevice(kernels::DeviceMemory& memory, const DeviceView& view,
                                               const std::vector<ViewQuestion>& positions);

}  // namespace accessvdb::test

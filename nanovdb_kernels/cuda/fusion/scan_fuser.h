// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The fuser of a device.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "launch/device_array.h"
#include "launch/scan_fuser.h"

namespace accessvdb::kernels {

class DeviceContext;

class DeviceScanFuser : public ScanFuser {
 public:
  /// For tests: the slots for values that there are, and what is in them.
  struct Slots {
    std::vector<std::uint32_t> values, cleared, votes;  ///< [slots x 512], [x 16], [x 48]
  };
  [[nodiscard]] virtual Slots readSlots() = 0;
  /// Device time of the last scan, from its arrival on, without waiting for the host. For benchmarks.
  [[nodiscard]] virtual float lastMilliseconds() = 0;
};

/// @param grid  the mirror of facts, whose arena has no other writer while a scan is fused
/// @return null if the device runs no kernels, as one that tests put in its place
[[nodiscard]] std::unique_ptr<DeviceScanFuser> makeScanFuser(std::shared_ptr<DeviceContext> context,
                                                             DeviceMemory& memory, const FusionSetting& setting,
                                                             const OccupancyGrid* grid);

}  // namespace accessvdb::kernels

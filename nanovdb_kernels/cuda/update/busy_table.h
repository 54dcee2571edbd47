// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The arrays behind a BusyMapView, rebuilt for every update.
#pragma once

#include <cuda_runtime_api.h>

#include <bit>
#include <cstdint>

#include "cuda/memory/growing.h"
#include "cuda/search/busy_map.h"
#include "launch/device_array.h"

namespace accessvdb::kernels {

class BusyTable {
 public:
  explicit BusyTable(DeviceMemory& memory) : memory_(memory) {}

  /// @param lowers  number of lower nodes in the mirror  @param listed  zeroed device memory: number listed
  [[nodiscard]] BusyMapView make(const OccupancyGrid* grid, std::uint32_t lowers, std::uint32_t* listed,
                                 cudaStream_t stream) {
    const std::size_t slots = std::bit_ceil(2 * std::size_t{lowers} + 64);
    keys_.grow(memory_, slots, 0);
    numbers_.grow(memory_, slots, 0);
    nodes_.growWithRoom(memory_, lowers, roomFor(lowers), 0);
    bits_.growWithRoom(memory_, BusyMapView::kColumns * std::size_t{lowers}, BusyMapView::kColumns * roomFor(lowers),
                       0);
    fillBytes(keys_.data(), 0xff, slots * sizeof(std::uint64_t), stream);
    const BusyMapView busy = {
        {keys_.data(), static_cast<std::uint32_t>(slots - 1)}, numbers_.data(), nodes_.data(), bits_.data()};
    launchBusyMap(grid, busy, lowers, listed, stream);
    return busy;
  }

 private:
  DeviceMemory& memory_;
  DeviceArray<std::uint64_t> keys_;
  DeviceArray<std::uint32_t> numbers_, nodes_;
  DeviceArray<std::uint16_t> bits_;
};

}  // namespace accessvdb::kernels

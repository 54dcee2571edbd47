// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Points whose neighbourhoods may have changed since the last update, and the touched points that changed them.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <span>

#include "cuda/memory/staging.h"
#include "cuda/update/update_views.cuh"
#include "launch/device_array.h"

namespace accessvdb::kernels {

class MovedTables {
 public:
  MovedTables(DeviceMemory& memory, MovedCounters* counters) : memory_(memory) { view_.counters = counters; }

  /// Valid until the next grow() or addPlaces().
  [[nodiscard]] const MovedView& view() const { return view_; }
  /// Points [first, first + count) of the list. Indices beyond its end are skipped.
  [[nodiscard]] PointChunk part(std::uint32_t first, std::uint32_t count) const {
    return {view_.ids, &view_.counters->moved, first, count};
  }

  void grow(std::uint32_t points, std::uint32_t blocks, cudaStream_t stream);
  /// Makes room for `more` places of touched points, of each no more than one until clear(): what is kept of neighbours
  /// follows each. @return the first of them
  std::uint32_t addPlaces(std::uint32_t more);
  /// Finds the points near those places, and those that compete with them.
  void find(const PointsView& points, const CompetitionView& competition, cudaStream_t stream);
  /// Adds points that became confident, and sets their weights.
  void addCrossed(std::span<const PointWeight> crossed, const PointStateView& points, cudaStream_t stream);
  /// Clears everything except the counters, which it does not own.
  void clear(cudaStream_t stream);

 private:
  DeviceMemory& memory_;
  MovedView view_;
  std::uint32_t places_used_ = 0;
  // By id.
  DeviceArray<std::uint32_t> bits_, changed_bits_, ids_;
  // By block.
  DeviceArray<std::uint32_t> head_, touched_blocks_, reached_bits_, reached_blocks_;
  DeviceArray<MovedBlock> blocks_;
  DeviceArray<TouchedPlace> places_;
  Staging<PointWeight> crossed_;
};

}  // namespace accessvdb::kernels

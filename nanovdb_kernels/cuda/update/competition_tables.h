// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What decides which points are scored, if not all are: their returns, and which voxels were touched since the last
/// update.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <memory>
#include <span>

#include "cuda/memory/range_array.h"
#include "cuda/memory/staging.h"
#include "cuda/update/update_views.cuh"
#include "launch/device_array.h"
#include "launch/point_delta.h"

namespace accessvdb::kernels {

class CompetitionTables {
 public:
  CompetitionTables(const std::shared_ptr<DeviceContext>& context, DeviceMemory& memory, const NeighbourTables& tables);

  /// Valid until the next grow().
  [[nodiscard]] const CompetitionView& view() const { return view_; }
  /// Bytes not taken from `memory`.
  [[nodiscard]] std::uint64_t mappedBytes() const { return returns_.bytes(); }

  void grow(std::uint32_t points, std::uint32_t blocks, cudaStream_t stream);
  /// @param returns  AdmitInput::returns of the deltas  @param touches  whether to note the touched voxels
  void admit(DeviceList<PointDelta> deltas, std::span<const std::uint32_t> returns, bool touches, cudaStream_t stream);
  /// From now on no voxel counts as touched.
  void clearTouched(cudaStream_t stream);

 private:
  DeviceMemory& memory_;
  CompetitionView view_;
  RangeArray<std::uint32_t> returns_;
  DeviceArray<std::uint64_t> touched_voxels_;
  Staging<std::uint32_t> staged_returns_;
};

}  // namespace accessvdb::kernels

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cuda/update/competition_tables.h"

#include "accessvdb/error.h"
#include "cuda/memory/growing.h"
#include "cuda/update/update_kernels.h"
#include "hostdev/voxel_scale.h"

namespace accessvdb::kernels {

CompetitionTables::CompetitionTables(const std::shared_ptr<DeviceContext>& context, DeviceMemory& memory,
                                     const NeighbourTables& tables)
    : memory_(memory), returns_(context) {
  view_.choice = tables.choice;
  view_.reach_voxels = static_cast<float>(tables.choice.reachVoxels());
  view_.inverse_voxel_size = VoxelScale(tables.voxel_size_m).inverse_float32;
}

void CompetitionTables::grow(std::uint32_t points, std::uint32_t blocks, cudaStream_t stream) {
  returns_.grow(points);
  growFilled(touched_voxels_, memory_, std::size_t{8} * blocks, 0, stream);
  view_.returns = returns_.data();
  view_.touched_voxels = touched_voxels_.data();
}

void CompetitionTables::admit(DeviceList<PointDelta> deltas, std::span<const std::uint32_t> returns, bool touches,
                              cudaStream_t stream) {
  if (returns.size() != deltas.count) {
    throw InternalError("competition.no_returns", "", "Points came without the number of their returns",
                        "Please report this");
  }
  launchAdmitReturns(view_, deltas, staged_returns_.send(returns, memory_, stream).data, touches, stream);
}

void CompetitionTables::clearTouched(cudaStream_t stream) {
  fillBytes(touched_voxels_.data(), 0, touched_voxels_.bytes(), stream);
}

}  // namespace accessvdb::kernels

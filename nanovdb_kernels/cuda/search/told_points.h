// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the state of points says, read from the device.
#pragma once

#include <cuda_runtime_api.h>

#include "hostdev/told_state.h"

namespace accessvdb::kernels {

// All in device memory; they only queue.

/// @param ids, rows  [count]
void launchReadRows(const PointStateView& points, const std::uint32_t* ids, StateRow* rows, std::uint32_t count,
                    cudaStream_t stream);
/// takeTold() of all points.
void launchTakeTold(const PointStateView& points, const ToldStates& states, cudaStream_t stream);

}  // namespace accessvdb::kernels

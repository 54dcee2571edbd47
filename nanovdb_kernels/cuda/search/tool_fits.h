// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Many poses of a tool on the device.
#pragma once

#include <cuda_runtime_api.h>

#include "launch/tool_fits.h"

namespace accessvdb::kernels {

/// Queues them. @param request  places and fits in device memory
void launchToolFits(const FitRequest& request, cudaStream_t stream);

}  // namespace accessvdb::kernels

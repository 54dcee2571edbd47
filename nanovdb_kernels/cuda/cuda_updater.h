// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The exact policy on the GPU.
#pragma once

#include <memory>

#include "cuda/device_context.h"
#include "launch/device_array.h"
#include "launch/point_updater.h"

namespace accessvdb::kernels {

/// @param memory  of the same device; must outlive the updater
[[nodiscard]] std::unique_ptr<PointUpdater> makeCudaUpdater(std::shared_ptr<DeviceContext> context,
                                                            DeviceMemory& memory, const UpdaterTables& tables);

}  // namespace accessvdb::kernels

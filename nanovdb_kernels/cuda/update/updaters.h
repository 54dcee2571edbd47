// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The two policies on the GPU.
#pragma once

#include <memory>

#include "cuda/memory/device_context.h"
#include "launch/device_array.h"
#include "launch/point_updater.h"

namespace accessvdb::kernels {

/// The exact one. @param memory  of the same device; must outlive the updater
[[nodiscard]] std::unique_ptr<PointUpdater> makeExactUpdater(std::shared_ptr<DeviceContext> context,
                                                             DeviceMemory& memory, const UpdaterTables& tables);
/// The paper's. @param memory  as above
[[nodiscard]] std::unique_ptr<PointUpdater> makePaperUpdater(std::shared_ptr<DeviceContext> context,
                                                             DeviceMemory& memory, const UpdaterTables& tables);

}  // namespace accessvdb::kernels

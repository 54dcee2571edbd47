// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The updaters of a device.
#pragma once

#include <memory>

#include "cuda/memory/device_context.h"
#include "launch/device_array.h"
#include "launch/exact_updater.h"
#include "launch/paper_updater.h"

namespace accessvdb::kernels {

[[nodiscard]] std::unique_ptr<ExactUpdater> makeExactUpdater(std::shared_ptr<DeviceContext> context,
                                                             DeviceMemory& memory, const ExactTables& tables);
[[nodiscard]] std::unique_ptr<PaperUpdater> makePaperUpdater(std::shared_ptr<DeviceContext> context,
                                                             DeviceMemory& memory, const PaperTables& tables);

}  // namespace accessvdb::kernels

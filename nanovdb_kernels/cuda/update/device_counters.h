// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Counters that the kernels of an update add to.
#pragma once

#include "accessvdb/error.h"
#include "cuda/memory/counters_on_device.h"
#include "cuda/update/update_views.cuh"

namespace accessvdb::kernels {

/// @throw InternalError  some neighbours were not found
inline void requireNeighbours(const MovedCounters& counters) {
  if (counters.failed == 0) return;
  throw InternalError("update.neighbours", "cuda", "more points at the same distance than the search has room for",
                      "Please report this, and use BackendKind::Cpu");
}

using DeviceCounters = CountersOnDevice<UpdateCounters>;

}  // namespace accessvdb::kernels

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Many poses of a tool against the mirror.
#pragma once

#include <cstddef>
#include <cstdint>

#include "hostdev/tool_fit.h"

namespace accessvdb::kernels {

struct FitRequest {
  OccupancyView map;
  ToolBitmapView tool;      ///< in the backend's memory
  const ToolPlace* places;  ///< [count] host memory
  ToolFit* fits;            ///< [count] host memory, out
  std::size_t count;
  EnoughOfFit enough = {};
};

}  // namespace accessvdb::kernels

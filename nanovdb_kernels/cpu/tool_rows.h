// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Rows of voxels against a tool's bitmap with the lanes of the processor: the bits of tool_fit::PlainRows.
#pragma once

#include <cstdint>

#include "hostdev/tool_fit.h"

namespace accessvdb::kernels {

using ToolRow = std::uint32_t (*)(const ToolBitmapView& tool, const float* y, const float* step);

/// nullptr if this processor has no lanes for it, or the bitmap is too large for them.
[[nodiscard]] ToolRow fastToolRow(const ToolBitmapView& tool);

}  // namespace accessvdb::kernels

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Points uniform on a tool's surface, for the ground truth (docs/PAPER.md, "Ground truth"). Separate from
/// src/tool on purpose: the truth shares no function with what it judges.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "accessvdb/tool_geometry.h"

namespace accessvdb::eval {

/// @return [count] points in the tool frame, metres; the same for the same tool, count and seed on every machine
[[nodiscard]] std::vector<Eigen::Vector3d> sampleToolSurface(const ToolGeometry& tool, int count, std::uint64_t seed);

}  // namespace accessvdb::eval

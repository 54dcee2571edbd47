// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Whether a mesh has an inside.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "sim/triangle_mesh.h"

namespace accessvdb::sim {

/// Empty if every edge is traversed equally often in both directions, so that the winding number is the same along
/// every ray; else what is wrong, in words. Vertices at the same position count as one, whatever their indices.
[[nodiscard]] std::string whyNotClosed(const TriangleMesh& mesh);

/// For a closed mesh: one triangle (the largest) of each part, connected over edges, whose signed volume is not
/// positive.
[[nodiscard]] std::vector<std::uint32_t> insideOutCandidates(const TriangleMesh& mesh);

/// Number of parts, connected over vertices at the same position.
[[nodiscard]] std::uint32_t partCount(const TriangleMesh& mesh);

}  // namespace accessvdb::sim

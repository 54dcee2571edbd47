// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Does a mesh have an inside?
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "sim/triangle_mesh.h"

namespace accessvdb::sim {

/// Empty where every edge is walked as often in one direction as in the other, which is when the winding number is the
/// same along every ray; else what is wrong, in words. Vertices at the same place are one, whatever their indices.
[[nodiscard]] std::string whyNotClosed(const TriangleMesh& mesh);

/// Of a closed mesh: one triangle (its largest) of each part, connected over edges, whose signed volume is not
/// positive.
[[nodiscard]] std::vector<std::uint32_t> insideOutCandidates(const TriangleMesh& mesh);

/// Number of parts that are connected over vertices at the same place.
[[nodiscard]] std::uint32_t partCount(const TriangleMesh& mesh);

}  // namespace accessvdb::sim

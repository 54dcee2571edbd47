// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Signed distance to a mesh of closed parts, by Embree's closest-point query.
#pragma once

#include <memory>
#include <string>

#include "sim/signed_distance.h"
#include "sim/triangle_mesh.h"

namespace accessvdb::sim {

/// Inside = inside any closed part (winding number above 0), so that parts may overlap.
/// @param why_not  filled with what is wrong, in words, if null is returned: edges without a partner, flipped
///                 triangles, an empty mesh
[[nodiscard]] std::shared_ptr<const SignedDistance> makeMeshDistance(const TriangleMesh& mesh, std::string& why_not);

}  // namespace accessvdb::sim

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Round cones as closed triangle meshes, every vertex on the exact surface.
#pragma once

#include "sim/pine_skeleton.h"
#include "sim/triangle_mesh.h"

namespace accessvdb::sim {

/// Appends one closed part. @param chord_error_m  largest allowed depth inside the exact surface
void appendRoundCone(const RoundCone& cone, double chord_error_m, TriangleMesh& mesh);

/// Appends a needle as four triangles: three corners around its root and its tip. It is inside the exact surface by at
/// most radius_a_m, except for the cap at its root, which is hidden in the shoot.
void appendNeedle(const RoundCone& needle, TriangleMesh& mesh);

}  // namespace accessvdb::sim

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A procedural Pinus radiata.
#pragma once

#include "sim/pine_params.h"
#include "sim/scene.h"
#include "sim/triangle_mesh.h"

namespace accessvdb::sim {

/// Only the mesh of makePine(), without the exact distance, which takes longer.
/// @param solid_foliage_m  0 = individual needles; else every shoot is a solid body of this radius instead, as seen by
///                         a beam wider than the gaps between needles
[[nodiscard]] TriangleMesh makePineMesh(const PineParams& params, double solid_foliage_m = 0);

/// A mature tree standing at the origin, z up: trunk with taper, whorls of branches, secondary branches, needle shoots.
[[nodiscard]] Scene makePine(const PineParams& params);

}  // namespace accessvdb::sim

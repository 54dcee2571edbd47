// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is and grows below trees: uneven ground, fallen twigs, low plants. Invented, so that the ground is not a plane;
/// not based on measurements of a real forest floor.
#pragma once

#include <cstdint>

#include "sim/triangle_mesh.h"

namespace accessvdb::sim {

/// Ground that repeats after kGroundPeriod_m in x and y, so that one tile covers any area without steps.
inline constexpr double kGroundPeriod_m = 12.0;
/// Height in metres, within +-0.45.
[[nodiscard]] double groundHeight_m(double x_m, double y_m);
/// The tile [0, kGroundPeriod_m]^2 as a mesh.
[[nodiscard]] TriangleMesh makeGroundTile();

/// Plants up to 0.9 m high and fallen twigs within 1.5 m of the origin, on level ground at z = 0.
[[nodiscard]] TriangleMesh makeUndergrowth(std::uint64_t seed);

}  // namespace accessvdb::sim

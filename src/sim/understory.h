// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What lies and grows below trees: uneven ground, fallen twigs, low plants. Invented, to keep the ground from being a
/// plane; no measurement of a real forest floor stands behind it.
#pragma once

#include <cstdint>

#include "sim/triangle_mesh.h"

namespace accessvdb::sim {

/// Ground that repeats after kGroundPeriod_m in x and y, so that one tile covers any area without a step.
inline constexpr double kGroundPeriod_m = 12.0;
/// Metres, within +-0.45.
[[nodiscard]] double groundHeight_m(double x_m, double y_m);
/// The tile [0, kGroundPeriod_m]^2 as a mesh.
[[nodiscard]] TriangleMesh makeGroundTile();

/// Plants up to 0.9 m high and fallen twigs within 1.5 m of the origin, on level ground at z = 0.
[[nodiscard]] TriangleMesh makeUndergrowth(std::uint64_t seed);

}  // namespace accessvdb::sim

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Wood, sticks and needles at random: clutter of all thicknesses from far below a voxel to several, for fitting what
/// should hold in crowns without having seen one.
#pragma once

#include <cstdint>

#include "sim/scene.h"

namespace accessvdb::sim {

/// Around the origin, within 40 to 80 voxels of it, but for what sticks out. How many parts there are is drawn from
/// the seed, too.
/// @throws InvalidArgument unless the voxel size is positive
[[nodiscard]] Scene makeThicket(std::uint64_t seed, double voxel_size_m);

}  // namespace accessvdb::sim

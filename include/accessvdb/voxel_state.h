// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace accessvdb {

/// Everything that the map knows about one voxel.
struct VoxelState {
  float distance_m = 0;      ///< mean of the clamped distances; tau where unobserved; 0 where `blocked`
  std::uint32_t weight = 0;  ///< observations; 0 = unobserved
  bool cleared = false;      ///< a ray passed here on its way to a return
  bool blocked = false;      ///< collides, whatever its mean: something new appeared here (ChangeMode::Block)
};

}  // namespace accessvdb

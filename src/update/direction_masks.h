// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Tables of direction sets by place.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "points/point_store.h"

namespace accessvdb::internal {

/// ORs the `last` entries below each entry into it, along one axis of a table [x][y][z]. Steps double; each pass goes
/// from the top down, so that it reads only unmodified entries.
inline void spreadMasks(std::vector<DirectionMask>& masks, const Index3& size, std::size_t axis, std::int32_t last) {
  std::size_t stride = 1;
  for (std::size_t inner = axis + 1; inner < 3; ++inner) stride *= static_cast<std::size_t>(size[inner]);
  const auto along = static_cast<std::size_t>(size[axis]);
  for (std::int32_t done = 1, step = 0; done <= last; done += step) {
    step = std::min(done, last + 1 - done);
    const std::size_t below = static_cast<std::size_t>(step) * stride;
    for (std::size_t n = masks.size(); n-- > 0;) {
      if (n / stride % along >= static_cast<std::size_t>(step)) masks[n] = masks[n] | masks[n - below];
    }
  }
}

}  // namespace accessvdb::internal

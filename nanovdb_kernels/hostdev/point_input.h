// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the host knows about a point, and how it is written to the state arrays.
#pragma once

#include <cstddef>
#include <cstdint>

#include "hostdev/views.h"

namespace accessvdb::kernels {

struct PointInput {
  std::uint32_t id = 0;
  std::uint16_t weight = 0;
  float position_L[3] = {0, 0, 0};
  float normal_L[3] = {0, 0, 0};
  DirectionMask seen = {};
};

/// Of a wide set, seen directions are written apart: an input has no room for them.
ACCESSVDB_HOSTDEV inline void writePoint(const PointStateView& points, const PointInput& input) {
  const std::size_t id = input.id;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    points.position_L[3 * id + axis] = input.position_L[axis];
    points.normal_L[3 * id + axis] = input.normal_L[axis];
  }
  const bool is_wide = points.direction_words > kMaxDirectionWords;
  const std::size_t words = is_wide ? 0 : static_cast<std::size_t>(points.direction_words);
  for (std::size_t w = 0; w < words; ++w) points.seen[id * words + w] = input.seen.word[w];
  points.weight[id] = input.weight;
}

}  // namespace accessvdb::kernels

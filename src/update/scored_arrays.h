// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Arrays for what scoring finds out about points, to be used in place of those of a state.
#pragma once

#include <cstddef>
#include <cstdint>

#include "launch/backend.h"

namespace accessvdb::internal {

struct ScoredArrays {
  kernels::DeviceArray<std::uint16_t> score, direction;
  kernels::DeviceArray<float> stability;
  kernels::DeviceArray<PointLabel> label;
  kernels::DeviceArray<PointReason> reason;
  kernels::DeviceArray<std::uint8_t> roll;  ///< only if the tool rolls

  /// Not initialised.
  ScoredArrays(kernels::DeviceMemory& memory, std::size_t points, bool rolls)
      : score(memory, points),
        direction(memory, points),
        stability(memory, points),
        label(memory, points),
        reason(memory, points) {
    if (rolls) roll = kernels::DeviceArray<std::uint8_t>(memory, points);
  }

  /// @return `state` with these arrays in place of its own
  [[nodiscard]] kernels::PointStateView in(kernels::PointStateView state) const {
    state.score = score.data();
    state.direction = direction.data();
    state.stability = stability.data();
    state.label = label.data();
    state.reason = reason.data();
    state.roll = roll.data();
    return state;
  }
};

}  // namespace accessvdb::internal

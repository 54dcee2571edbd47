// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the state of a point says, and whether that is what was told of it before.
#pragma once

#include <cstddef>
#include <cstdint>

#include "hostdev/views.h"

namespace accessvdb::kernels {

/// What a point's arrays say of it.
struct StateRow {
  float normal_L[3] = {0, 0, 0};
  float stability = 1;
  std::uint16_t score = 0, direction = 0;
  PointLabel label = PointLabel::Unscored;
  PointReason reason = PointReason::None;
  std::uint8_t roll = 0, unused = 0;
};

ACCESSVDB_HOSTDEV inline StateRow stateRowOf(const PointStateView& points, std::uint32_t id) {
  StateRow row;
  for (std::size_t axis = 0; axis < 3; ++axis) row.normal_L[axis] = points.normal_L[3 * std::size_t{id} + axis];
  row.stability = points.stability[id];
  row.score = points.score[id];
  row.direction = points.direction[id];
  row.label = points.label[id];
  row.reason = points.reason[id];
  row.roll = static_cast<std::uint8_t>(points.rollOf(id));
  return row;
}

/// What tells one answer about a point from another.
struct ToldState {
  std::uint16_t score, direction;
  PointLabel label;
  PointReason reason;
};
static_assert(sizeof(ToldState) == 6);

struct ToldStates {
  ToldState* told = nullptr;        ///< [count] by id
  std::uint32_t known = 0;          ///< those of ids from here on are not initialised
  std::uint32_t count = 0;          ///< of points
  bool with_score = false;          ///< whether a score alone makes a difference
  std::uint64_t* differ = nullptr;  ///< [(count + 63) / 64] out: a bit for each id, the lowest first
};

/// Brings what was told of a point up to date. @return whether it was something else, or nothing
ACCESSVDB_HOSTDEV inline bool takeTold(const PointStateView& points, const ToldStates& states, std::uint32_t id) {
  ToldState& told = states.told[id];
  const ToldState now = {states.with_score ? points.score[id] : std::uint16_t{0}, points.direction[id],
                         points.label[id], points.reason[id]};
  if (id < states.known && told.score == now.score && told.direction == now.direction && told.label == now.label &&
      told.reason == now.reason)
    return false;
  told = now;
  return true;
}

}  // namespace accessvdb::kernels

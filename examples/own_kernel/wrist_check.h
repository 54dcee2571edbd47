// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The check that the kernel makes: the same code on host and device.
#pragma once

#include <cstdint>
#include <vector>

#include "accessvdb/device_view.h"

/// The result for a point.
enum Verdict : unsigned char { kNotAccessible, kCollides, kNotSeen, kFree, kNumVerdicts };

/// The wrist's path: from 0.16 m to 0.30 m out of the surface, along the point's best direction.
ACCESSVDB_HOSTDEV inline Verdict judge(const accessvdb::DeviceView& view, std::uint32_t id) {
  if (view.points.label[id] != accessvdb::PointLabel::Accessible) return kNotAccessible;
  double p_W[3], begin_W[3], end_W[3];
  float out_W[3];
  if (!view.positionOf(id, p_W) || !view.directionOf(id, out_W)) return kNotAccessible;
  for (int axis = 0; axis < 3; ++axis) {
    begin_W[axis] = p_W[axis] + 0.16 * out_W[axis];
    end_W[axis] = p_W[axis] + 0.30 * out_W[axis];
  }
  const accessvdb::PathOccupancy way = view.along(begin_W, end_W, 0.04);
  if (way.collision) return kCollides;
  return way.free() ? kFree : kNotSeen;
}

/// A verdict for every point of a GPU view; returns when the kernel has finished.
std::vector<unsigned char> judgeOnGpu(const accessvdb::DeviceView& view);

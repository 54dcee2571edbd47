// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The orientations of a set one by one: made once for all the tables of a tool.
#pragma once

#include <span>
#include <vector>

#include "accessvdb/params.h"
#include "launch/direction_table.h"

namespace accessvdb::internal {

struct ExpandedOrientations {
  std::vector<ToolOrientation> all;  ///< [D]
  bool is_yaw = true;                ///< OrientationSet::isYaw()

  static ExpandedOrientations of(const ApproachParams& resolved);

  [[nodiscard]] int count() const { return static_cast<int>(all.size()); }
  /// At most this many of them, evenly spread; of yaw, those of a set with fewer. @param most  4 or more
  [[nodiscard]] ExpandedOrientations sampled(int most) const;
  [[nodiscard]] kernels::DirectionTable table() const;
};

/// Appends the offsets at these distances along the body of a tool, rounded once.
void addOffsetsAlong(const ToolOrientation& orientation, std::span<const double> distances_m,
                     std::vector<float>& offsets_m);

}  // namespace accessvdb::internal

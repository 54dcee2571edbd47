// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Why a point is as it is: what stops the tool in each of its orientations there.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "accessvdb/export.h"
#include "accessvdb/types.h"

namespace accessvdb {

/// One direction at one point, in the roll with the fewest collisions.
struct DirectionOutcome {
  Eigen::Vector3f direction_W = {0, 0, 0};  ///< unit, outwards along the tool's body
  Eigen::Quaternionf orientation_WT = Eigen::Quaternionf::Identity();
  /// None: free. Normal: too far from the normal, or there is none. Unseen, Unknown, Arm, Tool as for points.
  PointReason reason = PointReason::Normal;
  std::uint16_t score = kNoScore;  ///< collisions of the tool, of its best roll; kNoScore if it was not tested
  std::uint8_t roll = 0;           ///< that roll, as SurfacePoint::roll
};

struct AccessMap {
  SurfacePoint point;                        ///< as of the last update()
  int collision_limit = 0;                   ///< [n_c] fewest collisions that block a direction
  std::vector<DirectionOutcome> directions;  ///< by index, as SurfacePoint::direction

  [[nodiscard]] std::array<std::uint64_t, kNumPointReasons> reasons() const {
    std::array<std::uint64_t, kNumPointReasons> count = {};
    for (const DirectionOutcome& outcome : directions) ++count[static_cast<std::size_t>(outcome.reason)];
    return count;
  }
};

namespace io {

/// The sphere of directions of one point as two discs of equal area, the upper half and the lower one, both as seen
/// from above, with +x to the right: a dot for each direction, coloured by what stops it, a ring around the best one.
/// @throws OutputError
ACCESSVDB_API void renderAccessMap(const std::filesystem::path& png, const AccessMap& map);

}  // namespace io
}  // namespace accessvdb

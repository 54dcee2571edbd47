// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a point's neighbours add up to, so that one that moves only a little costs a difference instead of a search.
///
/// As long as each neighbour stays nearer than the farthest one was, and no other point comes as near, the neighbours
/// are the same points: they are the k nearest, whatever lies farther away. So sums of theirs follow what moved, in
/// integers, and are those that a search would find.
#pragma once

#include <cstdint>

#include "hostdev/neighbour_rule.h"

namespace accessvdb::kernels {

struct alignas(16) KeptNeighbours {
  static constexpr std::int64_t kNone = -1;

  std::int64_t farthest;         ///< squared distance, steps, when they were searched; kNone: nothing is kept
  std::int64_t farthest_shared;  ///< of those whose views count; 0 if there are none
  std::int64_t xx, xy, xz, yy, yz, zz;
  std::int32_t x, y, z, count;  ///< offsets are at most 2^20 steps each, of at most 500 neighbours

  [[nodiscard]] ACCESSVDB_HOSTDEV NeighbourSums sums() const {
    NeighbourSums sums;
    sums.count = count;
    sums.x = x, sums.y = y, sums.z = z;
    sums.xx = xx, sums.xy = xy, sums.xz = xz, sums.yy = yy, sums.yz = yz, sums.zz = zz;
    return sums;
  }
  ACCESSVDB_HOSTDEV void setSums(const NeighbourSums& sums) {
    count = static_cast<std::int32_t>(sums.count);
    x = static_cast<std::int32_t>(sums.x), y = static_cast<std::int32_t>(sums.y), z = static_cast<std::int32_t>(sums.z);
    xx = sums.xx, xy = sums.xy, xz = sums.xz, yy = sums.yy, yz = sums.yz, zz = sums.zz;
  }

  /// Whether a new point leaves the neighbours what they are. @param now  from this point to that one
  [[nodiscard]] ACCESSVDB_HOSTDEV bool ignoreNew(const NeighbourOffset& now) const { return now.squared() > farthest; }
  /// Takes over that a point moved, or was touched where it is.
  /// @param shares  out: whether its views count  @return false: others may be neighbours now, or share views
  [[nodiscard]] ACCESSVDB_HOSTDEV bool take(const NeighbourOffset& before, const NeighbourOffset& now, bool& shares) {
    shares = false;
    const std::int64_t squared_before = before.squared(), squared_now = now.squared();
    if (squared_before > farthest && squared_now > farthest) return true;
    if (squared_before >= farthest || squared_now >= farthest) return false;
    if (squared_before == farthest_shared || squared_now == farthest_shared) return false;
    shares = squared_now < farthest_shared;
    if ((squared_before < farthest_shared) != shares) return false;
    x += static_cast<std::int32_t>(now.x - before.x);
    y += static_cast<std::int32_t>(now.y - before.y);
    z += static_cast<std::int32_t>(now.z - before.z);
    xx += now.x * now.x - before.x * before.x;
    xy += now.x * now.y - before.x * before.y;
    xz += now.x * now.z - before.x * before.z;
    yy += now.y * now.y - before.y * before.y;
    yz += now.y * now.z - before.y * before.z;
    zz += now.z * now.z - before.z * before.z;
    return true;
  }
};
static_assert(sizeof(KeptNeighbours) == 80);

}  // namespace accessvdb::kernels

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Scores one point: the best direction, its collision count, and the reason if there is none (docs/PAPER_MAP.md,
/// "Scoring").
///
/// Directions are ranked by the stage that they reached (normal < unseen < arm or unknown < tool), then by corridor
/// samples passed, then by lower count, smaller angle to the normal, lower d, lower roll. The first one determines
/// reason, direction, roll and score.
#pragma once

#include "direction_filter.h"
#include "direction_score.h"

namespace accessvdb::kernels {

struct ScoreResult;

/// What to do with one point.
struct ScoreItem {
  using Result = ScoreResult;

  std::uint32_t id = 0;
  std::uint16_t known_score = kNoScore;          ///< count of known_direction, valid under the current map
  std::uint16_t known_direction = kNoDirection;  ///< kNoDirection: none is known
  DirectionMask skip = {};                       ///< directions known not to change the outcome
  DirectionMask candidates = {};                 ///< directions that may be tried at all
  /// If set, a blocked point that stays blocked keeps its stored result: its closest direction may have been skipped.
  std::uint8_t keep_reason = 0;
  /// 0: evaluated only because the map changed, so an outcome equal to the stored one is no new evidence.
  std::uint8_t evidence = 1;
  std::uint8_t known_roll = 0;  ///< the first roll of known_direction that has known_score
  /// Of a wide set, which reads no masks: if set, no other direction is tried; with or_all, all are if it is blocked or
  /// has more collisions than known_score.
  std::uint8_t or_all = 0;
  std::int32_t only_direction = -1;
};

/// The outcome for one point.
struct ScoreResult {
  std::uint16_t score = kNoScore;
  std::uint16_t direction = kNoDirection;
  PointReason reason = PointReason::Normal;  ///< None: a direction is free
  std::uint8_t scored = 0;                   ///< 0: the point has no normal
  std::uint8_t roll = 0;                     ///< in `direction`; 0 if no tool was counted there
  std::uint8_t skipped = 0;                ///< admissible directions were skipped: reason and score cover only the rest
  std::uint16_t tests = 0;                 ///< directions tested
  DirectionMask arm_blocked = {};          ///< directions found blocked in the corridor
  DirectionMask tool_blocked = {};         ///< directions found blocked by collisions of the tool
  std::uint16_t least_blocked = kNoScore;  ///< each of tool_blocked has at least this many collisions
  // The point's stored state after the update (hostdev/point_update.h).
  PointLabel label = PointLabel::Unscored;
  std::uint8_t stored_roll = 0;
  std::uint16_t stored_score = kNoScore;
  std::uint16_t stored_direction = kNoDirection;
};

/// @param tests  how a direction is tested at the point: tests.arm(d) as testArm, tests.collisions(d, stop_above) as
///   countAxis
/// @param walk  directions in the normal cone, as DirectionWalk and SortedWalk order them; those that are not
/// candidates may be
///   missing, which only changes the reason of a point that has none
/// @param item  a ScoreItem, or one that has no masks (hostdev/wide_search.h)
template <class Tests, class Walk, class Item>
[[nodiscard]] ACCESSVDB_HOSTDEV inline typename Item::Result searchDirections(const Tests& tests, int collision_limit,
                                                                              Walk& walk, const std::uint64_t* seen,
                                                                              const Item& item) {
  typename Item::Result result;
  result.scored = 1;

  int best_count = kNoScore, best_passed = -1;
  bool in_cone = false, admissible = false;
  for (int d = walk.next(); d >= 0; d = walk.next()) {
    in_cone = true;
    if (!((seen[d >> 6] >> (d & 63)) & 1u) || !item.candidates.test(d)) continue;
    admissible = true;
    if (d == item.known_direction) {
      if (item.known_score < best_count) {
        best_count = item.known_score;
        result.direction = static_cast<std::uint16_t>(d);
        result.roll = item.known_roll;
      }
      if (best_count == 0) break;
      continue;
    }
    if (item.skip.test(d)) {
      result.skipped = 1;
      continue;
    }
    ++result.tests;
    const ArmResult arm = tests.arm(d);
    if (arm.reason != PointReason::None) {
      result.arm_blocked.set(d);
      if (best_count == kNoScore && arm.passed > best_passed) {
        best_passed = arm.passed;
        result.reason = arm.reason;
        result.direction = static_cast<std::uint16_t>(d);
      }
      continue;
    }
    // Later directions must be strictly better, so counting may stop at the best so far: minimum and argmin stay exact.
    const int bound = best_count < item.known_score ? best_count : item.known_score;
    const AxisCount counted = tests.collisions(d, bound);
    // kNoScore means that no direction got this far.
    const int count = counted.count < kNoScore ? counted.count : kNoScore - 1;
    if (count >= collision_limit) {
      result.tool_blocked.set(d);
      if (count < result.least_blocked) result.least_blocked = static_cast<std::uint16_t>(count);
    }
    if (count < best_count) {
      best_count = count;
      result.direction = static_cast<std::uint16_t>(d);
      result.roll = static_cast<std::uint8_t>(counted.roll);
      if (count == 0) break;
    }
  }
  if (!in_cone) {
    result.reason = PointReason::Normal;
  } else if (!admissible) {
    result.reason = PointReason::Unseen;
  } else if (best_count != kNoScore) {
    result.score = static_cast<std::uint16_t>(best_count);
    result.reason = best_count < collision_limit ? PointReason::None : PointReason::Tool;
  }
  return result;
}

/// Tests directions one voxel or row of voxels after the other.
struct MapTests {
  const OccupancyReader& map;
  const ToolKernelView& tool;
  const ApproachView& approach;
  const float* position_L;
  float inverse_voxel_size;

  [[nodiscard]] ACCESSVDB_HOSTDEV ArmResult arm(int d) const {
    return testArm(map, approach, d, position_L, inverse_voxel_size);
  }
  [[nodiscard]] ACCESSVDB_HOSTDEV AxisCount collisions(int d, int stop_above) const {
    const Coord point_ijk = voxelOf(position_L[0], position_L[1], position_L[2], inverse_voxel_size);
    return countAxis(tool.parts, d, stop_above, [&](int part, int stop) {
      return tool.use_samples ? countSampleCollisions(map, tool, part, position_L, inverse_voxel_size, stop)
                              : countVoxelCollisions(map, tool, part, point_ijk, stop);
    });
  }
};

ACCESSVDB_HOSTDEV inline ScoreResult searchDirections(const OccupancyReader& map, float inverse_voxel_size,
                                                      const ToolKernelView& tool, const ApproachView& approach,
                                                      const float* position_L, const float* normal_L,
                                                      const std::uint64_t* seen, const ScoreItem& item) {
  if (normal_L[0] == 0 && normal_L[1] == 0 && normal_L[2] == 0) return {};
  const MapTests tests = {map, tool, approach, position_L, inverse_voxel_size};
  if (approach.axes_xyz != nullptr) {
    SortedWalk walk(approach, normal_L);
    return searchDirections(tests, tool.collision_limit, walk, seen, item);
  }
  DirectionWalk walk(approach, normal_L);
  return searchDirections(tests, tool.collision_limit, walk, seen, item);
}

}  // namespace accessvdb::kernels

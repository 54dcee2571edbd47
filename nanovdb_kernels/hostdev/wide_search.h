// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The search of a wide set: the same rule (hostdev/direction_search.h) over more directions than a mask holds. All of
/// them are candidates and none is known beforehand, so what it finds is the first of all by the documented order.
#pragma once

#include <type_traits>

#include "hostdev/direction_search.h"

namespace accessvdb::kernels {

/// In place of a mask that all directions, or none, are in.
template <bool kAll>
struct FixedMask {
  ACCESSVDB_HOSTDEV bool test(int) const { return kAll; }
  ACCESSVDB_HOSTDEV void set(int) {}
};

/// As in ScoreResult.
struct WideResult {
  std::uint16_t score = kNoScore, direction = kNoDirection;
  PointReason reason = PointReason::Normal;
  std::uint8_t scored = 0, roll = 0, skipped = 0;
  std::uint16_t tests = 0;
  FixedMask<false> arm_blocked, tool_blocked;
  std::uint16_t least_blocked = kNoScore;
};

/// As in ScoreItem.
struct WideItem {
  using Result = WideResult;

  std::uint16_t known_score = kNoScore, known_direction = kNoDirection;
  FixedMask<false> skip;
  FixedMask<true> candidates;
  std::uint8_t known_roll = 0;
};

/// The order of SortedWalk, but the first direction that was seen comes before those that were not: mostly it is free,
/// and then no heap has to be made.
class WideWalk {
 public:
  ACCESSVDB_HOSTDEV WideWalk(const ApproachView& approach, const float* normal, const std::uint64_t* seen)
      : approach_(approach), normal_(normal) {
    float best = approach.normal_cos_min;
    for (int w = 0; 64 * w < approach.num_directions; ++w) {
      for (std::uint64_t bits = seen[w]; bits != 0; bits &= bits - 1) {
        const int d = 64 * w + lowestBit(bits);
        if (d >= approach.num_directions) break;
        const float cosine = cosToNormal(approach, d, normal);
        if (!(first_ < 0 ? cosine >= best : cosine > best)) continue;
        best = cosine;
        first_ = d;
      }
    }
  }
  ACCESSVDB_HOSTDEV int next() {
    if (!started_ && first_ >= 0) {
      started_ = true;
      return first_;
    }
    if (!made_) heap_ = Heap(approach_, normal_);
    made_ = true;
    const int d = heap_.next();
    return d == first_ && d >= 0 ? heap_.next() : d;
  }

 private:
  using Heap = HeapWalk<kMostWideDirections, std::uint16_t>;
  static_assert(std::is_trivially_copyable_v<Heap>);

  const ApproachView& approach_;
  const float* normal_;
  int first_ = -1;
  bool started_ = false, made_ = false;
  union {
    Heap heap_;  ///< if made_
  };
};

/// One direction, if it lies in the normal cone.
class SingleWalk {
 public:
  SingleWalk(const ApproachView& approach, const float* normal, int d)
      : next_(cosToNormal(approach, d, normal) >= approach.normal_cos_min ? d : -1) {}
  int next() {
    const int d = next_;
    next_ = -1;
    return d;
  }

 private:
  int next_;
};

/// @param tests  as for searchDirections  @param normal_L  not 0
/// @param seen  [words of approach.num_directions]  @param item  its masks are not read
template <class Tests>
[[nodiscard]] inline ScoreResult searchWide(const Tests& tests, const ApproachView& approach, int collision_limit,
                                            const float* normal_L, const std::uint64_t* seen, const ScoreItem& item) {
  WideItem wide;
  wide.known_score = item.known_score;
  wide.known_direction = item.known_direction;
  wide.known_roll = item.known_roll;
  const auto search = [&](auto&& walk) { return searchDirections(tests, collision_limit, walk, seen, wide); };
  WideResult found;
  bool all = item.only_direction < 0;
  if (!all) {
    found = search(SingleWalk(approach, normal_L, item.only_direction));
    all = item.or_all != 0 && (found.reason != PointReason::None || found.score > item.known_score);
  }
  if (all) {
    const std::uint16_t tested = found.tests;
    if (item.or_all != 0) wide.known_score = kNoScore;
    found = search(WideWalk(approach, normal_L, seen));
    found.tests = static_cast<std::uint16_t>(found.tests + tested);
  }
  ScoreResult result;
  result.score = found.score;
  result.direction = found.direction;
  result.reason = found.reason;
  result.scored = found.scored;
  result.roll = found.roll;
  result.tests = found.tests;
  result.least_blocked = found.least_blocked;
  return result;
}

}  // namespace accessvdb::kernels

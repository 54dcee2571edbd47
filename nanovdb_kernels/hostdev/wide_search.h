// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The search of a wide set: the same rule (hostdev/direction_search.h) over more directions than a mask holds. All of
/// them are candidates and none is known beforehand, so what it finds is the first of all by the documented order.
#pragma once

#include <cstdint>

#include "hostdev/direction_search.h"

namespace accessvdb::kernels {

/// Stands in for a mask that holds all directions (kAll) or none.
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

/// Bins of the cosine to the normal, from the normal to the edge of its cone. A direction in an earlier bin ranks
/// before all of a later one: binOf never falls as the cosine falls, however it is rounded.
struct CosineBins {
  static constexpr int kCount = 128;
  float per_cosine;

  ACCESSVDB_HOSTDEV explicit CosineBins(const ApproachView& approach)
      : per_cosine(static_cast<float>(kCount) / (1.0f - approach.normal_cos_min + 1e-3f)) {}
  [[nodiscard]] ACCESSVDB_HOSTDEV int binOf(float cosine) const {
    const int bin = static_cast<int>((1.0f - cosine) * per_cosine);
    return bin < 0 ? 0 : bin < kCount ? bin : kCount - 1;
  }
};

/// Walks the directions that were seen and lie in the normal cone, in the order of SortedWalk. The others of the cone
/// decide nothing but the reason of a point with none of those; then one of them is named.
///
/// Mostly the first direction is free, and then nothing is sorted. Else directions are put into bins of their cosine,
/// and a bin is sorted when the walk gets there.
class WideWalk {
 public:
  WideWalk(const ApproachView& approach, const float* normal, const std::uint64_t* seen) : bins_(approach) {
    float best = -2;  // below any cosine
    int count = 0;
    for (int w = 0; 64 * w < approach.num_directions; ++w) {
      for (std::uint64_t bits = seen[w]; bits != 0; bits &= bits - 1) {
        const int d = 64 * w + lowestBit(bits);
        if (d >= approach.num_directions) break;
        const float cosine = cosToNormal(approach, d, normal);
        if (!(cosine >= approach.normal_cos_min)) continue;
        if (cosine > best) {
          best = cosine;
          first_ = count;
        }
        found_[count++] = {cosine, static_cast<std::uint16_t>(d)};
      }
    }
    count_ = count;
    if (count_ == 0) unseen_ = anyInCone(approach, normal);
  }

  int next() {
    if (!started_) {
      started_ = true;
      return count_ > 0 ? found_[first_].d : unseen_;
    }
    if (at_ == 0) fillBins();
    if (++at_ >= count_) return -1;  // place 0, the best direction, was the first to be returned
    while (at_ >= sorted_) sortBin();
    return binned_[at_].d;
  }

 private:
  struct Direction {
    float cosine;
    std::uint16_t d;
  };

  [[nodiscard]] static bool before(const Direction& a, const Direction& b) {
    return ranksBefore(a.cosine, a.d, b.cosine, b.d);
  }
  [[nodiscard]] static int anyInCone(const ApproachView& approach, const float* normal) {
    for (int d = 0; d < approach.num_directions; ++d) {
      if (cosToNormal(approach, d, normal) >= approach.normal_cos_min) return d;
    }
    return -1;
  }

  void fillBins() {
    std::uint16_t next[CosineBins::kCount] = {};
    for (int n = 0; n < count_; ++n) ++next[bins_.binOf(found_[n].cosine)];
    std::uint16_t begin = 0;
    for (int bin = 0; bin < CosineBins::kCount; ++bin) {
      const std::uint16_t size = next[bin];
      next[bin] = begin;
      begin = bin_end_[bin] = static_cast<std::uint16_t>(begin + size);
    }
    for (int n = 0; n < count_; ++n) binned_[next[bins_.binOf(found_[n].cosine)]++] = found_[n];
    if (count_ > 0) sortBin();
  }
  /// Sorts the first bin that is not.
  void sortBin() {
    while (bin_end_[bin_] == sorted_) ++bin_;
    const int begin = sorted_, end = bin_end_[bin_];
    constexpr int kGaps[] = {701, 301, 132, 57, 23, 10, 4, 1};  // Ciura's, for Shell's sort
    for (const int gap : kGaps) {
      for (int n = begin + gap; n < end; ++n) {
        const Direction moved = binned_[n];
        int at = n;
        for (; at - gap >= begin && before(moved, binned_[at - gap]); at -= gap) binned_[at] = binned_[at - gap];
        binned_[at] = moved;
      }
    }
    sorted_ = bin_end_[bin_];
  }

  CosineBins bins_;
  int count_ = 0, first_ = 0;  ///< of found_
  int unseen_ = -1;            ///< a direction of the cone, if none that was seen is in it
  bool started_ = false;
  int at_ = 0, bin_ = 0, sorted_ = 0;  ///< place of the walk in binned_, bin to sort next, and how many are sorted
  // Not initialised: most of it is never used.
  Direction found_[kMostWideDirections], binned_[kMostWideDirections];
  std::uint16_t bin_end_[CosineBins::kCount];
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

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which directions are admissible, and in which order they are tried (paper, "Approach directions").
#pragma once

#include <cmath>

#include "hostdev/views.h"

namespace accessvdb::kernels {

/// Cosine between yaw direction d and a normal.
ACCESSVDB_HOSTDEV inline float yawCosToNormal(const ApproachView& approach, int d, const float* normal) {
  return approach.direction_xy[2 * d] * normal[0] + approach.direction_xy[2 * d + 1] * normal[1];
}
/// Cosine between direction d of any set and a normal. For a level direction the third product adds 0, so both forms
/// have the same bits.
ACCESSVDB_HOSTDEV inline float cosToNormal(const ApproachView& approach, int d, const float* normal) {
  if (approach.axes_xyz != nullptr) {
    const float* axis = approach.axes_xyz + 3 * d;
    return axis[0] * normal[0] + axis[1] * normal[1] + axis[2] * normal[2];
  }
  return yawCosToNormal(approach, d, normal);
}

/// The largest number of yaw directions within the cone of a normal: an arc of twice the cone, for level normals. On
/// the host; one more for rounding.
inline int mostInCone(int num_directions, double normal_cos_min) {
  const double arc = std::acos(normal_cos_min) / std::acos(-1.0) * num_directions;
  const int most = static_cast<int>(arc) + 2;
  return most < num_directions ? most : num_directions;
}

/// Sets the directions `first` .. `last` of a circle of num_directions; last < first + num_directions.
/// @param first  at least -num_directions, below num_directions
ACCESSVDB_HOSTDEV inline DirectionMask arcMask(int first, int last, int num_directions) {
  const auto bitsFrom = [](int from, int to, int w) {  // of 64 w .. 64 w + 63
    const int low = from - 64 * w, high = to - 64 * w;
    if (low > 63 || high < 0) return std::uint64_t{0};
    return (~std::uint64_t{0} << (low > 0 ? low : 0)) & (~std::uint64_t{0} >> (high < 63 ? 63 - high : 0));
  };
  if (first < 0) {
    first += num_directions;
    last += num_directions;
  }
  DirectionMask mask = {};
  ACCESSVDB_UNROLL
  for (int w = 0; w < kMaxDirectionWords; ++w) {
    mask.word[w] = bitsFrom(first, last < num_directions ? last : num_directions - 1, w);
    if (last >= num_directions) mask.word[w] |= bitsFrom(0, last - num_directions, w);
  }
  return mask;
}

/// The directions whose cosine to a normal may be `least` or more: all that are, and a few beside them. Much cheaper
/// than asking each one. Of sets that are no yaws it takes all.
ACCESSVDB_HOSTDEV inline DirectionMask aroundNormal(const ApproachView& approach, const float* normal, float least) {
  const int directions = approach.num_directions;
  if (approach.axes_xyz != nullptr) return arcMask(0, directions - 1, directions);
  // The cosine is level * cos(yaw of the direction - yaw of the normal).
  const float level = sqrtf(normal[0] * normal[0] + normal[1] * normal[1]);
  if (least > level + 1e-5f) return {};
  if (!(level > 1e-3f)) return arcMask(0, directions - 1, directions);  // its yaw says little
  constexpr float kPi = 3.14159265f;
  const float per_radian = static_cast<float>(directions) / (2 * kPi), ratio = least / level;
  // One direction more on each side: rounding moves the end of the arc by less than a tenth of that.
  const float half = acosf(ratio < -1 ? -1.0f : ratio > 1 ? 1.0f : ratio) * per_radian + 1;
  if (2 * half + 2 >= static_cast<float>(directions)) return arcMask(0, directions - 1, directions);
  const float yaw = atan2f(normal[1], normal[0]) * per_radian;
  return arcMask(static_cast<int>(floorf(yaw - half)), static_cast<int>(ceilf(yaw + half)), directions);
}

/// Is direction d tried before e?
ACCESSVDB_HOSTDEV inline bool ranksBefore(float cos_d, int d, float cos_e, int e) {
  return cos_d > cos_e || (cos_d == cos_e && d < e);
}
ACCESSVDB_HOSTDEV inline bool ranksBefore(const ApproachView& approach, const float* normal, int d, int e) {
  return ranksBefore(cosToNormal(approach, d, normal), d, cosToNormal(approach, e, normal), e);
}

/// Walks yaw directions by ascending angle to the normal, ties by lower d, as long as they lie in the normal cone.
///
/// Directions are equidistant in yaw, so the angle grows on both sides of the nearest one: the walk is a merge of the
/// two sides. Neighbouring cosines differ by more than 1e-5 inside the cone (D <= 256), far above float32's rounding.
class DirectionWalk {
 public:
  ACCESSVDB_HOSTDEV DirectionWalk(const ApproachView& approach, const float* normal)
      : DirectionWalk(approach, normal, nearestDirection(approach, normal)) {}

  /// For callers that already know nearestDirection.
  ACCESSVDB_HOSTDEV DirectionWalk(const ApproachView& approach, const float* normal, int nearest)
      : approach_(approach), normal_{normal[0], normal[1], normal[2]} {
    up_ = nearest;
    up_cos_ = yawCosToNormal(approach_, nearest, normal_);
    down_ = nearest;
    stepDown();
    left_ = approach_.num_directions;
  }

  /// The direction with the largest cosine to the normal; on ties, the lowest.
  ACCESSVDB_HOSTDEV static int nearestDirection(const ApproachView& approach, const float* normal) {
    int nearest = 0;
    float best = yawCosToNormal(approach, 0, normal);
    for (int d = 1; d < approach.num_directions; ++d) {
      const float c = yawCosToNormal(approach, d, normal);
      if (c > best) {
        best = c;
        nearest = d;
      }
    }
    return nearest;
  }

  /// Next direction, or -1 when the cone is exhausted.
  ACCESSVDB_HOSTDEV int next() {
    if (left_ == 0) return -1;
    const bool take_up = up_cos_ > down_cos_ || (up_cos_ == down_cos_ && up_ <= down_);
    const float c = take_up ? up_cos_ : down_cos_;
    if (!(c >= approach_.normal_cos_min)) return -1;
    --left_;
    const int d = take_up ? up_ : down_;
    if (take_up) {
      stepUp();
    } else {
      stepDown();
    }
    return d;
  }

 private:
  ACCESSVDB_HOSTDEV void stepUp() {
    up_ = up_ + 1 == approach_.num_directions ? 0 : up_ + 1;
    up_cos_ = yawCosToNormal(approach_, up_, normal_);
  }
  ACCESSVDB_HOSTDEV void stepDown() {
    down_ = down_ == 0 ? approach_.num_directions - 1 : down_ - 1;
    down_cos_ = yawCosToNormal(approach_, down_, normal_);
  }

  const ApproachView& approach_;
  float normal_[3];
  int up_, down_, left_;
  float up_cos_, down_cos_;
};

/// The same walk for any set with a mask: a heap of the directions in the normal cone.
class SortedWalk {
 public:
  ACCESSVDB_HOSTDEV SortedWalk(const ApproachView& approach, const float* normal) {
    for (int d = 0; d < approach.num_directions; ++d) {
      const float cosine = cosToNormal(approach, d, normal);
      if (!(cosine >= approach.normal_cos_min)) continue;
      cosine_[count_] = cosine;
      direction_[count_] = static_cast<std::uint8_t>(d);
      ++count_;
    }
    for (int n = count_ / 2 - 1; n >= 0; --n) sink(n);
  }

  /// Next direction, or -1 when the cone is exhausted.
  ACCESSVDB_HOSTDEV int next() {
    if (count_ == 0) return -1;
    const int d = direction_[0];
    --count_;
    cosine_[0] = cosine_[count_];
    direction_[0] = direction_[count_];
    sink(0);
    return d;
  }

 private:
  static_assert(kMostMaskedDirections <= 256, "an index holds any direction");

  [[nodiscard]] ACCESSVDB_HOSTDEV bool before(int m, int n) const {
    return ranksBefore(cosine_[m], direction_[m], cosine_[n], direction_[n]);
  }
  /// Moves entry n down to where no entry below it ranks before it.
  ACCESSVDB_HOSTDEV void sink(int n) {
    for (int child = 2 * n + 1; child < count_; child = 2 * n + 1) {
      if (child + 1 < count_ && before(child + 1, child)) ++child;
      if (!before(child, n)) return;
      const float cosine = cosine_[n];
      const std::uint8_t direction = direction_[n];
      cosine_[n] = cosine_[child];
      direction_[n] = direction_[child];
      cosine_[child] = cosine;
      direction_[child] = direction;
      n = child;
    }
  }

  float cosine_[kMostMaskedDirections];
  std::uint8_t direction_[kMostMaskedDirections];
  int count_ = 0;
};

/// The directions of a small set that lie in the normal cone, as the walks order them.
class FewDirections {
 public:
  static constexpr int kMost = 16;

  /// @param directions  at most kMost
  ACCESSVDB_HOSTDEV FewDirections(const ApproachView& approach, const float* normal, const DirectionMask& directions) {
    forEachDirection(directions, [&](int d) {
      const float cosine = cosToNormal(approach, d, normal);
      if (!(cosine >= approach.normal_cos_min)) return;
      int at = count_++;
      for (; at > 0 && ranksBefore(cosine, d, cosine_[at - 1], direction_[at - 1]); --at) {
        cosine_[at] = cosine_[at - 1];
        direction_[at] = direction_[at - 1];
      }
      cosine_[at] = cosine;
      direction_[at] = d;
    });
  }
  /// Next direction, or -1.
  ACCESSVDB_HOSTDEV int next() { return next_ < count_ ? direction_[next_++] : -1; }

 private:
  float cosine_[kMost];
  int direction_[kMost];
  int count_ = 0, next_ = 0;
};

}  // namespace accessvdb::kernels

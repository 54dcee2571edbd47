// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/query/access_probability.h"

#include <algorithm>
#include <string>

#include "accessvdb/access_probability.h"
#include "accessvdb/error.h"
#include "field/query/probability_constants.h"

namespace accessvdb {
namespace internal {
namespace {

constexpr float kMostNoise_voxels = 4, kMostObservations = 4096, kMostTimesTheLimit = 6, kMostLimit = 1024,
                kMostRoom_voxels = 4;
constexpr float kThousandths = 1000;

/// exp(1/4) and its inverse to the last bit of a float, by which the table below is made.
constexpr double kQuarterStep = 1.2840254166877414841;
constexpr std::size_t kQuarters = 32;  // 8 in quarters, to either side

constexpr std::array<float, 2 * kQuarters + 1> logisticTable() {
  std::array<float, 2 * kQuarters + 1> table = {};
  double power = 1;  // exp(n / 4)
  for (std::size_t n = 0; n <= kQuarters; ++n) {
    table[kQuarters + n] = static_cast<float>(power / (1 + power));
    table[kQuarters - n] = static_cast<float>(1 / (1 + power));
    power *= kQuarterStep;
  }
  return table;
}
constexpr std::array<float, 2 * kQuarters + 1> kLogistic = logisticTable();

/// NaN counts as the worse end.
float inRange(float value, float low, float high, float worse) {
  if (!(value >= low && value <= high)) return value > high ? high : value < low ? low : worse;
  return value;
}

std::optional<ProbabilityGroup> groupOf(const SurfacePoint& point) {
  if (point.label == PointLabel::Unscored) return std::nullopt;
  switch (point.reason) {
    case PointReason::None:
      return point.margin_m >= 0 ? ProbabilityGroup::AccessibleWithRoom : ProbabilityGroup::Accessible;
    case PointReason::Tool:
      return ProbabilityGroup::Tool;
    case PointReason::Arm:
      return ProbabilityGroup::Arm;
    case PointReason::Unknown:
      return ProbabilityGroup::Unknown;
    default:
      return std::nullopt;
  }
}

}  // namespace

const char* name(ProbabilityGroup group) {
  constexpr const char* kNames[kProbabilityGroups] = {"accessible", "accessible_with_room", "tool", "arm", "unknown"};
  return kNames[static_cast<std::size_t>(group)];
}

float doublings(float x) {
  constexpr float kMost = 1 << 24;
  float rest = inRange(x, 1, kMost, 1), whole = 0;
  for (; rest >= 2; rest *= 0.5F) whole += 1;
  return whole + (rest - 1);
}

float shareOfOdds(float odds) {
  const float at = (inRange(odds, -8, 8, -8) + 8) * 4;  // exact
  const auto n = std::min(static_cast<std::size_t>(at), 2 * kQuarters - 1);
  return kLogistic[n] + (at - static_cast<float>(n)) * (kLogistic[n + 1] - kLogistic[n]);
}

ProbabilityModel::ProbabilityModel(const FieldParams& resolved, int collision_limit) {
  if (resolved.update.policy != UpdatePolicy::Exact) return;
  collision_limit_ = static_cast<float>(collision_limit);
  voxel_size_m_ = static_cast<float>(resolved.tsdf.voxel_size_m);
  noise_voxels_ = static_cast<float>(resolved.tsdf.range_noise_m / resolved.tsdf.voxel_size_m);
}

std::optional<ProbabilityTerms> ProbabilityModel::terms(const SurfacePoint& point) const {
  const std::optional<ProbabilityGroup> group = collision_limit_ > 0 ? groupOf(point) : std::nullopt;
  if (!group) return std::nullopt;
  ProbabilityTerms terms;
  terms.group = *group;
  const float share = static_cast<float>(point.score) / collision_limit_;
  if (*group == ProbabilityGroup::Tool) {
    terms.collisions = inRange(doublings(share), 0, kMostTimesTheLimit, kMostTimesTheLimit);
  } else if (point.score != kNoScore) {
    terms.collisions = inRange(share, 0, 1, 1);
  }
  if (point.direction != kNoDirection) {
    const Eigen::Vector3f &n = point.normal_W, &d = point.direction_W;
    // In this order: a level direction adds nothing at the end.
    terms.slant = inRange(1 - (n.x() * d.x() + n.y() * d.y() + n.z() * d.z()), 0, 1, 1);
  }
  terms.noise = inRange(noise_voxels_, 0, kMostNoise_voxels, kMostNoise_voxels);
  terms.observations = doublings(inRange(point.weight, 1, kMostObservations, 1));
  terms.limit = doublings(inRange(collision_limit_, 1, kMostLimit, 1));
  if (*group == ProbabilityGroup::AccessibleWithRoom) {
    terms.room = inRange(point.margin_m / voxel_size_m_, 0, kMostRoom_voxels, 0);
  }
  return terms;
}

float ProbabilityModel::of(const SurfacePoint& point) const {
  const std::optional<ProbabilityTerms> terms = this->terms(point);
  if (!terms) return -1;
  const ProbabilityConstants& constants = kProbabilityConstants[static_cast<std::size_t>(terms->group)];
  const auto values = terms->values();
  float odds = 0;
  for (std::size_t n = 0; n < values.size(); ++n) odds += constants[n] * values[n];
  const auto thousandths = static_cast<int>(shareOfOdds(odds) * kThousandths + 0.5F);
  return static_cast<float>(thousandths) / kThousandths;
}

}  // namespace internal

float accessProbability(const SurfacePoint& point, int collision_limit, const FieldParams& resolved) {
  if (resolved.update.policy != UpdatePolicy::Exact) {
    throw InvalidArgument("probability.profile", "", "the paper's update policy has no access probabilities",
                          "Use the product's profile");
  }
  if (collision_limit < 1) {
    throw InvalidArgument("probability.limit", std::to_string(collision_limit), "is not a collision limit of 1 or more",
                          "Use AccessibilityField::collisionLimit()");
  }
  return internal::ProbabilityModel(resolved, collision_limit).of(point);
}

}  // namespace accessvdb

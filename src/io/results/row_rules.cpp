// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/results/row_rules.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <string>

#include "io/streams/exact_text.h"

namespace accessvdb::internal {
namespace {

/// Of unit vectors in float32, which other programs may have written in a few digits.
constexpr float kUnitTolerance = 1e-2f;
/// Of a share that a float32 rounds up.
constexpr float kShareTolerance = 1e-5f;

std::optional<double> numberOf(const io::FieldMetadata& metadata, const std::string& key) {
  for (const auto& [name, text] : metadata) {
    if (name != key) continue;
    if (const auto value = numberIn<double>(text)) return value;
  }
  return std::nullopt;
}

float squaredNorm(const Eigen::Vector3f& v) { return v.x() * v.x() + v.y() * v.y() + v.z() * v.z(); }
bool isUnit(float squared_norm) { return std::abs(squared_norm - 1) <= 2 * kUnitTolerance; }
bool isUnitOrZero(float squared_norm) { return squared_norm == 0 || isUnit(squared_norm); }
bool isShare(float value) { return value >= 0 && value <= 1 + kShareTolerance; }

}  // namespace

RowRules::RowRules(const PointsPlyColumns& columns, const io::FieldMetadata& metadata)
    : columns_(columns), rolls_(numberOf(metadata, "rolls")) {
  if (!columns.tools) {
    collision_limits_ = {numberOf(metadata, "collision_limit")};
    return;
  }
  for (const auto& [key, text] : metadata) {
    std::istringstream names(text), margins(text);
    for (std::string margin_m; key == "margins_m" && std::getline(margins, margin_m, ',');)
      margins_m_.push_back(static_cast<float>(numberIn<double>(margin_m).value_or(-1)));
    for (std::string name; key == "tools" && std::getline(names, name, ',');) {
      collision_limits_.push_back(numberOf(metadata, std::string("tool_").append(name).append("_collision_limit")));
    }
  }
}

const char* RowRules::contradictionIn(const SurfacePoint& point) const {
  if (!isShare(point.confidence) || !isShare(point.stability))
    return "its confidence or stability is not between 0 and 1";
  if (columns_.probability && point.access_probability != -1) {
    if (!isShare(point.access_probability)) return "its access probability is neither between 0 and 1 nor -1";
    if (point.label == PointLabel::Unscored) return "it is unscored, but has an access probability";
  }
  if (!isUnitOrZero(squaredNorm(point.normal_W))) return "its normal is neither of unit length nor zero";
  if (!isUnitOrZero(squaredNorm(point.direction_W))) return "its direction is neither of unit length nor zero";
  if (columns_.orientation && !isUnit(point.orientation_WT.coeffs().squaredNorm()))
    return "its orientation is no unit quaternion";
  if (columns_.roll && rolls_ && *rolls_ >= 1 && point.roll >= *rolls_) return "its roll is none of those tried";
  if (columns_.tools && point.tool >= collision_limits_.size()) return "its tool is none of the map's";
  if (columns_.tools && collision_limits_.size() < 32 && point.tools >> collision_limits_.size() != 0)
    return "tools reach it that the map does not have";
  if (columns_.margin && !isMarginOf(point)) return "its margin is not one of those of the tools that reach it";
  if (point.label == PointLabel::Accessible) return contradictionInAccessible(point);
  if (columns_.tools && point.tools != 0) return "a tool reaches it, but it is not accessible";
  if (point.label == PointLabel::Blocked && point.reason == PointReason::None) return "it is blocked without a reason";
  return nullptr;
}

bool RowRules::isMarginOf(const SurfacePoint& point) const {
  if (margins_m_.size() != collision_limits_.size()) return false;
  float most_m = -1;
  for (std::size_t k = point.tool; k < margins_m_.size() && (k == point.tool || margins_m_[k] > 0); ++k)
    if ((point.tools >> k & 1) != 0) most_m = std::max(most_m, margins_m_[k]);
  return point.margin_m == most_m;
}

const char* RowRules::contradictionInAccessible(const SurfacePoint& point) const {
  if (point.reason != PointReason::None) return "it is accessible, but has a reason not to be";
  if (squaredNorm(point.direction_W) == 0) return "it is accessible without a direction";
  if (columns_.orientation && point.direction == kNoDirection) return "it is accessible without an orientation";
  if (point.score == kNoScore) return "it is accessible without a score";
  const std::optional<double>& limit = collision_limits_[point.tool];
  if (limit && point.score >= *limit) return "it is accessible, but its score is not below the collision limit";
  if (columns_.tools && (point.tools >> point.tool & 1) == 0) return "it is accessible, but its tool does not reach it";
  if (columns_.orientation) return nullptr;
  const Eigen::Quaternionf& q = point.orientation_WT;  // about z, by the yaw
  const Eigen::Vector3f& d = point.direction_W;
  const float x = q.w() * q.w() - q.z() * q.z(), y = 2 * q.w() * q.z();
  if (!(x * d.x() + y * d.y() >= 1 - kUnitTolerance)) return "its direction is not that of its yaw";
  return nullptr;
}

}  // namespace accessvdb::internal

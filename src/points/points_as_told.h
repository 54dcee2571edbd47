// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What was told of each point, and which points are something else now.
#pragma once

#include <cstdint>
#include <vector>

#include "accessvdb/surface_points.h"

namespace accessvdb::internal {

class PointsAsTold {
 public:
  /// @param several  tools: which of them reach a point counts, too
  explicit PointsAsTold(bool several) : several_(several) {}

  /// Compares with what was told before. Scores and confidence change with nearly every scan and do not count.
  /// @param points  some or all points of a field, by id, with all that are new  @param count  of all its points
  /// @return those that are new, or whose label, reason or direction changed, in the same order. If it throws, the next
  ///         call has them
  [[nodiscard]] std::vector<SurfacePoint> since(const SurfacePoints& points, std::uint32_t count);
  /// Of all points at the call before.
  [[nodiscard]] std::uint32_t size() const { return static_cast<std::uint32_t>(told_.size()); }
  /// Whether a point was told as taken out of the map, or gone.
  [[nodiscard]] bool isTaken(std::uint32_t id) const {
    return told_[id].label == PointLabel::Unscored && told_[id].reason == PointReason::Changed;
  }
  [[nodiscard]] std::uint64_t bytes() const {
    return told_.capacity() * sizeof told_[0] + tools_.capacity() * sizeof tools_[0];
  }

 private:
  struct Told {
    PointLabel label = PointLabel::Unscored;
    PointReason reason = PointReason::None;
    std::uint16_t direction = kNoDirection;
    bool operator==(const Told&) const = default;
  };
  [[nodiscard]] static Told toldOf(const SurfacePoint& point) { return {point.label, point.reason, point.direction}; }
  [[nodiscard]] bool isOther(const SurfacePoint& point) const;

  bool several_;
  std::vector<Told> told_;            ///< by id
  std::vector<std::uint32_t> tools_;  ///< [told_] of several
};

}  // namespace accessvdb::internal

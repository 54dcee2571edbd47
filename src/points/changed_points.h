// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which points are not what they were when they were last looked at.
#pragma once

#include <cstdint>
#include <vector>

#include "accessvdb/surface_points.h"

namespace accessvdb::internal {

class ChangedPoints {
 public:
  /// @param several  tools: which of them reach a point counts, too
  explicit ChangedPoints(bool several) : several_(several) {}

  /// Compares with the call before. Scores and confidence change with nearly every scan and do not count.
  /// @param points  all points of a field, of which the first ones are those of the call before
  /// @return those that are new, or whose label, reason or direction changed, in the same order. If it throws, the next
  ///         call has them
  [[nodiscard]] std::vector<SurfacePoint> since(const SurfacePoints& points);
  [[nodiscard]] std::uint64_t bytes() const {
    return seen_.capacity() * sizeof seen_[0] + tools_.capacity() * sizeof tools_[0];
  }

 private:
  struct Seen {
    PointLabel label;
    PointReason reason;
    std::uint16_t direction;
    bool operator==(const Seen&) const = default;
  };
  [[nodiscard]] static Seen seenOf(const SurfacePoint& point) { return {point.label, point.reason, point.direction}; }
  bool several_;
  std::vector<Seen> seen_;
  std::vector<std::uint32_t> tools_;  ///< [seen_] of several
};

}  // namespace accessvdb::internal

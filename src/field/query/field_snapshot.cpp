// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Counting and filtering the points of a snapshot.
#include <algorithm>
#include <iterator>

#include "accessvdb/types.h"

namespace accessvdb {

std::vector<SurfacePoint> FieldSnapshot::with(PointLabel label) const {
  std::vector<SurfacePoint> found;
  found.reserve(count(label));
  std::copy_if(points.begin(), points.end(), std::back_inserter(found),
               [label](const SurfacePoint& point) { return point.label == label; });
  return found;
}

std::uint64_t FieldSnapshot::count(PointLabel label) const {
  return static_cast<std::uint64_t>(
      std::count_if(points.begin(), points.end(), [label](const SurfacePoint& point) { return point.label == label; }));
}

std::array<std::uint64_t, kNumPointReasons> FieldSnapshot::reasons() const {
  std::array<std::uint64_t, kNumPointReasons> counts = {};
  for (const SurfacePoint& point : points) ++counts[static_cast<std::size_t>(point.reason)];
  return counts;
}

}  // namespace accessvdb

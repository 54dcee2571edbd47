// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/changed_points.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>

namespace accessvdb::internal {

std::vector<SurfacePoint> ChangedPoints::since(const SurfacePoints& points) {
  constexpr std::size_t kPointsPerTask = 4096;
  const std::size_t before = seen_.size(), blocks = (points.size() + kPointsPerTask - 1) / kPointsPerTask;
  std::vector<std::vector<SurfacePoint>> changed(blocks);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, blocks, 1), [&](const auto& range) {
    for (std::size_t block = range.begin(); block != range.end(); ++block) {
      for (std::size_t n = block * kPointsPerTask; n < std::min((block + 1) * kPointsPerTask, points.size()); ++n) {
        const SurfacePoint point = points.at(n);
        if (n < before && seen_[n] == seenOf(point) && (!several_ || tools_[n] == point.tools)) continue;
        changed[block].push_back(point);
      }
    }
  });
  std::vector<SurfacePoint> all;
  for (const std::vector<SurfacePoint>& some : changed) all.insert(all.end(), some.begin(), some.end());
  seen_.reserve(points.size());
  if (several_) tools_.reserve(points.size());
  // Nothing throws from here on: else changes would count as told that nobody hears of.
  seen_.resize(points.size());
  if (several_) tools_.resize(points.size());
  for (const SurfacePoint& point : all) {
    seen_[point.id] = seenOf(point);
    if (several_) tools_[point.id] = point.tools;
  }
  return all;
}

}  // namespace accessvdb::internal

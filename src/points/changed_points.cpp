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
  struct Changed {
    std::vector<std::size_t> places;  ///< of the points in `points`, whose ids may be others
    std::vector<SurfacePoint> points;
  };
  std::vector<Changed> changed(blocks);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, blocks, 1), [&](const auto& range) {
    for (std::size_t block = range.begin(); block != range.end(); ++block) {
      for (std::size_t n = block * kPointsPerTask; n < std::min((block + 1) * kPointsPerTask, points.size()); ++n) {
        const SurfacePoint point = points.at(n);
        if (n < before && seen_[n] == seenOf(point) && (!several_ || tools_[n] == point.tools)) continue;
        changed[block].places.push_back(n);
        changed[block].points.push_back(point);
      }
    }
  });
  std::vector<SurfacePoint> all;
  for (const Changed& some : changed) all.insert(all.end(), some.points.begin(), some.points.end());
  seen_.reserve(points.size());
  if (several_) tools_.reserve(points.size());
  // Nothing throws from here on: else changes would count as told that nobody hears of.
  seen_.resize(points.size());
  if (several_) tools_.resize(points.size());
  for (const Changed& some : changed) {
    for (std::size_t k = 0; k < some.places.size(); ++k) {
      seen_[some.places[k]] = seenOf(some.points[k]);
      if (several_) tools_[some.places[k]] = some.points[k].tools;
    }
  }
  return all;
}

}  // namespace accessvdb::internal

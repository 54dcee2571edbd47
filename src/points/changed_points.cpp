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
  seen_.resize(points.size());
  tools_.resize(several_ ? points.size() : 0);
  std::vector<std::vector<SurfacePoint>> changed(blocks);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, blocks, 1), [&](const auto& range) {
    for (std::size_t block = range.begin(); block != range.end(); ++block) {
      for (std::size_t n = block * kPointsPerTask; n < std::min((block + 1) * kPointsPerTask, points.size()); ++n) {
        const SurfacePoint point = points.at(n);
        const Seen now = {point.label, point.reason, point.direction};
        if (n < before && seen_[n] == now && (!several_ || tools_[n] == point.tools)) continue;
        seen_[n] = now;
        if (several_) tools_[n] = point.tools;
        changed[block].push_back(point);
      }
    }
  });
  std::vector<SurfacePoint> all;
  for (const std::vector<SurfacePoint>& some : changed) all.insert(all.end(), some.begin(), some.end());
  return all;
}

}  // namespace accessvdb::internal

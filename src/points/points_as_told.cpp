// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/points_as_told.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>

namespace accessvdb::internal {
namespace {

constexpr std::size_t kComparedPerTask = 1024;

/// As push_back() would: not with every scan.
template <typename T>
void reserveWithRoom(std::vector<T>& list, std::size_t size) {
  if (size > list.capacity()) list.reserve(std::max(size, list.capacity() + list.capacity() / 4));
}

}  // namespace

bool PointsAsTold::isOther(const SurfacePoint& point) const {
  const std::uint32_t id = point.id;
  return id >= told_.size() || told_[id] != toldOf(point) || (several_ && tools_[id] != point.tools);
}

std::vector<SurfacePoint> PointsAsTold::since(const SurfacePoints& points, std::uint32_t count) {
  const std::size_t blocks = (points.size() + kComparedPerTask - 1) / kComparedPerTask;
  // Places in `points`: looking twice takes less than keeping what was seen.
  std::vector<std::vector<std::size_t>> places(blocks);
  const auto forEachBlock = [&](const auto& visit) {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, blocks, 1), [&](const auto& range) {
      for (std::size_t block = range.begin(); block != range.end(); ++block) visit(block);
    });
  };
  forEachBlock([&](std::size_t block) {
    const std::size_t end = std::min((block + 1) * kComparedPerTask, points.size());
    for (std::size_t n = block * kComparedPerTask; n < end; ++n)
      if (isOther(points.at(n))) places[block].push_back(n);
  });
  std::vector<std::size_t> first(blocks + 1, 0);
  for (std::size_t block = 0; block < blocks; ++block) first[block + 1] = first[block] + places[block].size();
  std::vector<SurfacePoint> changed(first[blocks]);
  forEachBlock([&](std::size_t block) {
    std::size_t k = first[block];
    for (const std::size_t n : places[block]) changed[k++] = points.at(n);
  });
  reserveWithRoom(told_, count);
  if (several_) reserveWithRoom(tools_, count);
  // Nothing throws from here on: else changes would count as told that nobody hears of.
  told_.resize(count);
  if (several_) tools_.resize(count);
  for (const SurfacePoint& point : changed) {
    told_[point.id] = toldOf(point);
    if (several_) tools_[point.id] = point.tools;
  }
  return changed;
}

}  // namespace accessvdb::internal

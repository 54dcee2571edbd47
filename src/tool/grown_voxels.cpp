// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/grown_voxels.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "tool/voxel_bitmap.h"
#include "tool/voxel_runs.h"

namespace accessvdb::internal {
namespace {

/// A margin of whole voxels is meant to reach so many, whatever the last bit of the quotient says.
constexpr double kWhole = 1e-9;

double square(double x) { return x * x; }

/// Calls add(run) with the voxels within the margin of each run; those of several overlap.
template <typename Add>
void forEachWithin(const std::vector<VoxelRun>& runs, double margin, const Add& add) {
  const auto reach = static_cast<std::int32_t>(margin);
  for (std::int32_t di = -reach; di <= reach; ++di) {
    for (std::int32_t dj = -reach; dj <= reach; ++dj) {
      const double left = square(margin) - di * di - dj * dj;
      if (left < 0) continue;
      const auto up = static_cast<std::int32_t>(std::sqrt(left));
      for (const VoxelRun& run : runs) add({run.i + di, run.j + dj, run.lo - up, run.hi + up});
    }
  }
}

std::vector<VoxelRun> allWithin(const std::vector<VoxelRun>& runs, double margin) {
  if (runs.empty()) return {};
  const auto reach = static_cast<std::int32_t>(margin);
  VoxelBitmap::Box box = {{runs[0].i, runs[0].j, runs[0].lo}, {runs[0].i, runs[0].j, runs[0].hi}};
  for (const VoxelRun& run : runs) {
    box.low = {std::min(box.low[0], run.i), std::min(box.low[1], run.j), std::min(box.low[2], run.lo)};
    box.high = {std::max(box.high[0], run.i), std::max(box.high[1], run.j), std::max(box.high[2], run.hi)};
  }
  for (std::size_t axis = 0; axis < 3; ++axis) box.low[axis] -= reach, box.high[axis] += reach;
  if (box.bits() <= VoxelBitmap::kMostBits) {
    VoxelBitmap voxels(box);
    forEachWithin(runs, margin, [&](const VoxelRun& run) { voxels.add(run); });
    return voxels.runs();
  }
  // One row of columns at a time: all runs at once would be many times the result.
  std::vector<VoxelRun> all, row;
  std::size_t first = 0;
  for (std::int32_t i = box.low[0]; i <= box.high[0]; ++i) {
    row.clear();
    while (first < runs.size() && runs[first].i < i - reach) ++first;
    for (std::size_t n = first; n < runs.size() && runs[n].i <= i + reach; ++n) {
      for (std::int32_t dj = -reach; dj <= reach; ++dj) {
        const double left = square(margin) - square(runs[n].i - i) - dj * dj;
        if (left < 0) continue;
        const auto up = static_cast<std::int32_t>(std::sqrt(left));
        row.push_back({i, runs[n].j + dj, runs[n].lo - up, runs[n].hi + up});
      }
    }
    joinRuns(row);
    all.insert(all.end(), row.begin(), row.end());
  }
  return all;
}

}  // namespace

std::vector<VoxelRun> grownVoxels(const std::vector<VoxelRun>& runs, double margin, double self_exclusion_voxels) {
  const double reach = margin * (1 + kWhole);
  if (!(reach >= 1) || runs.empty()) return runs;
  if (!(self_exclusion_voxels >= 0)) return allWithin(runs, reach);
  std::vector<VoxelRun> beyond = runs;
  removeBall(beyond, self_exclusion_voxels + reach / kRoomPerDistance);
  std::vector<VoxelRun> grown = allWithin(beyond, reach);
  for (const VoxelRun& run : voxelsWithout(runs, beyond)) {
    for (std::int32_t k = run.lo; k <= run.hi; ++k) {
      const double from_tip = std::sqrt(square(run.i) + square(run.j) + square(k));
      forEachWithin({{run.i, run.j, k, k}}, std::min(reach, kRoomPerDistance * (from_tip - self_exclusion_voxels)),
                    [&](const VoxelRun& more) { grown.push_back(more); });
    }
  }
  joinRuns(grown);
  return grown;
}

}  // namespace accessvdb::internal

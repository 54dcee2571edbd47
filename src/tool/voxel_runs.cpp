// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/voxel_runs.h"

#include <algorithm>
#include <tuple>

namespace accessvdb::internal {
namespace {

/// Calls visit(run, others) for each run of a, with the runs of b that meet it.
template <typename Visit>
void withMeeting(const std::vector<VoxelRun>& a, const std::vector<VoxelRun>& b, const Visit& visit) {
  auto first = b.begin();
  for (const VoxelRun& run : a) {
    const auto ends_before = [&run](const VoxelRun& other) {
      return std::tie(other.i, other.j, other.hi) < std::tie(run.i, run.j, run.lo);
    };
    while (first != b.end() && ends_before(*first)) ++first;
    auto last = first;  // the same run of b may meet the next one of a, too
    while (last != b.end() && last->i == run.i && last->j == run.j && last->lo <= run.hi) ++last;
    visit(run, first, last);
  }
}

}  // namespace

std::vector<VoxelRun> sharedVoxels(const std::vector<VoxelRun>& a, const std::vector<VoxelRun>& b) {
  std::vector<VoxelRun> shared;
  withMeeting(a, b, [&](const VoxelRun& run, auto first, auto last) {
    for (auto other = first; other != last; ++other) {
      shared.push_back({run.i, run.j, std::max(run.lo, other->lo), std::min(run.hi, other->hi)});
    }
  });
  return shared;
}

std::vector<VoxelRun> voxelsWithout(const std::vector<VoxelRun>& a, const std::vector<VoxelRun>& b) {
  std::vector<VoxelRun> left;
  withMeeting(a, b, [&](const VoxelRun& run, auto first, auto last) {
    std::int32_t lo = run.lo;
    for (auto other = first; other != last; ++other) {
      if (lo < other->lo) left.push_back({run.i, run.j, lo, other->lo - 1});
      lo = std::max(lo, other->hi + 1);
    }
    if (lo <= run.hi) left.push_back({run.i, run.j, lo, run.hi});
  });
  return left;
}

}  // namespace accessvdb::internal

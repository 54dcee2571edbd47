// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/voxel_runs.h"

#include <algorithm>
#include <array>
#include <cstdint>
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

void joinRuns(std::vector<VoxelRun>& runs) {
  std::sort(runs.begin(), runs.end(), [](const VoxelRun& a, const VoxelRun& b) {
    return std::tie(a.i, a.j, a.lo, a.hi) < std::tie(b.i, b.j, b.lo, b.hi);
  });
  std::size_t kept = 0;
  for (const VoxelRun& run : runs) {
    if (kept > 0 && runs[kept - 1].i == run.i && runs[kept - 1].j == run.j && run.lo <= runs[kept - 1].hi + 1) {
      runs[kept - 1].hi = std::max(runs[kept - 1].hi, run.hi);
    } else {
      runs[kept++] = run;
    }
  }
  runs.resize(kept);
}

std::vector<VoxelRun> enclosedBy(const std::vector<VoxelRun>& walls) {
  // The gaps between the walls of a column, and in front of them all that is reached from far away.
  struct Column {
    std::int32_t i, j;
    std::uint32_t begin, end;  ///< of gaps
    std::int32_t lo, hi;       ///< of the walls: what is beyond is reached
  };
  std::vector<Column> columns;
  std::vector<VoxelRun> gaps;
  for (std::size_t n = 0; n < walls.size(); ++n) {
    const VoxelRun& wall = walls[n];
    const auto gap = static_cast<std::uint32_t>(gaps.size());
    if (columns.empty() || columns.back().i != wall.i || columns.back().j != wall.j) {
      columns.push_back({wall.i, wall.j, gap, gap, wall.lo, wall.hi});
      continue;
    }
    gaps.push_back({wall.i, wall.j, walls[n - 1].hi + 1, wall.lo - 1});
    columns.back().end = gap + 1;
    columns.back().hi = wall.hi;
  }
  const auto columnAt = [&columns](std::int32_t i, std::int32_t j) -> const Column* {
    const auto found = std::lower_bound(columns.begin(), columns.end(), std::tie(i, j),
                                        [](const Column& c, const auto& at) { return std::tie(c.i, c.j) < at; });
    return found != columns.end() && found->i == i && found->j == j ? &*found : nullptr;
  };
  constexpr std::array<std::array<std::int32_t, 2>, 4> kBeside = {{{-1, 0}, {1, 0}, {0, -1}, {0, 1}}};
  std::vector<char> reached(gaps.size(), 0);
  std::vector<std::uint32_t> found;
  for (std::uint32_t n = 0; n < gaps.size(); ++n) {
    for (const auto& [di, dj] : kBeside) {
      const Column* const other = columnAt(gaps[n].i + di, gaps[n].j + dj);
      if (other != nullptr && gaps[n].lo >= other->lo && gaps[n].hi <= other->hi) continue;
      reached[n] = 1;
      found.push_back(n);
      break;
    }
  }
  while (!found.empty()) {
    const VoxelRun from = gaps[found.back()];
    found.pop_back();
    for (const auto& [di, dj] : kBeside) {
      const Column* const other = columnAt(from.i + di, from.j + dj);
      if (other == nullptr) continue;
      for (std::uint32_t n = other->begin; n < other->end && gaps[n].lo <= from.hi; ++n) {
        if (reached[n] != 0 || gaps[n].hi < from.lo) continue;
        reached[n] = 1;
        found.push_back(n);
      }
    }
  }
  std::vector<VoxelRun> enclosed;
  for (std::uint32_t n = 0; n < gaps.size(); ++n) {
    if (reached[n] == 0) enclosed.push_back(gaps[n]);
  }
  return enclosed;
}

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

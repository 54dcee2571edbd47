// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/voxelize.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <span>
#include <tuple>

namespace accessvdb::internal {
namespace {

using Triangle = std::array<std::uint32_t, 3>;

/// [voxels] Widens the cells, so that "touches" does not depend on how a cut was rounded: 100 times the rounding of a
/// coordinate of 30 000 in double, a thousandth of that of one in float32 metres.
constexpr double kTouch = 1e-9;

std::int32_t firstCell(double low) { return std::int32_t(std::ceil(low - 0.5 - kTouch)); }
std::int32_t lastCell(double high) { return std::int32_t(std::floor(high + 0.5 + kTouch)); }

/// A convex polygon: a triangle cut by at most four planes.
struct Polygon {                            // never copied: most corners are unset
  std::array<Eigen::Vector3d, 16> corners;  // four cuts make at most 13 of 3, even where rounding bent the outline
  int size = 0;

  void add(const Eigen::Vector3d& p) { corners[size++] = p; }
  [[nodiscard]] std::pair<double, double> range(int axis) const {
    double low = corners[0][axis], high = low;
    for (int n = 1; n < size; ++n) {
      low = std::min(low, corners[n][axis]);
      high = std::max(high, corners[n][axis]);
    }
    return {low, high};
  }
};

/// The part with sign * p[axis] <= bound.
void cut(const Polygon& in, int axis, double sign, double bound, Polygon& out) {
  out.size = 0;
  for (int n = 0; n < in.size; ++n) {
    const Eigen::Vector3d &a = in.corners[n], &b = in.corners[n + 1 == in.size ? 0 : n + 1];
    const double da = sign * a[axis] - bound, db = sign * b[axis] - bound;
    if (da <= 0) out.add(a);
    if ((da < 0 && db > 0) || (da > 0 && db < 0)) {
      Eigen::Vector3d p = a + da / (da - db) * (b - a);
      p[axis] = sign * bound;
      out.add(p);
    }
  }
}

void slab(const Polygon& in, int axis, std::int32_t cell, Polygon& out) {
  Polygon below;
  cut(in, axis, 1, cell + 0.5 + kTouch, below);
  cut(below, axis, -1, -(cell - 0.5 - kTouch), out);
}

/// The triangle is convex, so its part above one ground cell is too, and that part's z range gives all cells.
void addSurface(const Polygon& triangle, std::vector<VoxelRun>& runs) {
  Polygon cut_row, cut_part;
  const auto [x_low, x_high] = triangle.range(0);
  const std::int32_t i_first = firstCell(x_low), i_last = lastCell(x_high);
  for (std::int32_t i = i_first; i <= i_last; ++i) {
    if (i_first != i_last) slab(triangle, 0, i, cut_row);
    const Polygon& row = i_first == i_last ? triangle : cut_row;
    if (row.size == 0) continue;
    const auto [y_low, y_high] = row.range(1);
    const std::int32_t j_first = firstCell(y_low), j_last = lastCell(y_high);
    for (std::int32_t j = j_first; j <= j_last; ++j) {
      if (j_first != j_last) slab(row, 1, j, cut_part);
      const Polygon& part = j_first == j_last ? row : cut_part;
      if (part.size == 0) continue;
      const auto [z_low, z_high] = part.range(2);
      runs.push_back({i, j, firstCell(z_low), lastCell(z_high)});
    }
  }
}

/// Where the vertical line through a cell's centre crosses a triangle.
struct Crossing {
  std::int32_t i, j, sign;  ///< +1: into the inside, going up
  double z;
};

/// Both triangles of an edge compute its crossing with a row from the same two points in the same order, and each takes
/// the centres beyond it on its own side, so that every centre is counted exactly once.
void addCrossings(const Eigen::Vector3d& p0, const Eigen::Vector3d& p1, const Eigen::Vector3d& p2,
                  std::vector<Crossing>& crossings) {
  const Eigen::Vector3d* corner[3] = {&p0, &p1, &p2};
  const auto j_first = std::int32_t(std::ceil(std::min({p0.y(), p1.y(), p2.y()})));
  const auto j_last = std::int32_t(std::floor(std::max({p0.y(), p1.y(), p2.y()})));
  for (std::int32_t j = j_first; j <= j_last; ++j) {
    double x_up = 0, z_up = 0, x_down = 0, z_down = 0;
    bool any = false;
    for (int e = 0; e < 3; ++e) {
      const Eigen::Vector3d &from = *corner[e], &to = *corner[(e + 1) % 3];
      const bool from_above = from.y() > j, to_above = to.y() > j;
      if (from_above == to_above) continue;
      const Eigen::Vector3d &low = from_above ? to : from, &high = from_above ? from : to;
      const double t = (j - low.y()) / (high.y() - low.y());
      const double x = low.x() + t * (high.x() - low.x()), z = low.z() + t * (high.z() - low.z());
      (to_above ? x_up : x_down) = x;
      (to_above ? z_up : z_down) = z;
      any = true;
    }
    if (!any) continue;
    // The edge that runs towards +y is on the right of a triangle that is anticlockwise seen from above (faces up:
    // out).
    const std::int32_t sign = x_down < x_up ? -1 : 1;
    const double x_low = std::min(x_up, x_down), x_high = std::max(x_up, x_down);
    for (auto i = std::int32_t(std::floor(x_low)) + 1; i <= x_high; ++i) {
      crossings.push_back({i, j, sign, z_down + (i - x_down) / (x_up - x_down) * (z_up - z_down)});
    }
  }
}

void addInside(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& triangles,
               std::vector<VoxelRun>& runs) {
  std::vector<Crossing> crossings;
  for (const Triangle& t : triangles) addCrossings(vertices[t[0]], vertices[t[1]], vertices[t[2]], crossings);
  std::sort(crossings.begin(), crossings.end(), [](const Crossing& a, const Crossing& b) {
    return std::tie(a.i, a.j, a.z, a.sign) < std::tie(b.i, b.j, b.z, b.sign);
  });
  std::int32_t winding = 0;
  for (std::size_t n = 0; n + 1 < crossings.size(); ++n) {
    const Crossing &here = crossings[n], &next = crossings[n + 1];
    winding += here.sign;
    if (here.i != next.i || here.j != next.j) {
      winding = 0;
      continue;
    }
    const auto lo = std::int32_t(std::ceil(here.z)), hi = std::int32_t(std::floor(next.z));
    if (winding != 0 && lo <= hi) runs.push_back({here.i, here.j, lo, hi});
  }
}

/// Sorted, those that touch or overlap joined.
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

}  // namespace

std::vector<VoxelRun> voxelize(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& triangles,
                               bool solid) {
  std::vector<VoxelRun> runs;
  for (const Triangle& t : triangles) {
    Polygon triangle;
    for (std::uint32_t v : t) triangle.add(vertices[v]);
    addSurface(triangle, runs);
  }
  if (solid) addInside(vertices, triangles, runs);
  joinRuns(runs);
  return runs;
}

std::vector<VoxelRun> voxelsInside(const std::vector<Eigen::Vector3d>& vertices,
                                   const std::vector<Triangle>& triangles) {
  std::vector<VoxelRun> runs;
  addInside(vertices, triangles, runs);
  joinRuns(runs);
  return runs;
}

std::uint64_t removeBall(std::vector<VoxelRun>& runs, double radius) {
  if (!(radius >= 0)) return 0;
  const std::uint64_t before = countVoxels(runs);
  std::vector<VoxelRun> left;
  left.reserve(runs.size() + 8);
  for (const VoxelRun& run : runs) {
    const double rest = radius * radius - double(run.i) * run.i - double(run.j) * run.j;
    if (!(rest >= 0)) {
      left.push_back(run);
      continue;
    }
    std::int32_t k = 0;  // largest |k| inside; found in integers, so that a square root's rounding does not matter
    while (double(k + 1) * (k + 1) <= rest) ++k;
    if (run.lo < -k) left.push_back({run.i, run.j, run.lo, std::min(run.hi, -k - 1)});
    if (run.hi > k) left.push_back({run.i, run.j, std::max(run.lo, k + 1), run.hi});
  }
  runs.swap(left);
  return before - countVoxels(runs);
}

std::uint64_t countVoxels(const std::vector<VoxelRun>& runs) {
  std::uint64_t count = 0;
  for (const VoxelRun& run : runs) count += std::uint64_t(run.hi - run.lo + 1);
  return count;
}

std::vector<kernels::VoxelColumn> packColumns(const std::vector<VoxelRun>& runs) {
  std::vector<kernels::VoxelColumn> columns;
  for (const VoxelRun& run : runs) {
    std::int32_t lo = run.lo;
    const auto dx = std::int16_t(run.i), dy = std::int16_t(run.j);
    while (lo <= run.hi) {
      if (columns.empty() || columns.back().dx != dx || columns.back().dy != dy || lo >= columns.back().dz + 64) {
        columns.push_back({dx, dy, std::int16_t(lo), 0, 0});
      }
      kernels::VoxelColumn& column = columns.back();
      const std::int32_t shift = lo - column.dz, length = std::min(run.hi - lo + 1, 64 - shift);
      column.bits |= (~std::uint64_t(0) >> (64 - length)) << shift;
      lo += length;
    }
  }
  return columns;
}

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/voxelize.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <optional>
#include <tuple>
#include <type_traits>
#include <utility>

#include "tool/voxel_bitmap.h"
#include "tool/voxel_runs.h"

namespace accessvdb::internal {
namespace {

using Triangle = std::array<std::uint32_t, 3>;

/// [voxels] Widens the cells, so that "touches" does not depend on how a cut was rounded: 100 times the rounding of a
/// coordinate of 30 000 in double, a thousandth of that of one in float32 metres.
constexpr double kTouch = 1e-9;

/// Rounds as std::floor and std::ceil do, without a call where the processor may have no instruction for it.
std::int32_t floorOf(double x) {
  const auto n = std::int32_t(x);
  return n - (x < n);
}
std::int32_t ceilOf(double x) {
  const auto n = std::int32_t(x);
  return n + (x > n);
}

/// @param touch  widens the cells  [voxels]
std::int32_t firstCell(double low, double touch = kTouch) { return ceilOf(low - 0.5 - touch); }
std::int32_t lastCell(double high, double touch = kTouch) { return floorOf(high + 0.5 + touch); }

/// The whole number nearest to x, of two either: where a bound on floor or ceil will do, this is faster than they are.
std::int32_t nearest(double x) {
  constexpr double kNoFraction = 6755399441055744;  // 1.5 x 2^52: the sum has whole numbers only
  return static_cast<std::int32_t>(std::bit_cast<std::int64_t>(x + kNoFraction));
}

struct Range {
  double low, high;
};

/// A convex polygon: a triangle cut by at most four planes.
struct Polygon {                            // never copied: most corners are unset
  std::array<Eigen::Vector3d, 16> corners;  // four cuts make at most 13 of 3, even where rounding bent the outline
  int size = 0;

  void add(const Eigen::Vector3d& p) { corners[size++] = p; }
  [[nodiscard]] Range range(int axis) const {
    double low = corners[0][axis], high = low;
    for (int n = 1; n < size; ++n) {
      low = std::min(low, corners[n][axis]);
      high = std::max(high, corners[n][axis]);
    }
    return {low, high};
  }
};

/// The part with sign * p[axis] <= bound: `in` itself, or made in `out`. Coordinates before the axis are left unset:
/// they were cut already.
template <int axis, int sign>
const Polygon& cut(const Polygon& in, double bound, Polygon& out) {
  double beyond[16];
  bool any = false;
  for (int n = 0; n < in.size; ++n) {
    beyond[n] = sign * in.corners[n][axis] - bound;
    any = any || beyond[n] > 0;
  }
  if (!any) return in;
  out.size = 0;
  for (int n = 0; n < in.size; ++n) {
    const int next = n + 1 == in.size ? 0 : n + 1;
    const Eigen::Vector3d &a = in.corners[n], &b = in.corners[next];
    const double da = beyond[n], db = beyond[next];
    if (da <= 0) out.add(a);
    if ((da < 0 && db > 0) || (da > 0 && db < 0)) {
      const double t = da / (da - db);
      Eigen::Vector3d& p = out.corners[out.size++];
      p[axis] = sign * bound;
      for (int other = axis + 1; other < 3; ++other) p[other] = a[other] + t * (b[other] - a[other]);
    }
  }
  return out;
}

/// Cuts out a layer of cells. @param space  for the result, and for what is between
template <int axis>
const Polygon& slab(const Polygon& in, std::int32_t cell, double touch, std::array<Polygon, 2>& space) {
  const Polygon& below = cut<axis, 1>(in, cell + 0.5 + touch, space[0]);
  return cut<axis, -1>(below, -(cell - 0.5 - touch), space[1]);
}

/// The triangle is convex, so its part above one ground cell is too, and that part's z range gives all cells.
template <typename Voxels>
void addSurface(const Polygon& triangle, Voxels& voxels, double touch = kTouch) {
  std::array<Polygon, 2> row_space, part_space;
  const Range x = triangle.range(0);
  const std::int32_t i_first = firstCell(x.low, touch), i_last = lastCell(x.high, touch);
  for (std::int32_t i = i_first; i <= i_last; ++i) {
    const Polygon& row = i_first == i_last ? triangle : slab<0>(triangle, i, touch, row_space);
    if (row.size == 0) continue;
    const Range y = row.range(1);
    const std::int32_t j_first = firstCell(y.low, touch), j_last = lastCell(y.high, touch);
    for (std::int32_t j = j_first; j <= j_last; ++j) {
      const Polygon& part = j_first == j_last ? row : slab<1>(row, j, touch, part_space);
      if (part.size == 0) continue;
      const Range z = part.range(2);
      voxels.add({i, j, firstCell(z.low, touch), lastCell(z.high, touch)});
    }
  }
}

/// [voxels] More than rounding can move a cut of a triangle: cuts are on segments between corners.
constexpr double kMargin = kTouch + 1e-8;

/// Fine meshes have many triangles per voxel, and most of them touch only voxels that others have touched already. That
/// is quickly seen from above: by the triangle's box and plane, both wider than any rounding.
class Cover {
 public:
  Cover(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c) : a_(a), b_(b), c_(c) {
    for (int axis = 0; axis < 3; ++axis) {
      low_[axis] = nearest(std::min({a[axis], b[axis], c[axis]}) - kMargin);
      high_[axis] = nearest(std::max({a[axis], b[axis], c[axis]}) + kMargin);
    }
  }

  [[nodiscard]] bool isOneColumn() const { return low_[0] == high_[0] && low_[1] == high_[1]; }
  /// The cells of such a triangle.
  [[nodiscard]] VoxelRun column() const {
    return {low_[0], low_[1], firstCell(std::min({a_.z(), b_.z(), c_.z()})),
            lastCell(std::max({a_.z(), b_.z(), c_.z()}))};
  }

  /// Whether the voxels have all cells that addSurface() would add. Never wrongly true; only for small triangles, whose
  /// plane is known well, worth it.
  [[nodiscard]] bool isIn(const VoxelBitmap& voxels) const {
    if (high_[0] - low_[0] > kMostSide || high_[1] - low_[1] > kMostSide || high_[2] - low_[2] > kMostSide)
      return false;
    const Eigen::Vector3d u = b_ - a_, v = c_ - a_;
    const double nx = u.y() * v.z() - u.z() * v.y(), ny = u.z() * v.x() - u.x() * v.z(),
                 nz = u.x() * v.y() - u.y() * v.x();
    // A cell whose centre is farther from the plane is not touched. The margins are for kTouch, and for the rounding
    // of differences of coordinates of 30 000 and edges of a few voxels (below 3e-9).
    const double far = (0.5 + 1e-7) * (std::abs(nx) + std::abs(ny) + std::abs(nz)) + 1e-8;
    const std::uint64_t all = ~std::uint64_t{0} >> (63 - (high_[2] - low_[2]));
    for (std::int32_t i = low_[0]; i <= high_[0]; ++i) {
      for (std::int32_t j = low_[1]; j <= high_[1]; ++j) {
        const double at_bottom = nx * (i - a_.x()) + ny * (j - a_.y()) + nz * (low_[2] - a_.z());
        for (std::uint64_t missing = ~voxels.from(i, j, low_[2]) & all; missing != 0; missing &= missing - 1) {
          if (std::abs(at_bottom + nz * std::countr_zero(missing)) <= far) return false;
        }
      }
    }
    return true;
  }

 private:
  static constexpr std::int32_t kMostSide = 2;  ///< from the first cell to the last

  const Eigen::Vector3d &a_, &b_, &c_;
  std::array<std::int32_t, 3> low_, high_;
};

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

/// Whether addCrossings() may find any. Never wrongly false.
bool mayCross(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  const std::int32_t j_first = nearest(std::min({a.y(), b.y(), c.y()}) - kMargin + 0.5),
                     j_last = nearest(std::max({a.y(), b.y(), c.y()}) + kMargin - 0.5);
  if (j_last < j_first) return false;
  const std::int32_t i_first = nearest(std::min({a.x(), b.x(), c.x()}) - kMargin + 0.5),
                     i_last = nearest(std::max({a.x(), b.x(), c.x()}) + kMargin - 0.5);
  if (i_last < i_first) return false;
  if (j_last > j_first || i_last > i_first) return true;
  // One centre, and edges shorter than 3. It is on one side of all edges, but for rounding, or outside.
  const double ax = a.x() - i_first, ay = a.y() - j_first, bx = b.x() - i_first, by = b.y() - j_first,
               cx = c.x() - i_first, cy = c.y() - j_first;
  const double ab = ax * by - ay * bx, bc = bx * cy - by * cx, ca = cx * ay - cy * ax;
  return std::max({ab, bc, ca}) <= 10 * kMargin || std::min({ab, bc, ca}) >= -10 * kMargin;
}

template <typename Voxels>
void addInside(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& triangles, Voxels& voxels) {
  std::vector<Crossing> crossings;
  for (const Triangle& t : triangles) {
    const Eigen::Vector3d &a = vertices[t[0]], &b = vertices[t[1]], &c = vertices[t[2]];
    if (mayCross(a, b, c)) addCrossings(a, b, c, crossings);
  }
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
    if (winding != 0 && lo <= hi) voxels.add({here.i, here.j, lo, hi});
  }
}

/// Voxels as they come.
struct RunList {
  std::vector<VoxelRun> runs;
  void add(const VoxelRun& run) { runs.push_back(run); }
};

/// All cells that vertices can touch, and one more on each side for rounding. Nothing if there are too many.
std::optional<VoxelBitmap::Box> smallBoxOf(const std::vector<Eigen::Vector3d>& vertices) {
  VoxelBitmap::Box box;
  if (vertices.empty()) return std::nullopt;
  for (int axis = 0; axis < 3; ++axis) {
    double low = vertices.front()[axis], high = low;
    for (const Eigen::Vector3d& p : vertices) {
      low = std::min(low, p[axis]);
      high = std::max(high, p[axis]);
    }
    if (!(high - low <= VoxelBitmap::kMostBits)) return std::nullopt;
    box.low[std::size_t(axis)] = firstCell(low) - 1;
    box.high[std::size_t(axis)] = lastCell(high) + 1;
  }
  if (!(box.bits() <= VoxelBitmap::kMostBits)) return std::nullopt;
  return box;
}

template <typename Voxels>
void addAll(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& triangles, bool solid,
            Voxels& voxels) {
  if (solid) addInside(vertices, triangles, voxels);
  for (const Triangle& t : triangles) {
    const Cover cover(vertices[t[0]], vertices[t[1]], vertices[t[2]]);
    if (cover.isOneColumn()) {
      voxels.add(cover.column());
      continue;
    }
    if constexpr (std::is_same_v<Voxels, VoxelBitmap>) {
      if (cover.isIn(voxels)) continue;
    }
    Polygon triangle;
    for (std::uint32_t v : t) triangle.add(vertices[v]);
    addSurface(triangle, voxels);
  }
}

}  // namespace

std::vector<VoxelRun> voxelize(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& triangles,
                               bool solid) {
  if (const std::optional<VoxelBitmap::Box> box = smallBoxOf(vertices)) {
    VoxelBitmap voxels(*box);
    addAll(vertices, triangles, solid, voxels);
    return voxels.runs();
  }
  RunList voxels;
  addAll(vertices, triangles, solid, voxels);
  joinRuns(voxels.runs);
  return std::move(voxels.runs);
}

std::vector<VoxelRun> touchedVoxels(const std::vector<Eigen::Vector3d>& vertices,
                                    const std::vector<Triangle>& triangles, double margin) {
  if (margin == 0) return voxelize(vertices, triangles, false);
  RunList voxels;
  for (const Triangle& t : triangles) {
    Polygon triangle;
    for (std::uint32_t v : t) triangle.add(vertices[v]);
    addSurface(triangle, voxels, kTouch + margin);
  }
  joinRuns(voxels.runs);
  return std::move(voxels.runs);
}

std::vector<VoxelRun> voxelsInside(const std::vector<Eigen::Vector3d>& vertices,
                                   const std::vector<Triangle>& triangles) {
  RunList voxels;
  addInside(vertices, triangles, voxels);
  joinRuns(voxels.runs);
  return std::move(voxels.runs);
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

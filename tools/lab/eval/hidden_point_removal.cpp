// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "eval/hidden_point_removal.h"

#include <libqhull_r/qhull_ra.h>
#include <tbb/parallel_for.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <memory>
#include <numeric>
#include <string>

#include "accessvdb/error.h"

namespace accessvdb::eval {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

/// Below this share of the extent, a set counts as flat. Qhull gives up at about 1e-15 times the dimension and extent;
/// if it does so although the set is not flatter than this, that is a failure and not a flat set.
constexpr double kFlatShare = 1e-9;

/// Frees Qhull's memory in any case.
class Qhull {
 public:
  Qhull() : sink_(std::fopen("/dev/null", "w")) {
    if (sink_ == nullptr) throw InternalError("hpr.sink", "/dev/null", "cannot be opened");
    qh_zero(&qh_, sink_.get());
  }
  ~Qhull() {
    qh_freeqhull(&qh_, qh_ALL);
    int current_long = 0, total_long = 0;
    qh_memfreeshort(&qh_, &current_long, &total_long);
  }
  Qhull(const Qhull&) = delete;
  Qhull& operator=(const Qhull&) = delete;

  /// Marks the corners of the hull. @return Qhull's exit code, 0 = done
  int markCorners(std::vector<Vector3d>& points, std::vector<std::uint8_t>& corner) {
    char command[] = "qhull";
    static_assert(sizeof(Vector3d) == 3 * sizeof(coordT));
    const int code = qh_new_qhull(&qh_, 3, static_cast<int>(points.size()), points.front().data(), False, command,
                                  nullptr, sink_.get());
    if (code != 0) return code;
    for (const vertexT* vertex = qh_.vertex_list; vertex != nullptr && vertex->next != nullptr; vertex = vertex->next) {
      const int id = qh_pointid(&qh_, vertex->point);
      if (id >= 0) corner[static_cast<std::size_t>(id)] = 1;
    }
    return 0;
  }

 private:
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::unique_ptr<std::FILE, Close> sink_;  // what Qhull would write to the terminal
  qhT qh_ = {};
};

double cross(const Vector2d& a, const Vector2d& b, const Vector2d& c) {
  return (b.x() - a.x()) * (c.y() - a.y()) - (b.y() - a.y()) * (c.x() - a.x());
}

/// Corners of a planar hull (monotone chain); for points on a line, the two ends.
void markPlanarCorners(const std::vector<Vector2d>& points, std::vector<std::uint8_t>& corner) {
  std::vector<std::uint32_t> order(points.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    if (points[a].x() != points[b].x()) return points[a].x() < points[b].x();
    return points[a].y() < points[b].y();
  });
  for (int side = 0; side < 2; ++side) {
    std::vector<std::uint32_t> chain;
    for (const std::uint32_t n : order) {
      while (chain.size() >= 2) {
        const Vector2d &a = points[chain[chain.size() - 2]], &b = points[chain.back()], &c = points[n];
        // Rounding must not keep a point that is on the line between its neighbours.
        if (cross(a, b, c) > kFlatShare * (b - a).norm() * (c - a).norm()) break;
        chain.pop_back();
      }
      chain.push_back(n);
    }
    for (const std::uint32_t n : chain) corner[n] = 1;
    std::reverse(order.begin(), order.end());
  }
}

/// Axes of the set in columns, flattest first, and the extents along them.
struct Extents {
  Eigen::Matrix3d axes;
  Vector3d size;
};
Extents extentsOf(const std::vector<Vector3d>& points) {
  Vector3d mean = Vector3d::Zero();
  for (const Vector3d& p : points) mean += p;
  mean /= static_cast<double>(points.size());
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (const Vector3d& p : points) spread += (p - mean) * (p - mean).transpose();
  Extents extents;
  extents.axes = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(spread).eigenvectors();
  Vector3d low = extents.axes.transpose() * points.front(), high = low;
  for (const Vector3d& p : points) {
    const Vector3d along = extents.axes.transpose() * p;
    low = low.cwiseMin(along);
    high = high.cwiseMax(along);
  }
  extents.size = high - low;
  return extents;
}

/// Corners of the hull of any set of points, however flat.
std::vector<std::uint8_t> hullCorners(std::vector<Vector3d>& points) {
  std::vector<std::uint8_t> corner(points.size(), 0);
  if (points.size() >= 4) {
    Qhull qhull;
    const int code = qhull.markCorners(points, corner);
    if (code == 0) return corner;
    std::fill(corner.begin(), corner.end(), std::uint8_t{0});
    const Extents extents = extentsOf(points);
    if (extents.size[0] > kFlatShare * extents.size[2]) {
      throw InternalError("hpr.hull", "", "Qhull failed with code " + std::to_string(code));
    }
  }
  const Eigen::Matrix3d axes = extentsOf(points).axes;
  std::vector<Vector2d> flat;
  flat.reserve(points.size());
  for (const Vector3d& p : points) flat.emplace_back(axes.col(2).dot(p), axes.col(1).dot(p));
  markPlanarCorners(flat, corner);
  return corner;
}

/// Distinct points, and for each input point the index of its distinct one.
struct DistinctPoints {
  std::vector<Vector3d> points_W;
  std::vector<std::uint32_t> of;
};
DistinctPoints distinctOf(std::span<const Vector3d> points_W) {
  for (const Vector3d& p : points_W) {
    if (!p.allFinite()) throw InvalidArgument("hpr.not_finite", "points_W", "holds a coordinate that is not finite");
  }
  std::vector<std::uint32_t> order(points_W.size());
  std::iota(order.begin(), order.end(), 0u);
  const auto less = [&](std::uint32_t a, std::uint32_t b) {
    return std::lexicographical_compare(points_W[a].data(), points_W[a].data() + 3, points_W[b].data(),
                                        points_W[b].data() + 3);
  };
  std::sort(order.begin(), order.end(), less);
  DistinctPoints distinct;
  distinct.of.resize(points_W.size());
  for (std::size_t n = 0; n < order.size(); ++n) {
    if (n == 0 || points_W[order[n]] != points_W[order[n - 1]]) distinct.points_W.push_back(points_W[order[n]]);
    distinct.of[order[n]] = static_cast<std::uint32_t>(distinct.points_W.size() - 1);
  }
  return distinct;
}

/// Calls see(n) for every visible point of a set without duplicates.
template <typename See>
void findVisible(const std::vector<Vector3d>& points_W, const Vector3d& viewpoint_W, double flip_radius,
                 const See& see) {
  if (!viewpoint_W.allFinite()) {
    throw InvalidArgument("hpr.not_finite", "viewpoints_W", "holds a coordinate that is not finite");
  }
  double farthest = 0;
  for (const Vector3d& p : points_W) farthest = std::max(farthest, (p - viewpoint_W).norm());
  const double radius = flip_radius * farthest;
  std::vector<Vector3d> flipped;
  std::vector<std::uint32_t> ids;
  flipped.reserve(points_W.size() + 1);
  for (std::uint32_t n = 0; n < points_W.size(); ++n) {
    const Vector3d ray = points_W[n] - viewpoint_W;
    const double range = ray.norm();
    if (!(range > 0)) {
      see(n);
      continue;
    }
    flipped.push_back(ray + ray * (2 * (radius - range) / range));
    ids.push_back(n);
  }
  if (flipped.empty()) return;
  flipped.push_back(Vector3d::Zero());  // the viewer
  const std::vector<std::uint8_t> corner = hullCorners(flipped);
  for (std::size_t n = 0; n < ids.size(); ++n) {
    if (corner[n] != 0) see(ids[n]);
  }
}

}  // namespace

std::vector<std::uint8_t> visibleFrom(std::span<const Vector3d> points_W, const Vector3d& viewpoint_W,
                                      double flip_radius) {
  return visibleFromAny(points_W, {&viewpoint_W, 1}, flip_radius);
}

std::vector<std::uint8_t> visibleFromAny(std::span<const Vector3d> points_W, std::span<const Vector3d> viewpoints_W,
                                         double flip_radius) {
  if (!(flip_radius >= 1)) throw InvalidArgument("hpr.radius", "flip_radius", "is below the farthest point's distance");
  const DistinctPoints distinct = distinctOf(points_W);
  std::vector<std::uint8_t> seen(distinct.points_W.size(), 0);
  tbb::parallel_for(std::size_t{0}, viewpoints_W.size(), [&](std::size_t v) {
    findVisible(distinct.points_W, viewpoints_W[v], flip_radius,
                [&](std::uint32_t n) { std::atomic_ref<std::uint8_t>(seen[n]).store(1, std::memory_order_relaxed); });
  });
  std::vector<std::uint8_t> visible(points_W.size());
  for (std::size_t n = 0; n < visible.size(); ++n) visible[n] = seen[distinct.of[n]];
  return visible;
}

}  // namespace accessvdb::eval

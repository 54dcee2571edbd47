// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/mesh_openings.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <tuple>

namespace accessvdb::internal {
namespace {

using Triangle = std::array<std::uint32_t, 3>;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
/// What is missing need not be flat: a part that bends lies farther from the rim than the ball that fits between.
constexpr double kBend = 1.5;
/// A corner may be missing, too: so far it may stand out from where its neighbours are, as a share of half the width.
constexpr double kBulge = 0.5;
/// Torn copies of a vertex may all have moved away from where it was.
constexpr double kTorn = 1.5;
/// Pairs of places and edges that are compared, at most: about a second. Beyond it, the width counts as not known.
constexpr double kMostPairs = 1e7;

/// Sets of indices that belong together.
class Groups {
 public:
  explicit Groups(std::size_t size) : parent_(size) { std::iota(parent_.begin(), parent_.end(), 0u); }
  std::uint32_t of(std::uint32_t n) {
    while (parent_[n] != n) n = parent_[n] = parent_[parent_[n]];
    return n;
  }
  void join(std::uint32_t a, std::uint32_t b) { parent_[of(a)] = of(b); }

 private:
  std::vector<std::uint32_t> parent_;
};

struct Rim {
  std::uint32_t low, high, triangle;
  Eigen::Vector3d a, b;
  Eigen::Vector3d beyond;  ///< unit, in the triangle's plane, away from it
};

/// Edges used by an odd number of triangles. @param group  vertices that count as one
std::vector<Rim> rimsOf(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& triangles,
                        Groups& group) {
  struct Edge {
    std::uint32_t low, high, triangle;
  };
  std::vector<Edge> edges;
  edges.reserve(3 * triangles.size());
  for (std::uint32_t n = 0; n < triangles.size(); ++n) {
    for (std::size_t e = 0; e < 3; ++e) {
      const std::uint32_t from = group.of(triangles[n][e]), to = group.of(triangles[n][(e + 1) % 3]);
      if (from != to) edges.push_back({std::min(from, to), std::max(from, to), n});
    }
  }
  std::sort(edges.begin(), edges.end(), [](const Edge& a, const Edge& b) {
    return std::tie(a.low, a.high, a.triangle) < std::tie(b.low, b.high, b.triangle);
  });
  std::vector<Rim> rims;
  for (std::size_t begin = 0, end; begin < edges.size(); begin = end) {
    for (end = begin; end < edges.size() && edges[end].low == edges[begin].low && edges[end].high == edges[begin].high;)
      ++end;
    if ((end - begin) % 2 == 0) continue;
    const Edge& edge = edges[begin];
    Rim rim = {edge.low,
               edge.high,
               edge.triangle,
               vertices[edge.low].cast<double>(),
               vertices[edge.high].cast<double>(),
               Eigen::Vector3d::Zero()};
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    for (const std::uint32_t v : triangles[edge.triangle]) centre += vertices[v].cast<double>() / 3;
    const Eigen::Vector3d along = (rim.b - rim.a).normalized(), out = rim.a - centre;
    rim.beyond = (out - out.dot(along) * along).normalized();
    rims.push_back(rim);
  }
  return rims;
}

/// Vertices apart by less than this share of their reach were one, whatever else is near: at a corner many meet.
constexpr double kSurelyOne = 0.05;

/// Joins vertices on rims that are nearer to each other than half of each one's shortest edge.
/// @return how far they are apart, at most
double joinTorn(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& triangles,
                const std::vector<Rim>& rims, double most_m, Groups& group) {
  std::vector<double> reach_m(vertices.size(), 0);
  for (const Rim& rim : rims) reach_m[rim.low] = reach_m[rim.high] = most_m;
  for (const Triangle& t : triangles) {
    for (std::size_t e = 0; e < 3; ++e) {
      const std::uint32_t a = t[e], b = t[(e + 1) % 3];
      const double half_m = 0.5 * (vertices[a] - vertices[b]).cast<double>().norm();
      reach_m[a] = std::min(reach_m[a], half_m);
      reach_m[b] = std::min(reach_m[b], half_m);
    }
  }
  std::vector<std::uint32_t> order;
  for (std::uint32_t v = 0; v < vertices.size(); ++v) {
    if (reach_m[v] > 0) order.push_back(v);
  }
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return std::make_tuple(vertices[a].x(), a) < std::make_tuple(vertices[b].x(), b);
  });
  struct Pair {
    std::uint32_t a, b;
    double apart_m;
  };
  std::vector<Pair> pairs;
  std::vector<double> nearest_m(vertices.size(), kInfinity);
  for (std::size_t n = 0; n < order.size(); ++n) {
    const std::uint32_t a = order[n];
    for (std::size_t m = n + 1; m < order.size(); ++m) {
      const std::uint32_t b = order[m];
      if (double(vertices[b].x()) - vertices[a].x() >= reach_m[a]) break;
      const double apart_m = (vertices[a] - vertices[b]).cast<double>().norm();
      if (apart_m >= std::min(reach_m[a], reach_m[b])) continue;
      pairs.push_back({a, b, apart_m});
      nearest_m[a] = std::min(nearest_m[a], apart_m);
      nearest_m[b] = std::min(nearest_m[b], apart_m);
    }
  }
  // The far corners of two needles may be within reach of each other, but they have nearer ones.
  for (const Pair& pair : pairs) {
    const bool is_near = pair.apart_m <= kSurelyOne * std::min(reach_m[pair.a], reach_m[pair.b]);
    if (is_near || pair.apart_m <= 2 * std::max(nearest_m[pair.a], nearest_m[pair.b])) group.join(pair.a, pair.b);
  }
  std::vector<Eigen::AlignedBox3d> boxes(vertices.size());
  double tear_m = 0;
  for (const std::uint32_t v : order) {
    Eigen::AlignedBox3d& box = boxes[group.of(v)];
    box.extend(vertices[v].cast<double>());
    tear_m = std::max(tear_m, box.diagonal().norm());
  }
  return kTorn * tear_m;
}

/// A ball that touches a rim at a place, from beyond it, and another rim. @return its radius and where
std::pair<double, Eigen::Vector3d> ballTo(const Eigen::Vector3d& place, const Eigen::Vector3d& beyond, const Rim& rim) {
  const auto radius = [&](double t) {
    const Eigen::Vector3d to = rim.a + t * (rim.b - rim.a) - place;
    const double ahead = to.dot(beyond);
    return ahead > 1e-3 * to.norm() ? to.squaredNorm() / (2 * ahead) : kInfinity;
  };
  // Balls are convex, so along an edge the radius has one minimum, between the first and last place that is ahead.
  double low = 0, high = 1;
  const double a = (rim.a - place).dot(beyond), b = (rim.b - place).dot(beyond);
  if (a <= 0 && b <= 0) return {kInfinity, rim.a};
  if (a < 0) low = a / (a - b);
  if (b < 0) high = a / (a - b);
  double best = std::min(radius(low), radius(high)), at = radius(low) < radius(high) ? low : high;
  for (int step = 0; step < 24; ++step) {
    const double one = low + (high - low) / 3, two = high - (high - low) / 3, r1 = radius(one), r2 = radius(two);
    if (r1 < best) best = r1, at = one;
    if (r2 < best) best = r2, at = two;
    (r1 < r2 || (r1 == r2 && a < b) ? high : low) = r1 < r2 || (r1 == r2 && a < b) ? two : one;
  }
  return {best, rim.a + at * (rim.b - rim.a)};
}

double leastDistance(const Eigen::Vector3d& place, const Rim& rim) {
  return (0.5 * (rim.a + rim.b) - place).norm() - 0.5 * (rim.b - rim.a).norm();
}

struct HalfWidth {
  double m;
  bool between_loops;
};

/// Half the widest opening that a loop of rims bounds. An opening may have two rims: a seam all around a tool. Then
/// each place of one has the other in front of it, and that is as wide as it is.
HalfWidth halfWidth(const std::vector<Rim>& rims, const std::vector<std::uint32_t>& loop,
                    const std::vector<std::uint32_t>& of) {
  const std::size_t places = std::size_t(std::clamp(128.0 / double(loop.size()), 1.0, 15.0)) | 1;  // with the middle
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  double length = 0;
  for (const std::uint32_t n : loop) {
    const double edge = (rims[n].b - rims[n].a).norm();
    centre += 0.5 * edge * (rims[n].a + rims[n].b);
    length += edge;
  }
  centre /= length;
  double within = 0, across = 0;
  for (const std::uint32_t n : loop) {
    const Eigen::Vector3d along = (rims[n].b - rims[n].a).normalized();
    for (std::size_t p = 0; p < places; ++p) {
      const Eigen::Vector3d place = rims[n].a + (double(p) + 0.5) / double(places) * (rims[n].b - rims[n].a);
      // What is missing need not go on as the triangle before it: at the edge of a box it goes round the corner.
      const Eigen::Vector3d to_centre = centre - place,
                            inwards = (to_centre - to_centre.dot(along) * along).normalized();
      double own = kInfinity, facing = kInfinity;
      for (std::uint32_t m = 0; m < rims.size(); ++m) {
        const bool same = of[m] == of[n];
        if (m == n || leastDistance(place, rims[m]) / 2 >= (same ? std::max(own, facing) : facing)) continue;
        const auto [radius, where] = ballTo(place, rims[n].beyond, rims[m]);
        if (same) own = std::min({own, radius, ballTo(place, inwards, rims[m]).first});
        const Eigen::Vector3d to = (where - place).normalized();
        if (to.dot(rims[n].beyond) > 0.5 && to.dot(rims[m].beyond) < -0.5) facing = std::min(facing, radius);
      }
      within = std::max(within, own);
      across = std::max(across, facing);
    }
  }
  return {std::min(within, across), across < within};
}

}  // namespace

MeshOpenings findOpenings(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& triangles) {
  MeshOpenings openings;
  Groups vertex(vertices.size());
  std::vector<Rim> rims = rimsOf(vertices, triangles, vertex);
  if (rims.empty()) return openings;
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3f& p : vertices) box.extend(p.cast<double>());
  const double widest_m = kWidestOpening * box.sizes().maxCoeff();
  openings.tear_m = joinTorn(vertices, triangles, rims, widest_m / 2, vertex);
  openings.width_m = openings.tear_m;
  if (openings.tear_m > 0) rims = rimsOf(vertices, triangles, vertex);

  Groups loops(vertices.size());
  for (const Rim& rim : rims) loops.join(rim.low, rim.high);
  std::vector<std::uint32_t> of(rims.size()), order(rims.size());
  for (std::uint32_t n = 0; n < rims.size(); ++n) of[n] = loops.of(rims[n].low), order[n] = n;
  std::stable_sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) { return of[a] < of[b]; });
  const bool too_many = double(rims.size()) * double(rims.size()) > kMostPairs;
  for (std::size_t begin = 0, end; begin < order.size(); begin = end) {
    for (end = begin; end < order.size() && of[order[end]] == of[order[begin]];) ++end;
    const std::vector<std::uint32_t> loop(order.begin() + std::ptrdiff_t(begin), order.begin() + std::ptrdiff_t(end));
    const HalfWidth half = too_many ? HalfWidth{kInfinity, false} : halfWidth(rims, loop, of);
    openings.width_m = std::max(openings.width_m, 2 * half.m);
    Opening opening;
    for (const std::uint32_t n : loop) opening.rims.push_back({rims[n].low, rims[n].high});
    if (2 * half.m <= widest_m) {
      opening.radius_m = kBend * half.m + openings.tear_m;
      opening.bulge_m = (half.between_loops ? kBend : kBulge) * half.m + openings.tear_m;
    }
    openings.openings.push_back(std::move(opening));
  }
  return openings;
}

}  // namespace accessvdb::internal

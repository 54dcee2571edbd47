// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/mesh_repair.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <limits>
#include <set>
#include <tuple>
#include <unordered_map>
#include <utility>

namespace accessvdb::internal {
namespace {

using Triangle = std::array<std::uint32_t, 3>;
constexpr std::uint32_t kUnset = std::numeric_limits<std::uint32_t>::max();

struct CellHash {
  std::size_t operator()(const std::array<std::int64_t, 3>& c) const {
    std::uint64_t h = 0x9e3779b97f4a7c15u;
    for (std::int64_t x : c) h = std::rotl((h ^ std::uint64_t(x)) * 0xbf58476d1ce4e5b9u, 29);
    return std::size_t(h);
  }
};

/// For each vertex, the first vertex at the same position.
std::vector<std::uint32_t> weldExact(const std::vector<Eigen::Vector3f>& vertices) {
  std::unordered_map<std::array<std::int64_t, 3>, std::uint32_t, CellHash> first;
  first.reserve(vertices.size());
  std::vector<std::uint32_t> target(vertices.size());
  for (std::uint32_t n = 0; n < vertices.size(); ++n) {
    const Eigen::Vector3f p = vertices[n] + Eigen::Vector3f::Zero();  // -0 becomes 0
    const std::array<std::int64_t, 3> key = {std::bit_cast<std::int32_t>(p.x()), std::bit_cast<std::int32_t>(p.y()),
                                             std::bit_cast<std::int32_t>(p.z())};
    target[n] = first.try_emplace(key, n).first->second;
  }
  return target;
}

/// The same for vertices within a distance; greedy, in file order.
std::vector<std::uint32_t> weldNear(const std::vector<Eigen::Vector3f>& vertices, double distance) {
  std::unordered_map<std::array<std::int64_t, 3>, std::vector<std::uint32_t>, CellHash> kept;
  std::vector<std::uint32_t> target(vertices.size());
  for (std::uint32_t n = 0; n < vertices.size(); ++n) {
    const Eigen::Vector3d p = vertices[n].cast<double>();
    std::array<std::int64_t, 3> cell;
    for (int a = 0; a < 3; ++a) cell[a] = std::int64_t(std::floor(p[a] / distance));
    target[n] = n;
    for (int near = 0; near < 27 && target[n] == n; ++near) {
      const auto found = kept.find({cell[0] + near % 3 - 1, cell[1] + near / 3 % 3 - 1, cell[2] + near / 9 - 1});
      if (found == kept.end()) continue;
      for (std::uint32_t other : found->second) {
        if ((vertices[other].cast<double>() - p).norm() <= distance) {
          target[n] = other;
          break;
        }
      }
    }
    if (target[n] == n) kept[cell].push_back(n);
  }
  return target;
}

/// Whether the height over the longest edge exceeds float32 rounding.
bool hasArea(const std::vector<Eigen::Vector3f>& vertices, const Triangle& t) {
  const Eigen::Vector3d a = vertices[t[0]].cast<double>(), b = vertices[t[1]].cast<double>(),
                        c = vertices[t[2]].cast<double>();
  const double longest2 = std::max({(b - a).squaredNorm(), (c - b).squaredNorm(), (a - c).squaredNorm()});
  return (b - a).cross(c - a).norm() > 1e-7 * longest2;
}

struct Edge {
  std::uint32_t low, high, triangle;
  bool forward;  ///< runs from low to high in its triangle
};

std::vector<Edge> sortedEdges(const std::vector<Triangle>& triangles) {
  std::vector<Edge> edges;
  edges.reserve(3 * triangles.size());
  for (std::uint32_t n = 0; n < triangles.size(); ++n) {
    for (int e = 0; e < 3; ++e) {
      const std::uint32_t from = triangles[n][e], to = triangles[n][(e + 1) % 3];
      edges.push_back({std::min(from, to), std::max(from, to), n, from < to});
    }
  }
  std::sort(edges.begin(), edges.end(), [](const Edge& a, const Edge& b) {
    return std::tie(a.low, a.high, a.triangle) < std::tie(b.low, b.high, b.triangle);
  });
  return edges;
}

/// Flips triangles of a two-manifold so that each shell is consistent and faces outwards.
/// @return false if a shell has only one side (cannot be oriented)
bool orientShells(RepairedMesh& mesh, const std::vector<Edge>& edges) {
  struct Neighbour {
    std::uint32_t triangle;
    bool agrees;
  };
  std::vector<std::array<Neighbour, 3>> neighbours(mesh.triangles.size());
  std::vector<std::uint8_t> used(mesh.triangles.size(), 0);
  for (std::size_t n = 0; n + 1 < edges.size(); n += 2) {
    const Edge &a = edges[n], &b = edges[n + 1];
    const bool agrees = a.forward != b.forward;
    neighbours[a.triangle][used[a.triangle]++] = {b.triangle, agrees};
    neighbours[b.triangle][used[b.triangle]++] = {a.triangle, agrees};
  }
  constexpr std::uint8_t kUnvisited = 2;
  std::vector<std::uint8_t> turn(mesh.triangles.size(), kUnvisited);
  std::vector<std::uint32_t> shell;
  for (std::uint32_t seed = 0; seed < mesh.triangles.size(); ++seed) {
    if (turn[seed] != kUnvisited) continue;
    turn[seed] = 0;
    shell.assign(1, seed);
    for (std::size_t n = 0; n < shell.size(); ++n) {
      for (const Neighbour& next : neighbours[shell[n]]) {
        const std::uint8_t wanted = next.agrees ? turn[shell[n]] : std::uint8_t(1 - turn[shell[n]]);
        if (turn[next.triangle] == kUnvisited) {
          turn[next.triangle] = wanted;
          shell.push_back(next.triangle);
        } else if (turn[next.triangle] != wanted) {
          return false;
        }
      }
    }
    std::uint64_t turned = 0;
    for (std::uint32_t t : shell) {
      if (turn[t] == 1) std::swap(mesh.triangles[t][1], mesh.triangles[t][2]), ++turned;
    }
    mesh.flipped += std::min(turned, shell.size() - turned);  // a shell that is wholly inside out is not a defect
    const Eigen::Vector3d origin = mesh.vertices[mesh.triangles[seed][0]].cast<double>();
    double volume = 0;
    for (std::uint32_t t : shell) {
      const Eigen::Vector3d a = mesh.vertices[mesh.triangles[t][0]].cast<double>() - origin,
                            b = mesh.vertices[mesh.triangles[t][1]].cast<double>() - origin,
                            c = mesh.vertices[mesh.triangles[t][2]].cast<double>() - origin;
      volume += a.dot(b.cross(c));
    }
    if (volume < 0) {
      for (std::uint32_t t : shell) std::swap(mesh.triangles[t][1], mesh.triangles[t][2]);
    }
  }
  return true;
}

/// Checks whether the surface is closed and, if so, orients it.
void closeAndOrient(RepairedMesh& mesh) {
  const std::vector<Edge> edges = sortedEdges(mesh.triangles);
  bool manifold = true, balanced = true;
  mesh.open_edges = 0;
  for (std::size_t begin = 0, end; begin < edges.size(); begin = end) {
    std::int64_t balance = 0;
    for (end = begin; end < edges.size() && edges[end].low == edges[begin].low && edges[end].high == edges[begin].high;
         ++end) {
      balance += edges[end].forward ? 1 : -1;
    }
    if (end - begin != 2) manifold = false;
    if (balance != 0) balanced = false;
    if (end - begin != 2 && balance != 0) ++mesh.open_edges;
  }
  // Shells that touch along an edge are not manifold, but if the edge's triangles cancel in pairs, the winding number
  // is still defined everywhere.
  mesh.watertight = !edges.empty() && ((manifold && orientShells(mesh, edges)) || balanced);
}

/// A triangle that is there both ways round: a surface that was exported with two sides encloses nothing.
enum class BackSides { Keep, Drop };

RepairedMesh join(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& triangles,
                  const std::vector<std::uint32_t>& target, bool keep_zero_area, BackSides backs) {
  RepairedMesh mesh;
  std::vector<std::uint32_t> index(vertices.size(), kUnset);
  std::set<Triangle> seen;
  for (const Triangle& t : triangles) {
    Triangle w = {target[t[0]], target[t[1]], target[t[2]]};
    const bool collapsed = w[0] == w[1] || w[1] == w[2] || w[2] == w[0];
    if (collapsed || !hasArea(vertices, w)) {
      if (collapsed || !keep_zero_area) {
        ++mesh.zero_area;
        continue;
      }
      ++mesh.zero_area_kept;
    }
    std::rotate(w.begin(), std::min_element(w.begin(), w.end()), w.end());
    Triangle known = w;
    if (backs == BackSides::Drop && known[1] > known[2]) std::swap(known[1], known[2]);
    if (!seen.insert(known).second) {
      ++mesh.duplicates;
      continue;
    }
    for (std::uint32_t& v : w) {
      if (index[v] == kUnset) {
        index[v] = std::uint32_t(mesh.vertices.size());
        mesh.vertices.push_back(vertices[v]);
      }
      v = index[v];
    }
    mesh.triangles.push_back(w);
  }
  closeAndOrient(mesh);
  return mesh;
}

RepairedMesh repaired(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& triangles,
                      BackSides backs) {
  const std::vector<std::uint32_t> exact = weldExact(vertices);
  RepairedMesh mesh = join(vertices, triangles, exact, false, backs);
  if (mesh.watertight || mesh.triangles.empty()) return mesh;

  // A triangle without area may join two others: dropping it would open the surface.
  if (mesh.zero_area > 0) {
    RepairedMesh with_all = join(vertices, triangles, exact, true, backs);
    if (with_all.watertight) return with_all;
  }
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3f& p : mesh.vertices) box.extend(p.cast<double>());
  const double tolerance = kWeldTolerance * box.sizes().maxCoeff();
  const std::vector<std::uint32_t> near = weldNear(vertices, tolerance);
  for (bool keep_zero_area : {false, true}) {
    RepairedMesh welded = join(vertices, triangles, near, keep_zero_area, backs);
    if (welded.watertight) {
      welded.welded_by_tolerance = true;
      return welded;
    }
  }
  return mesh;
}

}  // namespace

RepairedMesh repairMesh(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& triangles) {
  RepairedMesh mesh = repaired(vertices, triangles, BackSides::Drop);
  if (mesh.watertight || mesh.duplicates == 0 || mesh.duplicates >= mesh.triangles.size()) return mesh;
  // A fin of a closed body may have two sides and no thickness.
  RepairedMesh with_backs = repaired(vertices, triangles, BackSides::Keep);
  return with_backs.watertight ? with_backs : mesh;
}

}  // namespace accessvdb::internal

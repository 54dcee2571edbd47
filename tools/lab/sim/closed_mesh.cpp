// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/closed_mesh.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

#include "sim/nearest_on_triangle.h"

namespace accessvdb::sim {
namespace {

/// For each vertex, the lowest index among those at the same position.
std::vector<std::uint32_t> weld(const std::vector<Eigen::Vector3f>& vertices) {
  std::vector<std::uint32_t> order(vertices.size());
  std::iota(order.begin(), order.end(), 0u);
  const auto key = [&](std::uint32_t id) {
    const Eigen::Vector3f& v = vertices[id];
    return std::tuple(v.x() + 0.0f, v.y() + 0.0f, v.z() + 0.0f);  // -0 is 0
  };
  std::sort(order.begin(), order.end(),
            [&](std::uint32_t a, std::uint32_t b) { return std::pair(key(a), a) < std::pair(key(b), b); });
  std::vector<std::uint32_t> first(vertices.size());
  for (std::size_t n = 0; n < order.size(); ++n)
    first[order[n]] = n > 0 && key(order[n]) == key(order[n - 1]) ? first[order[n - 1]] : order[n];
  return first;
}

/// For each (welded) vertex, the lowest vertex of its part.
std::vector<std::uint32_t> parts(const TriangleMesh& mesh, const std::vector<std::uint32_t>& welded) {
  std::vector<std::uint32_t> parent = welded;
  const auto root = [&](std::uint32_t v) {
    while (parent[v] != v) v = parent[v] = parent[parent[v]];
    return v;
  };
  for (const auto& t : mesh.triangles)
    for (std::size_t k = 1; k < 3; ++k) {
      const std::uint32_t a = root(t[0]), b = root(t[k]);
      parent[std::max(a, b)] = std::min(a, b);
    }
  for (std::uint32_t v = 0; v < parent.size(); ++v) parent[v] = root(v);
  return parent;
}

struct Edge {
  std::uint32_t low, high;
  std::int32_t turn;  ///< +1 from low to high, -1 the other way
};

}  // namespace

std::string whyNotClosed(const TriangleMesh& mesh) {
  if (mesh.triangles.empty()) return "the mesh has no triangles";
  for (const auto& vertex : mesh.vertices_W)
    if (!vertex.allFinite()) return "the mesh has vertices that are not finite";
  for (const auto& t : mesh.triangles)
    for (const std::uint32_t index : t)
      if (index >= mesh.vertices_W.size()) return "the mesh has triangles with missing vertices";

  const std::vector<std::uint32_t> welded = weld(mesh.vertices_W);
  std::vector<Edge> edges;
  edges.reserve(3 * mesh.triangles.size());
  for (const auto& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = welded[t[k]], b = welded[t[(k + 1) % 3]];
      if (a != b) edges.push_back({std::min(a, b), std::max(a, b), a < b ? 1 : -1});
    }
  if (edges.empty()) return "the mesh has no triangle with an area";
  std::sort(edges.begin(), edges.end(),
            [](const Edge& a, const Edge& b) { return std::tie(a.low, a.high) < std::tie(b.low, b.high); });
  std::uint64_t open = 0, flipped = 0;
  for (std::size_t begin = 0; begin < edges.size();) {
    std::size_t end = begin;
    std::int32_t turns = 0;
    for (; end < edges.size() && edges[end].low == edges[begin].low && edges[end].high == edges[begin].high; ++end)
      turns += edges[end].turn;
    if (turns != 0) ((end - begin) % 2 == 1 ? open : flipped) += 1;
    begin = end;
  }
  if (open > 0) return "the mesh is not closed: " + std::to_string(open) + " edges belong to only one triangle";
  if (flipped > 0)
    return "the mesh has flipped triangles: " + std::to_string(flipped) + " edges run the same way twice";
  return {};
}

std::vector<std::uint32_t> insideOutCandidates(const TriangleMesh& mesh) {
  const std::vector<std::uint32_t> part = parts(mesh, weld(mesh.vertices_W));
  std::vector<double> volume_m3(mesh.vertices_W.size(), 0), largest_m2(mesh.vertices_W.size(), -1);
  std::vector<std::uint32_t> largest(mesh.vertices_W.size(), 0);
  for (std::uint32_t n = 0; n < mesh.triangles.size(); ++n) {
    const auto& t = mesh.triangles[n];
    const std::uint32_t id = part[t[0]];
    const Eigen::Vector3d base = mesh.vertices_W[id].cast<double>();  // near the part, to avoid cancellation
    volume_m3[id] +=
        (mesh.vertices_W[t[0]].cast<double>() - base)
            .dot((mesh.vertices_W[t[1]].cast<double>() - base).cross(mesh.vertices_W[t[2]].cast<double>() - base));
    const double area_m2 = triangleArea(mesh, n);
    if (area_m2 > largest_m2[id]) {
      largest_m2[id] = area_m2;
      largest[id] = n;
    }
  }
  std::vector<std::uint32_t> candidates;
  for (std::uint32_t id = 0; id < mesh.vertices_W.size(); ++id)
    if (largest_m2[id] > 0 && !(volume_m3[id] > 0)) candidates.push_back(largest[id]);
  return candidates;
}

std::uint32_t partCount(const TriangleMesh& mesh) {
  const std::vector<std::uint32_t> part = parts(mesh, weld(mesh.vertices_W));
  std::vector<bool> used(part.size(), false);
  for (const auto& t : mesh.triangles) used[part[t[0]]] = true;
  return std::uint32_t(std::count(used.begin(), used.end(), true));
}

}  // namespace accessvdb::sim

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "report/tool_drawing.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <map>
#include <string>
#include <vector>

#include "report/text_coding.h"
#include "tool/tool_solid.h"

namespace accessvdb::internal {
namespace {

static_assert(std::endian::native == std::endian::little, "arrays are copied directly from memory");

using Json = nlohmann::ordered_json;
using Triangle = std::array<std::uint32_t, 3>;

constexpr std::size_t kMostTriangles = 30'000;
constexpr double kMostCells = 1 << 24;

struct Mesh {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<Triangle> triangles;
};

/// Moves all vertices of a cell onto the first one of them, and drops the triangles that thereby vanish.
Mesh clustered(const ToolGeometry& tool, float cell_m) {
  Mesh mesh;
  std::map<std::array<std::int64_t, 3>, std::uint32_t> first_of;
  std::vector<std::uint32_t> moved;
  for (const Eigen::Vector3f& vertex : tool.vertices_T()) {
    std::array<std::int64_t, 3> cell = {};
    for (int axis = 0; axis < 3; ++axis) {
      cell[static_cast<std::size_t>(axis)] = static_cast<std::int64_t>(std::floor(vertex[axis] / cell_m));
    }
    const auto [found, added] = first_of.try_emplace(cell, static_cast<std::uint32_t>(mesh.vertices.size()));
    if (added) mesh.vertices.push_back(vertex);
    moved.push_back(found->second);
  }
  for (const Triangle& triangle : tool.triangles()) {
    const Triangle next = {moved[triangle[0]], moved[triangle[1]], moved[triangle[2]]};
    if (next[0] != next[1] && next[1] != next[2] && next[2] != next[0]) mesh.triangles.push_back(next);
  }
  return mesh;
}

template <typename T>
void append(std::string& bytes, const std::vector<T>& values) {
  const std::size_t before = bytes.size();
  bytes.resize(before + values.size() * sizeof(T));
  if (!values.empty()) std::memcpy(bytes.data() + before, values.data(), values.size() * sizeof(T));
}

Json drawnMesh(const ToolGeometry& tool) {
  Mesh mesh = {tool.vertices_T(), tool.triangles()};
  const bool simplified = mesh.triangles.size() > kMostTriangles;
  for (float cell_m = tool.reach_m() / 512; mesh.triangles.size() > kMostTriangles; cell_m *= 1.5f) {
    mesh = clustered(tool, cell_m);
  }
  static_assert(sizeof(Eigen::Vector3f) == 12 && sizeof(Triangle) == 12);
  std::string bytes;
  append(bytes, mesh.vertices);
  append(bytes, mesh.triangles);
  return {{"vertices", mesh.vertices.size()},
          {"triangles", mesh.triangles.size()},
          {"simplified", simplified},
          {"data", base64(deflated(bytes))}};
}

Json filledCells(const ToolGeometry& tool, const ToolCells& cells) {
  const Eigen::Vector3d size_m = (tool.max_T() - tool.min_T()).cast<double>();
  double scale = 1;  // voxels to a cell's edge
  const auto count = [&] { return (size_m.array() / (cells.voxel_size_m * scale) + 2).prod(); };
  while (count() > kMostCells) scale *= 2;
  const double edge_m = cells.voxel_size_m * scale;

  std::vector<Eigen::Vector3d> vertices;
  for (const Eigen::Vector3f& vertex : tool.vertices_T()) vertices.push_back(vertex.cast<double>() / edge_m);
  const std::vector<VoxelRun> runs = ToolSolid(tool).voxels(vertices, edge_m, cells.self_exclusion_voxels / scale).runs;
  std::array<std::int32_t, 3> low = {0, 0, 0}, high = {-1, -1, -1};
  for (std::size_t n = 0; n < runs.size(); ++n) {
    const std::array<std::int32_t, 3> from = {runs[n].i, runs[n].j, runs[n].lo},
                                      to = {runs[n].i, runs[n].j, runs[n].hi};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = n == 0 ? from[axis] : std::min(low[axis], from[axis]);
      high[axis] = n == 0 ? to[axis] : std::max(high[axis], to[axis]);
    }
  }
  const std::array<std::int32_t, 3> size = {high[0] - low[0] + 1, high[1] - low[1] + 1, high[2] - low[2] + 1};
  std::string bits(
      (static_cast<std::size_t>(size[0]) * static_cast<std::size_t>(size[1]) * static_cast<std::size_t>(size[2]) + 7) /
          8,
      '\0');
  for (const VoxelRun& run : runs) {
    for (std::int32_t k = run.lo; k <= run.hi; ++k) {
      const auto bit = (static_cast<std::size_t>(k - low[2]) * static_cast<std::size_t>(size[1]) +
                        static_cast<std::size_t>(run.j - low[1])) *
                           static_cast<std::size_t>(size[0]) +
                       static_cast<std::size_t>(run.i - low[0]);
      bits[bit / 8] = static_cast<char>(static_cast<unsigned char>(bits[bit / 8]) | 1u << bit % 8);
    }
  }
  return {{"edge_m", edge_m}, {"min", low}, {"size", size}, {"data", base64(deflated(bits))}};
}

}  // namespace

Json drawTool(const ToolGeometry& tool, const ToolCells& cells) {
  return {{"mesh", drawnMesh(tool)}, {"cells", filledCells(tool, cells)}};
}

}  // namespace accessvdb::internal

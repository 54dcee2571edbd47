// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/tool_bitmap.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "accessvdb/error.h"
#include "tool/tool_solid.h"

namespace accessvdb::internal {
namespace {

/// Finer would follow the tool better, and takes the cube of it.
constexpr int kFinest = 4;
constexpr double kMostNodes = 8.0 * (1 << 28);  // 256 MiB
/// From the centre of a cube to its corner, in edges, rounded up.
constexpr double kCentreToCorner = 0.8660255;

/// Nodes around one within which a voxel may be entered.
double grownBy(int nodes_per_voxel) {
  // A voxel's corner, that of one of the tool's own voxels, and that of a node; and more than float32 loses on the way.
  constexpr double kSlack = 0.25;
  return kCentreToCorner * (nodes_per_voxel + 1) + kCentreToCorner + kSlack;
}

double nodesOf(const ToolGeometry& tool, double edge_m, double grown) {
  const Eigen::Vector3d size = (tool.max_T() - tool.min_T()).cast<double>() / edge_m;
  return (size.array() + 2 * grown + 4).prod();
}

}  // namespace

ToolBitmap::ToolBitmap(const ToolGeometry& tool, double voxel_size_m) : nodes_per_voxel(kFinest) {
  while (nodes_per_voxel > 1 && nodesOf(tool, voxel_size_m / nodes_per_voxel, grownBy(nodes_per_voxel)) > kMostNodes)
    --nodes_per_voxel;
  const double edge_m = voxel_size_m / nodes_per_voxel, grown = grownBy(nodes_per_voxel);
  if (nodesOf(tool, edge_m, grown) > kMostNodes) {
    throw ResourceLimit("tool.span", tool.name(), "is too large for its voxels to be tried at any pose",
                        "Use a larger voxel_size_m");
  }
  std::vector<Eigen::Vector3d> vertices;
  for (const Eigen::Vector3f& p : tool.vertices_T()) vertices.push_back(p.cast<double>() / edge_m);
  constexpr double kNothingLeftOut = -1;
  const std::vector<VoxelRun> runs = ToolSolid(tool).voxels(vertices, edge_m, kNothingLeftOut).runs;
  const auto reach = static_cast<std::int32_t>(std::ceil(grown));
  std::array<std::int32_t, 3> high;
  low.fill(std::numeric_limits<std::int32_t>::max());
  high.fill(std::numeric_limits<std::int32_t>::min());
  for (const VoxelRun& run : runs) {
    const std::array<std::int32_t, 3> first = {run.i, run.j, run.lo}, last = {run.i, run.j, run.hi};
    for (std::size_t a = 0; a < 3; ++a) {
      low[a] = std::min(low[a], first[a] - reach);
      high[a] = std::max(high[a], last[a] + reach);
    }
  }
  if (runs.empty()) throw ResourceLimit("tool.span", tool.name(), "has no voxels", "Use a smaller voxel_size_m");
  for (std::size_t a = 0; a < 3; ++a) size[a] = high[a] - low[a] + 1;
  words_z = (size[2] + 63) / 64;
  words.assign(
      static_cast<std::size_t>(size[0]) * static_cast<std::size_t>(size[1]) * static_cast<std::size_t>(words_z), 0);
  for (std::int32_t di = -reach; di <= reach; ++di) {
    for (std::int32_t dj = -reach; dj <= reach; ++dj) {
      const double left = grown * grown - di * di - dj * dj;
      if (left < 0) continue;
      const auto up = static_cast<std::int32_t>(std::sqrt(left));
      for (const VoxelRun& run : runs) {
        const std::int32_t begin = run.lo - up - low[2], end = run.hi + up - low[2];
        std::uint64_t* const row =
            words.data() + (static_cast<std::size_t>(run.i + di - low[0]) * static_cast<std::size_t>(size[1]) +
                            static_cast<std::size_t>(run.j + dj - low[1])) *
                               static_cast<std::size_t>(words_z);
        for (std::int32_t word = begin >> 6; word <= end >> 6; ++word) {
          const std::int32_t from = std::max(begin - 64 * word, 0), to = std::min(end - 64 * word, 63);
          row[word] |= ~std::uint64_t{0} << from & ~std::uint64_t{0} >> (63 - to);
        }
      }
    }
  }
}

kernels::ToolBitmapView ToolBitmap::view() const {
  kernels::ToolBitmapView view;
  view.words = words.data();
  view.words_z = words_z;
  view.nodes_per_voxel = static_cast<float>(nodes_per_voxel);
  for (std::size_t a = 0; a < 3; ++a) {
    view.size[a] = size[a];
    view.low[a] = static_cast<float>(low[a]) - 0.5f;
  }
  return view;
}

}  // namespace accessvdb::internal

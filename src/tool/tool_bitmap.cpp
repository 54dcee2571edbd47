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

/// Appends the nodes that are at most so far from those of the runs. @param corner  lower corner of node 0, in nodes
ToolBitmap::Level grownNodes(const std::vector<VoxelRun>& runs, double grown, const std::array<double, 3>& corner,
                             std::vector<std::uint64_t>& words) {
  const auto reach = static_cast<std::int32_t>(std::ceil(grown));
  std::array<std::int32_t, 3> low, high;
  low.fill(std::numeric_limits<std::int32_t>::max());
  high.fill(std::numeric_limits<std::int32_t>::min());
  for (const VoxelRun& run : runs) {
    const std::array<std::int32_t, 3> first = {run.i, run.j, run.lo}, last = {run.i, run.j, run.hi};
    for (std::size_t a = 0; a < 3; ++a) {
      low[a] = std::min(low[a], first[a] - reach);
      high[a] = std::max(high[a], last[a] + reach);
    }
  }
  ToolBitmap::Level level;
  for (std::size_t a = 0; a < 3; ++a) {
    level.size[a] = high[a] - low[a] + 1;
    level.low[a] = corner[a] + low[a];
  }
  level.words_z = (level.size[2] + 63) / 64;
  level.first_word = words.size();
  const auto columns = static_cast<std::size_t>(level.size[0]) * static_cast<std::size_t>(level.size[1]);
  words.resize(words.size() + columns * static_cast<std::size_t>(level.words_z), 0);
  for (std::int32_t di = -reach; di <= reach; ++di) {
    for (std::int32_t dj = -reach; dj <= reach; ++dj) {
      const double left = grown * grown - di * di - dj * dj;
      if (left < 0) continue;
      const auto up = static_cast<std::int32_t>(std::sqrt(left));
      for (const VoxelRun& run : runs) {
        const std::int32_t begin = run.lo - up - low[2], end = run.hi + up - low[2];
        std::uint64_t* const row =
            words.data() + level.first_word +
            (static_cast<std::size_t>(run.i + di - low[0]) * static_cast<std::size_t>(level.size[1]) +
             static_cast<std::size_t>(run.j + dj - low[1])) *
                static_cast<std::size_t>(level.words_z);
        for (std::int32_t word = begin >> 6; word <= end >> 6; ++word) {
          const std::int32_t from = std::max(begin - 64 * word, 0), to = std::min(end - 64 * word, 63);
          row[word] |= ~std::uint64_t{0} << from & ~std::uint64_t{0} >> (63 - to);
        }
      }
    }
  }
  return level;
}

/// Nodes twice as large: those with any of the finer ones in them.
std::vector<VoxelRun> halvedNodes(const kernels::NodeBitmap& fine) {
  std::vector<VoxelRun> runs;
  const auto any = [&](std::int32_t i, std::int32_t j, std::int32_t word) {
    std::uint64_t bits = 0;
    for (std::int32_t x = 2 * i; x < std::min(2 * i + 2, fine.size[0]); ++x) {
      for (std::int32_t y = 2 * j; y < std::min(2 * j + 2, fine.size[1]); ++y)
        bits |= fine.words[static_cast<std::size_t>(x * fine.size[1] + y) * static_cast<std::size_t>(fine.words_z) +
                           static_cast<std::size_t>(word)];
    }
    return bits;
  };
  for (std::int32_t i = 0; 2 * i < fine.size[0]; ++i) {
    for (std::int32_t j = 0; 2 * j < fine.size[1]; ++j) {
      for (std::int32_t word = 0; word < fine.words_z; ++word) {
        const std::uint64_t bits = any(i, j, word);
        for (std::int32_t k = 0; k < 32; ++k) {
          if ((bits >> (2 * k) & 3) == 0) continue;
          const std::int32_t z = 32 * word + k;
          const bool goes_on = !runs.empty() && runs.back().i == i && runs.back().j == j && runs.back().hi + 1 == z;
          if (goes_on)
            runs.back().hi = z;
          else
            runs.push_back({i, j, z, z});
        }
      }
    }
  }
  return runs;
}

kernels::NodeBitmap viewOf(const ToolBitmap::Level& level, const std::uint64_t* words) {
  kernels::NodeBitmap view;
  view.words = words + level.first_word;
  view.words_z = level.words_z;
  view.nodes_per_voxel = static_cast<float>(level.nodes_per_voxel);
  for (std::size_t a = 0; a < 3; ++a) {
    view.size[a] = level.size[a];
    view.low[a] = static_cast<float>(level.low[a]);
  }
  return view;
}

}  // namespace

ToolBitmap::ToolBitmap(const ToolGeometry& tool, double voxel_size_m) {
  int nodes_per_voxel = kFinest;
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
  if (runs.empty()) throw ResourceLimit("tool.span", tool.name(), "has no voxels", "Use a smaller voxel_size_m");
  voxels = grownNodes(runs, grown, {-0.5, -0.5, -0.5}, words);
  voxels.nodes_per_voxel = nodes_per_voxel;

  // From a node's centre to a voxel's in it, to its block's centre, to that node's; and what float32 loses.
  const double per_voxel = 0.5 * nodes_per_voxel;
  constexpr double kSlack = 0.1;
  const double to_block = 2 * kCentreToCorner * 0.5 * (kernels::tool_fit::kBlock - 1) * per_voxel;
  blocks = grownNodes(halvedNodes(viewOf(voxels, words.data())), 2 * kCentreToCorner + to_block + kSlack,
                      {0.5 * voxels.low[0], 0.5 * voxels.low[1], 0.5 * voxels.low[2]}, words);
  blocks.nodes_per_voxel = per_voxel;
}

kernels::ToolBitmapView ToolBitmap::view(const std::uint64_t* of_words) const {
  kernels::ToolBitmapView view;
  static_cast<kernels::NodeBitmap&>(view) = viewOf(voxels, of_words);
  view.blocks = viewOf(blocks, of_words);
  return view;
}

}  // namespace accessvdb::internal

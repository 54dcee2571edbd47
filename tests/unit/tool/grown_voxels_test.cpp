// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Tools with a margin, against distances from voxel to voxel.
#include "tool/grown_voxels.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>
#include <set>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/tool_geometry.h"
#include "tool/tool_kernel.h"
#include "tool/voxel_runs.h"

namespace accessvdb::internal {
namespace {

using Voxel = std::array<std::int32_t, 3>;

std::set<Voxel> voxelsOfRuns(const std::vector<VoxelRun>& runs) {
  std::set<Voxel> voxels;
  for (const VoxelRun& run : runs)
    for (std::int32_t k = run.lo; k <= run.hi; ++k) EXPECT_TRUE(voxels.insert({run.i, run.j, k}).second);
  return voxels;
}

std::vector<VoxelRun> runsOfVoxels(const std::set<Voxel>& voxels) {
  std::vector<VoxelRun> runs;
  for (const Voxel& v : voxels) runs.push_back({v[0], v[1], v[2], v[2]});
  joinRuns(runs);
  return runs;
}

double norm(const Voxel& v) { return std::sqrt(double(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])); }

/// Every voxel of a box, by every voxel of the tool.
std::set<Voxel> grownByHand(const std::set<Voxel>& tool, double margin, double exclusion, std::int32_t box) {
  std::set<Voxel> grown = tool;
  for (std::int32_t i = -box; i <= box; ++i)
    for (std::int32_t j = -box; j <= box; ++j)
      for (std::int32_t k = -box; k <= box; ++k)
        for (const Voxel& t : tool) {
          const double room = exclusion < 0 ? margin : std::min(margin, (norm(t) - exclusion) / 3);
          if (norm({i - t[0], j - t[1], k - t[2]}) > room + 1e-6) continue;
          grown.insert({i, j, k});
          break;
        }
  return grown;
}

/// Voxels of a rod and some beside it, without those near the tip.
std::set<Voxel> randomTool(std::mt19937& random, double exclusion) {
  std::set<Voxel> tool;
  for (std::int32_t i = 0; i < 14; ++i) tool.insert({i, 0, 0});
  for (int n = 0; n < 60; ++n) {
    const auto within = [&](int most) { return static_cast<std::int32_t>(random() % (2u * most + 1)) - most; };
    tool.insert({within(9), within(9), within(9)});
  }
  std::erase_if(tool, [&](const Voxel& v) { return norm(v) <= exclusion; });
  return tool;
}

TEST(GrownVoxels, AreThoseWithinTheMargin) {
  std::mt19937 random(3);
  for (int n = 0; n < 30; ++n) {
    SCOPED_TRACE(n);
    const double margin = n % 3 == 0 ? 1 + n % 5 : 1 + 0.001 * (random() % 4000);
    const double exclusion = n % 4 == 0 ? -1 : 0.5 * (random() % 9);
    const std::set<Voxel> tool = randomTool(random, exclusion);
    EXPECT_EQ(voxelsOfRuns(grownVoxels(runsOfVoxels(tool), margin, exclusion)),
              grownByHand(tool, margin, exclusion, 20));
  }
}

TEST(GrownVoxels, OfASmallerMarginAreAmongThoseOfALargerOne) {
  std::mt19937 random(4);
  for (int n = 0; n < 20; ++n) {
    const double exclusion = 0.5 * (random() % 9);
    const std::set<Voxel> tool = randomTool(random, exclusion);
    std::set<Voxel> before = tool;
    for (const double margin : {0.0, 0.7, 1.0, 1.9, 2.5, 4.0, 7.0}) {
      const std::set<Voxel> grown = voxelsOfRuns(grownVoxels(runsOfVoxels(tool), margin, exclusion));
      EXPECT_TRUE(std::includes(grown.begin(), grown.end(), before.begin(), before.end())) << margin;
      before = grown;
    }
    EXPECT_GT(before.size(), 5 * tool.size());
  }
}

/// What a voxel's box is too large for is grown row by row.
TEST(GrownVoxels, OfALargeToolAreTheSame) {
  std::vector<VoxelRun> runs = {{0, 0, 5, 9}, {1, 3, -4, 4}, {3000, 2, 7, 7}, {3000, 4000, 0, 3}, {3001, 4000, 1, 2}};
  const std::vector<VoxelRun> grown = grownVoxels(runs, 4, -1);
  std::set<Voxel> expected;
  for (const Voxel& t : voxelsOfRuns(runs))
    for (std::int32_t i = -4; i <= 4; ++i)
      for (std::int32_t j = -4; j <= 4; ++j)
        for (std::int32_t k = -4; k <= 4; ++k)
          if (norm({i, j, k}) <= 4) expected.insert({t[0] + i, t[1] + j, t[2] + k});
  EXPECT_EQ(voxelsOfRuns(grown), expected);
}

FieldParams paramsOf(double voxel_m) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_m;
  params.approach.num_directions = 12;
  return params;
}

/// A tool that is larger must not be allowed more collisions.
TEST(GrownTool, HasTheLimitOfTheToolAlone) {
  const ToolGeometry pruner = ToolGeometry::builtin("builtin:pruner");
  const FieldParams params = paramsOf(0.02);
  const ToolKernel alone = ToolKernel::make(pruner, params), grown = ToolKernel::make(pruner.grownBy(0.06), params);
  EXPECT_GT(alone.collision_limit, 2);
  EXPECT_EQ(alone.collision_limit, grown.collision_limit);
  EXPECT_EQ(alone.voxel_count, grown.voxel_count);
  EXPECT_EQ(alone.hidden_share, grown.hidden_share);
  for (std::size_t a = 0; a < 3; ++a) {
    EXPECT_LE(grown.min_ijk[a], alone.min_ijk[a] - (a == 0 ? 0 : 2));
    EXPECT_EQ(grown.max_ijk[a], alone.max_ijk[a] + 3);
  }
}

TEST(GrownTool, IsToldApart) {
  const ToolGeometry pruner = ToolGeometry::builtin("builtin:pruner"), grown = pruner.grownBy(0.02);
  EXPECT_EQ(grown.margin_m(), 0.02);
  EXPECT_NE(grown.sha256(), pruner.sha256());
  EXPECT_NE(grown.sha256(), pruner.grownBy(0.03).sha256());
  EXPECT_EQ(grown.grownBy(0).sha256(), pruner.sha256());
  EXPECT_EQ(grown.vertices_T().size(), pruner.vertices_T().size());
}

TEST(GrownTool, RefusesMarginsThatVoxelsCannotShow) {
  const ToolGeometry pruner = ToolGeometry::builtin("builtin:pruner");
  const auto refused = [](const auto& act) -> std::string {
    try {
      act();
      return "taken";
    } catch (const Error& error) {
      return error.id();
    }
  };
  for (const double margin_m : {-0.01, std::nan(""), double{INFINITY}, 1.2}) {
    EXPECT_EQ(refused([&] { (void)pruner.grownBy(margin_m); }), "tool.margin") << margin_m;
  }
  EXPECT_EQ(refused([&] { (void)ToolKernel::make(pruner.grownBy(0.019), paramsOf(0.02)); }), "tool.margin");
  EXPECT_EQ(refused([&] { (void)ToolKernel::make(pruner.grownBy(0.02), paramsOf(0.02)); }), "taken");
  EXPECT_EQ(refused([&] { (void)ToolKernel::make(pruner.grownBy(0.7), paramsOf(0.005)); }), "tool.margin");
  FieldParams samples = paramsOf(0.02);
  samples.scoring.form = ToolForm::SurfaceSamples;
  EXPECT_EQ(refused([&] { (void)ToolKernel::make(pruner.grownBy(0.02), samples); }), "tool.margin");
}

}  // namespace
}  // namespace accessvdb::internal

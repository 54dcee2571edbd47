// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/tool_rolls.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstring>
#include <numbers>
#include <random>
#include <set>
#include <stdexcept>
#include <thread>
#include <vector>

#include "accessvdb/error.h"
#include "tool/orientation_count.h"
#include "tool/tool_kernel.h"
#include "tool/voxel_runs.h"
#include "unit/tool/test_meshes.h"

namespace accessvdb::internal {
namespace {

using RollCells = std::set<std::array<int, 3>>;

/// A prism along +x whose cross-section has these corners.
ToolGeometry prism(const std::vector<Eigen::Vector2f>& corners) {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  const auto n = static_cast<std::uint32_t>(corners.size());
  for (const float x : {0.05f, 0.4f}) {
    for (const Eigen::Vector2f& corner : corners) vertices.emplace_back(x, corner.x(), corner.y());
  }
  for (std::uint32_t k = 0; k < n; ++k) {
    const std::uint32_t next = (k + 1) % n;
    triangles.push_back({k, next, n + next});
    triangles.push_back({k, n + next, n + k});
    if (k == 0 || k + 1 == n) continue;
    triangles.push_back({0, k + 1, k});
    triangles.push_back({n, n + k, n + k + 1});
  }
  return ToolGeometry::fromTriangles(vertices, triangles, "prism");
}

std::vector<Eigen::Vector2f> polygon(int corners, double radius_m, double first_rad = 0.3) {
  std::vector<Eigen::Vector2f> out;
  for (int k = 0; k < corners; ++k) {
    const double angle = first_rad + 2 * std::numbers::pi * k / corners;
    out.emplace_back(static_cast<float>(radius_m * std::cos(angle)), static_cast<float>(radius_m * std::sin(angle)));
  }
  return out;
}

TEST(FoldAboutBody, IsThatOfTheCrossSection) {
  for (const int corners : {3, 4, 5, 6, 11, 12, 24, 48}) {
    EXPECT_EQ(foldAboutBody(prism(polygon(corners, 0.1))), corners);
  }
  EXPECT_EQ(foldAboutBody(prism({{-0.1f, -0.05f}, {0.1f, -0.05f}, {0.1f, 0.05f}, {-0.1f, 0.05f}})), 2);
  EXPECT_EQ(foldAboutBody(prism({{-0.1f, -0.05f}, {0.1f, -0.05f}, {0.1f, 0.06f}, {-0.1f, 0.06f}})), 1);  // off the axis
  EXPECT_EQ(foldAboutBody(prism({{-0.1f, -0.05f}, {0.1f, -0.04f}, {0.03f, 0.08f}})), 1);
  EXPECT_EQ(foldAboutBody(ToolGeometry::builtin("builtin:pruner")), 2);
  EXPECT_GE(foldAboutBody(ToolGeometry::builtin("builtin:pencil")), kTurnedFold);
}

/// Vertices are where they would be with all faces, but the surface is not the same after a quarter turn.
TEST(FoldAboutBody, NoticesAFaceThatIsMissing) {
  const ToolGeometry whole = prism(polygon(4, 0.1));
  ASSERT_EQ(foldAboutBody(whole), 4);
  std::vector<std::array<std::uint32_t, 3>> triangles = whole.triangles();
  std::erase_if(triangles, [](const auto& t) {
    const auto on_side = [](std::uint32_t v) { return v % 4 == 0 || v % 4 == 1; };
    return on_side(t[0]) && on_side(t[1]) && on_side(t[2]);
  });
  ASSERT_EQ(triangles.size() + 2, whole.triangles().size());
  EXPECT_EQ(foldAboutBody(ToolGeometry::fromTriangles(whole.vertices_T(), triangles, "open")), 1);
}

/// A mesh that is nearly symmetric, by a hundredth of its radius.
TEST(FoldAboutBody, TakesAThousandthOfTheRadiusForRounding) {
  std::vector<Eigen::Vector2f> corners = polygon(6, 0.1);
  corners[2] *= 1.0005f;
  EXPECT_EQ(foldAboutBody(prism(corners)), 6);
  corners[2] *= 1.01f;
  EXPECT_EQ(foldAboutBody(prism(corners)), 1);
}

TEST(ToolRolls, FollowTheRule) {
  const auto by_rule = [](const ToolGeometry& tool, const OrientationSet& set) {
    ApproachParams approach;
    approach.orientations = set;
    return toolRolls(tool, approach).count;
  };
  const ToolGeometry pruner = ToolGeometry::builtin("builtin:pruner"), pencil = ToolGeometry::builtin("builtin:pencil");
  for (const OrientationSet& set : {OrientationSet::yaw(), OrientationSet::pitch(0, 30, 30),
                                    OrientationSet::of({orientationOf(1, 2, 3), orientationOf(1, 2, 4)})}) {
    EXPECT_EQ(by_rule(pruner, set), 1) << set.text();
  }
  for (const OrientationSet& set : {OrientationSet::sphere(30), OrientationSet::sphere(30, true)}) {
    EXPECT_EQ(by_rule(pruner, set), 6) << set.text();
    EXPECT_EQ(by_rule(pencil, set), 1) << set.text();
    EXPECT_EQ(by_rule(prism(polygon(3, 0.1)), set), 4);
    EXPECT_EQ(by_rule(prism(polygon(5, 0.1)), set), 3);  // no more than 30 degrees apart
    EXPECT_EQ(by_rule(prism(polygon(11, 0.1)), set), 2);
    EXPECT_EQ(by_rule(prism({{-0.1f, -0.05f}, {0.1f, -0.04f}, {0.03f, 0.08f}}), set), 12);
  }
  ApproachParams approach;
  approach.rolls = 5;
  EXPECT_EQ(toolRolls(pruner, approach).count, 5);
  EXPECT_EQ(toolRolls(pruner, approach).fold, 2);
  EXPECT_EQ(toolRolls(pencil, approach).count, 5);
}

/// About the body: the axis stays, and a tool point moves as a rotation matrix of plain cosines says.
TEST(ToolRolls, TurnAboutTheBody) {
  const ToolRolls rolls = {7, 3};
  for (const ToolOrientation& orientation :
       {orientationOf(20, 30, 0), orientationOf(0, 90, 0), orientationOf(200, -70, 33)}) {
    for (int roll = 0; roll < rolls.count; ++roll) {
      const ToolOrientation held = rolledBy(orientation, rolls, roll);
      const double angle = 2 * std::numbers::pi * roll / 21;
      const Eigen::Matrix3d expected =
          orientation.R_WT * Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitX()).toRotationMatrix();
      EXPECT_LT((held.R_WT - expected).cwiseAbs().maxCoeff(), 1e-15);
      EXPECT_EQ(held.R_WT.col(0), orientation.R_WT.col(0));
      EXPECT_NEAR(held.roll_rad, orientation.roll_rad + angle, 1e-15);
    }
    EXPECT_EQ(rolledBy(orientation, rolls, 0).R_WT, orientation.R_WT);
  }
}

RollCells cellsOfRuns(const std::vector<VoxelRun>& runs) {
  RollCells cells;
  for (const VoxelRun& run : runs) {
    for (int k = run.lo; k <= run.hi; ++k) EXPECT_TRUE(cells.insert({run.i, run.j, k}).second);
  }
  return cells;
}

std::vector<VoxelRun> randomRuns(std::mt19937_64& random) {
  std::vector<VoxelRun> runs;
  for (std::int32_t i = 0; i < 3; ++i) {
    for (std::int32_t j = 0; j < 3; ++j) {
      std::int32_t k = -8;
      while (k < 8) {
        k += 1 + static_cast<std::int32_t>(random() % 5);
        const auto length = static_cast<std::int32_t>(random() % 4);
        if (random() % 4 != 0) runs.push_back({i, j, k, k + length});
        k += length + 1;
      }
    }
  }
  return runs;
}

TEST(VoxelRuns, AreSetsOfVoxels) {
  std::mt19937_64 random(3);
  for (int round = 0; round < 500; ++round) {
    const std::vector<VoxelRun> a = randomRuns(random), b = randomRuns(random);
    const RollCells in_a = cellsOfRuns(a), in_b = cellsOfRuns(b);
    RollCells both, only_a;
    for (const auto& cell : in_a) (in_b.contains(cell) ? both : only_a).insert(cell);
    ASSERT_EQ(cellsOfRuns(sharedVoxels(a, b)), both);
    ASSERT_EQ(cellsOfRuns(voxelsWithout(a, b)), only_a);
  }
}

RollCells cellsOfPart(const ToolKernel& kernel, int part) {
  RollCells cells;
  for (std::uint32_t n = kernel.column_begin[std::size_t(part)]; n < kernel.column_begin[std::size_t(part) + 1]; ++n) {
    const kernels::VoxelColumn& c = kernel.columns[n];
    for (int bit = 0; bit < 64; ++bit) {
      if ((c.bits >> bit & 1) == 0) continue;
      EXPECT_TRUE(cells.insert({c.dx, c.dy, c.dz + bit}).second);
    }
  }
  return cells;
}

/// Core and rest of a roll are the tool of that orientation alone, and the core is what all of them share.
TEST(ToolKernel, PartsAreTheVoxelsOfEachRoll) {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.02;
  for (const auto& [tool, rolls] : {std::pair{ToolGeometry::builtin("builtin:pruner"), 6},
                                    {test::boxTool({0.0f, -0.06f, -0.05f}, {0.4f, 0.07f, 0.31f}), 12},
                                    {ToolGeometry::builtin("builtin:pruner"), 2}}) {
    params.approach.orientations = OrientationSet::sphere(60);
    params.approach.rolls = rolls;
    const ToolKernel kernel = ToolKernel::make(tool, params);
    const std::vector<ToolOrientation> axes = params.approach.orientations.orientations(180);
    ASSERT_EQ(kernel.rolls.count, rolls);
    ASSERT_EQ(kernel.parts(), rolls + 1);
    ASSERT_EQ(kernel.view().parts, rolls + 1);
    ASSERT_EQ(kernel.view().rolls(), rolls);
    ASSERT_EQ(kernel.column_begin.size(), axes.size() * std::size_t(rolls + 1) + 1);
    std::size_t shared = 0, moved = 0;
    for (std::size_t d = 0; d < axes.size(); ++d) {
      std::vector<ToolOrientation> held;
      for (int roll = 0; roll < rolls; ++roll) held.push_back(rolledBy(axes[d], kernel.rolls, roll));
      FieldParams one_by_one = params;
      one_by_one.approach.orientations = OrientationSet::of(held);
      one_by_one.approach.rolls = 1;
      const ToolKernel alone = ToolKernel::make(tool, one_by_one);
      EXPECT_EQ(alone.collision_limit, kernel.collision_limit);
      EXPECT_EQ(kernel.voxel_count[d], alone.voxel_count[0]);
      const RollCells core = cellsOfPart(kernel, static_cast<int>(d) * (rolls + 1));
      RollCells in_all = cellsOfPart(alone, 0);
      for (int roll = 0; roll < rolls; ++roll) {
        const RollCells expected = cellsOfPart(alone, roll),
                        rest = cellsOfPart(kernel, static_cast<int>(d) * (rolls + 1) + 1 + roll);
        RollCells joined = core;
        for (const auto& cell : rest) ASSERT_TRUE(joined.insert(cell).second) << "counted twice";
        ASSERT_EQ(joined, expected) << "direction " << d << ", roll " << roll;
        std::erase_if(in_all, [&](const auto& cell) { return !expected.contains(cell); });
        for (const auto& [i, j, k] : expected) {
          ASSERT_TRUE(i >= kernel.min_ijk[0] && i <= kernel.max_ijk[0] && k >= kernel.min_ijk[2] &&
                      k <= kernel.max_ijk[2]);
        }
        moved += rest.size();
      }
      ASSERT_EQ(core, in_all) << "direction " << d;
      shared += core.size();
    }
    EXPECT_GT(shared, 200u);
    EXPECT_GT(moved, 200u);
  }
}

/// Rolls of yaw do not change the limit either.
TEST(ToolKernel, LimitsCollisionsByTheToolWithoutRoll) {
  const ToolGeometry tool = test::boxTool({0.0f, -0.01f, -0.05f}, {0.4f, 0.02f, 0.31f});
  FieldParams params;
  params.tsdf.voxel_size_m = 0.01;
  params.approach.num_directions = 12;
  const int of_yaw = ToolKernel::make(tool, params).collision_limit;
  params.approach.rolls = 12;
  EXPECT_EQ(ToolKernel::make(tool, params).collision_limit, of_yaw);
}

/// Every orientation once, and those of yaw where the limit is theirs.
TEST(ToolKernel, TellsHowFarItIs) {
  const ToolGeometry tool = test::boxTool({0.0f, -0.01f, -0.05f}, {0.4f, 0.02f, 0.31f});
  FieldParams params;
  params.tsdf.voxel_size_m = 0.02;
  params.approach.num_directions = 12;
  struct Case {
    OrientationSet set;
    int rolls, max_collisions;
    std::size_t orientations;
  };
  const Case cases[] = {{OrientationSet::yaw(), 1, 0, 12},
                        {OrientationSet::yaw(), 5, 0, 60},
                        {OrientationSet::sphere(90), 4, 0, 6 * 4 + 12},
                        {OrientationSet::sphere(90), 4, 7, 6 * 4}};
  for (const Case& c : cases) {
    params.approach.orientations = c.set;
    params.approach.rolls = c.rolls;
    params.scoring.max_collisions = c.max_collisions;
    std::size_t before = 0, calls = 0;
    std::atomic<bool> inside{false};
    const ToolKernel told = ToolKernel::make(tool, params, [&](std::size_t done, std::size_t total) {
      EXPECT_FALSE(inside.exchange(true)) << "one call at a time";
      EXPECT_GT(done, before);
      EXPECT_EQ(total, c.orientations);
      before = done;
      ++calls;
      inside = false;
    });
    EXPECT_EQ(before, c.orientations) << "the end is told";
    EXPECT_GT(calls, 1u);
    const ToolKernel untold = ToolKernel::make(tool, params);
    ASSERT_EQ(told.columns.size(), untold.columns.size());
    EXPECT_EQ(std::memcmp(told.columns.data(), untold.columns.data(), sizeof(told.columns[0]) * told.columns.size()),
              0);
  }
}

/// Also where threads come while another one tells.
TEST(OrientationCount, TellsOfTheEndFromManyThreads) {
  constexpr std::size_t kThreads = 8, kEach = 50;
  for (int round = 0; round < 20; ++round) {
    std::size_t before = 0;
    std::atomic<int> inside{0};
    const TableProgress slow = [&](std::size_t done, std::size_t total) {
      EXPECT_EQ(++inside, 1);
      EXPECT_GT(done, before);
      EXPECT_EQ(total, kThreads * kEach);
      before = done;
      std::this_thread::sleep_for(std::chrono::microseconds(50));
      --inside;
    };
    OrientationCount count(slow, kThreads * kEach);
    std::vector<std::thread> threads;
    for (std::size_t n = 0; n < kThreads; ++n) {
      threads.emplace_back([&] {
        for (std::size_t k = 0; k < kEach; ++k) count.addOne();
      });
    }
    for (std::thread& thread : threads) thread.join();
    EXPECT_EQ(before, kThreads * kEach);
  }
}

TEST(ToolKernel, EndsWithWhatTheProgressThrows) {
  const ToolGeometry tool = test::boxTool({0.0f, -0.01f, -0.05f}, {0.4f, 0.02f, 0.31f});
  FieldParams params;
  params.approach.orientations = OrientationSet::sphere(90);
  params.approach.rolls = 4;
  EXPECT_THROW((void)ToolKernel::make(tool, params, [](std::size_t, std::size_t) { throw std::runtime_error("stop"); }),
               std::runtime_error);
}

/// Samples have no core, and every roll its own.
TEST(ToolKernel, SamplesOfEveryRollAreTurned) {
  FieldParams params;
  params.scoring.form = ToolForm::SurfaceSamples;
  params.scoring.surface_samples = 60;
  params.approach.orientations = OrientationSet::sphere(90);
  params.approach.rolls = 4;
  const ToolGeometry tool = test::boxTool({0.1f, -0.06f, -0.05f}, {0.4f, 0.07f, 0.31f});
  const ToolKernel kernel = ToolKernel::make(tool, params);
  ASSERT_EQ(kernel.sample_begin.size(), 6u * 5 + 1);
  for (std::size_t d = 0; d < 6; ++d) {
    EXPECT_EQ(kernel.sample_begin[5 * d], kernel.sample_begin[5 * d + 1]);
    const Eigen::Matrix3d R_WT = params.approach.orientations.orientations(180)[d].R_WT;
    for (std::size_t roll = 0; roll < 4; ++roll) {
      const std::uint32_t first = kernel.sample_begin[5 * d + 1], begin = kernel.sample_begin[5 * d + 1 + roll];
      ASSERT_EQ(kernel.sample_begin[5 * d + 2 + roll] - begin, 60u);
      const Eigen::Matrix3d turn =
          R_WT * Eigen::AngleAxisd(std::numbers::pi / 2 * double(roll), Eigen::Vector3d::UnitX()) * R_WT.transpose();
      for (std::size_t n = 0; n < 60; ++n) {
        const auto at = [&](std::uint32_t from) {
          return Eigen::Map<const Eigen::Vector3f>(kernel.samples.data() + 3 * (from + n)).cast<double>();
        };
        ASSERT_LT((at(begin) - turn * at(first)).norm(), 1e-6);
      }
    }
  }
}

TEST(ToolKernel, SaysThatFewerRollsWouldFit) {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.0007;
  params.approach.orientations = OrientationSet::sphere(12.5);
  params.approach.rolls = 12;
  try {
    static_cast<void>(ToolKernel::make(ToolGeometry::builtin("builtin:pruner"), params));
    FAIL();
  } catch (const ResourceLimit& error) {
    EXPECT_EQ(error.id(), "tool.columns");
    const std::string text = error.what();
    EXPECT_NE(text.find("STEP"), std::string::npos) << text;
    EXPECT_NE(text.find("ApproachParams::rolls"), std::string::npos) << text;
  }
}

}  // namespace
}  // namespace accessvdb::internal

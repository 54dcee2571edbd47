// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Broken meshes: whatever is missing of a closed tool, its voxels stay. The oracle is the closed mesh.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numbers>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/tool_tables.h"
#include "test_meshes.h"
#include "tool/builtin_tools.h"
#include "tool/tool_rolls.h"
#include "tool/tool_solid.h"
#include "tool/voxel_runs.h"
#include "tool/voxelize.h"

namespace accessvdb {
namespace {

using internal::VoxelRun;

test::Mesh builtin(const std::string& name) {
  internal::BuiltinMesh mesh = internal::builtinMesh(name);
  return {std::move(mesh.vertices_T), std::move(mesh.triangles)};
}

test::Mesh cone(double length, double radius, int sides) {
  test::Mesh m;
  m.vertices = {{0, 0, 0}, {float(length), 0, 0}};
  for (int n = 0; n < sides; ++n) {
    const double a = 2 * std::numbers::pi * n / sides;
    m.vertices.emplace_back(float(length), float(radius * std::cos(a)), float(radius * std::sin(a)));
  }
  for (std::uint32_t n = 0; n < std::uint32_t(sides); ++n) {
    const std::uint32_t here = 2 + n, next = 2 + (n + 1) % std::uint32_t(sides);
    m.triangles.push_back({0, next, here});
    m.triangles.push_back({1, here, next});
  }
  return m;
}

/// A bar along x that turns up at its far end: an L, its faces in a grid so that there is something to lose.
test::Mesh hook() {
  test::Mesh m;
  const float arm = 0.4f, thick = 0.1f, rise = 0.3f;
  const std::vector<Eigen::Vector2f> outline = {
      {0, 0},        {0.2f, 0},          {arm, 0},           {arm, 0.2f},
      {arm, rise},   {arm - 0.1f, rise}, {arm - 0.1f, 0.2f}, {arm - 0.1f, thick},
      {0.2f, thick}, {0, thick}};
  const auto count = std::uint32_t(outline.size());
  for (const float y : {-0.06f, 0.06f}) {
    for (const Eigen::Vector2f& p : outline) m.vertices.emplace_back(p.x(), y, p.y());
  }
  for (std::uint32_t n = 0; n < count; ++n) {
    const std::uint32_t next = (n + 1) % count;
    m.triangles.push_back({n, next, count + next});
    m.triangles.push_back({n, count + next, count + n});
  }
  const std::vector<std::array<std::uint32_t, 3>> side = {{0, 1, 8}, {0, 8, 9}, {1, 2, 7}, {1, 7, 8},
                                                          {2, 3, 6}, {2, 6, 7}, {3, 4, 5}, {3, 5, 6}};
  for (const auto& t : side) {
    m.triangles.push_back({t[0], t[2], t[1]});
    m.triangles.push_back({count + t[0], count + t[1], count + t[2]});
  }
  return m;
}

struct Named {
  std::string name;
  test::Mesh mesh;
  double voxel_m;
};

std::vector<Named> closedTools() {
  test::Mesh two = test::box({0, -0.05f, -0.05f}, {0.3f, 0.05f, 0.05f});
  two.add(test::box({0.25f, -0.1f, -0.08f}, {0.5f, 0.1f, 0.12f}));
  return {{"pencil", builtin("builtin:pencil"), 0.004},
          {"pruner", builtin("builtin:pruner"), 0.03},
          {"box", two, 0.025},
          {"cone", cone(0.5, 0.15, 24), 0.025},
          {"ring", test::torus({0.3f, 0, 0}, 0.2, 0.08, 24, 12), 0.025},
          {"hook", hook(), 0.025}};
}

ToolGeometry toolOf(const test::Mesh& mesh) { return ToolGeometry::fromTriangles(mesh.vertices, mesh.triangles, "t"); }

std::vector<VoxelRun> voxelsOf(const ToolGeometry& tool, const Eigen::Matrix3d& R, double voxel_m) {
  std::vector<Eigen::Vector3d> vertices;
  for (const Eigen::Vector3f& p : tool.vertices_T()) vertices.emplace_back(R * p.cast<double>() / voxel_m);
  return internal::ToolSolid(tool).voxels(vertices, voxel_m, -1).runs;
}

/// Of the closed mesh, as they were before there were openings.
std::vector<VoxelRun> truthOf(const test::Mesh& mesh, const Eigen::Matrix3d& R, double voxel_m) {
  std::vector<Eigen::Vector3d> vertices;
  for (const Eigen::Vector3f& p : mesh.vertices) vertices.emplace_back(R * p.cast<double>() / voxel_m);
  return internal::voxelize(vertices, mesh.triangles, true);
}

using Random = std::mt19937_64;
std::size_t below(Random& random, std::size_t count) { return std::size_t(random() % count); }
double unit(Random& random) { return double(random() >> 11) * 0x1p-53; }

/// Three vertices for each triangle, as in an STL.
test::Mesh soupOf(const test::Mesh& mesh) {
  test::Mesh soup;
  for (const auto& t : mesh.triangles) {
    const auto base = std::uint32_t(soup.vertices.size());
    for (std::uint32_t v : t) soup.vertices.push_back(mesh.vertices[v]);
    soup.triangles.push_back({base, base + 1, base + 2});
  }
  return soup;
}

/// One to three kinds of damage at once. @return also what was done
std::pair<test::Mesh, std::string> damaged(const test::Mesh& mesh, Random& random) {
  test::Mesh m = soupOf(mesh);
  std::string what;
  const std::size_t kinds = 1 + below(random, 63);
  if (kinds & 1) {
    const std::size_t removed = 1 + below(random, 3);
    for (std::size_t n = 0; n < removed; ++n) {
      m.triangles.erase(m.triangles.begin() + std::ptrdiff_t(below(random, m.triangles.size())));
    }
    what += " removed " + std::to_string(removed);
  }
  if (kinds & 2) {
    // Corners of some triangles move by up to 0.2 mm.
    const std::size_t torn = 1 + below(random, 4);
    for (std::size_t n = 0; n < torn; ++n) {
      for (const std::uint32_t v : m.triangles[below(random, m.triangles.size())]) {
        m.vertices[v] +=
            2e-4f * Eigen::Vector3d(unit(random) - 0.5, unit(random) - 0.5, unit(random) - 0.5).cast<float>();
      }
    }
    what += " torn " + std::to_string(torn);
  }
  const bool round = mesh.triangles.size() > 500;  // the ring: one surface, with many corners that are nearly flat
  if (kinds & 16 && below(random, 2) == 0) {
    // A part that was put on with a seam all around, or every triangle for itself.
    const Eigen::Vector3f gap =
        2e-4f * Eigen::Vector3d(unit(random) - 0.5, unit(random) - 0.5, unit(random) - 0.5).cast<float>();
    const bool each = !round || below(random, 2) == 0;
    // Past its middle: what has moved as a whole is not broken.
    const float part_x =
        0.6f * std::max_element(mesh.vertices.begin(), mesh.vertices.end(), [](const auto& a, const auto& b) {
                 return a.x() < b.x();
               })->x();
    for (const auto& t : m.triangles) {
      const Eigen::Vector3f centre = (m.vertices[t[0]] + m.vertices[t[1]] + m.vertices[t[2]]) / 3;
      for (const std::uint32_t v : t) {
        if (each) m.vertices[v] += 1e-4f * (centre - m.vertices[v]).normalized();
        if (!each && centre.x() > part_x) m.vertices[v] += gap;
      }
    }
    what += each ? " shrunk" : " seam";
  }
  if (kinds & 32 && round) {
    // All around a corner.
    const Eigen::Vector3f corner = m.vertices[m.triangles[below(random, m.triangles.size())][0]];
    std::erase_if(m.triangles, [&](const auto& t) {
      return std::any_of(t.begin(), t.end(), [&](std::uint32_t v) { return m.vertices[v] == corner; });
    });
    what += " corner";
  }
  if (kinds & 4) {
    for (std::size_t n = 0; n < 3; ++n) m.triangles.push_back(m.triangles[below(random, m.triangles.size())]);
    what += " doubled";
  }
  if (kinds & 8) {
    for (std::size_t n = 0; n < 3; ++n) {
      auto t = m.triangles[below(random, m.triangles.size())];
      std::swap(t[1], t[2]);
      if (n == 0) {
        m.triangles.push_back(t);  // beside the one that faces outwards
      } else {
        auto& flipped = m.triangles[below(random, m.triangles.size())];
        std::swap(flipped[1], flipped[2]);
      }
    }
    what += " flipped";
  }
  return {m, what};
}

Eigen::Matrix3d randomRotation(Random& random) {
  return Eigen::Quaterniond(unit(random) - 0.5, unit(random) - 0.5, unit(random) - 0.5, unit(random) - 0.5)
      .normalized()
      .toRotationMatrix();
}

TEST(OpenTools, VoxelsContainThoseOfTheClosedToolWhateverTheDamage) {
  Random random(7);
  const std::vector<Named> tools = closedTools();
  int open = 0, wide = 0;
  std::vector<double> grown;
  for (int trial = 0; trial < 200; ++trial) {
    const Named& closed = tools[std::size_t(trial) % tools.size()];
    const auto [mesh, what] = damaged(closed.mesh, random);
    const ToolGeometry tool = toolOf(mesh);
    const bool loses = what != " doubled" && what != " flipped" && what != " doubled flipped" && !what.empty();
    EXPECT_EQ(openingWidth_m(tool) > 0, loses) << trial << " " << closed.name << what;
    open += openingWidth_m(tool) > 0;
    if (isWideOpen(tool)) {  // refused
      ++wide;
      continue;
    }
    for (int turn = 0; turn < 3; ++turn) {
      const Eigen::Matrix3d R = turn == 0 ? Eigen::Matrix3d(Eigen::Matrix3d::Identity()) : randomRotation(random);
      const double voxel_m = closed.voxel_m * (turn == 1 ? 1 : 0.5 + unit(random));
      const std::vector<VoxelRun> truth = truthOf(closed.mesh, R, voxel_m), found = voxelsOf(tool, R, voxel_m);
      const std::vector<VoxelRun> lost = internal::voxelsWithout(truth, found);
      EXPECT_EQ(internal::countVoxels(lost), 0u)
          << trial << " " << closed.name << what << " of " << internal::countVoxels(truth) << ", width "
          << openingWidth_m(tool) << ", turn " << turn << ", voxel " << voxel_m;
      grown.push_back(double(internal::countVoxels(found)) / double(internal::countVoxels(truth)));
    }
  }
  std::sort(grown.begin(), grown.end());
  EXPECT_GT(open, 100);
  EXPECT_LT(wide, 50);
  EXPECT_LT(grown[grown.size() / 2], 1.1);
}

TEST(OpenTools, ClosedToolsHaveTheVoxelsOfBefore) {
  Random random(3);
  for (const Named& closed : closedTools()) {
    const ToolGeometry tool = toolOf(closed.mesh);
    ASSERT_TRUE(tool.watertight()) << closed.name;
    EXPECT_EQ(openingWidth_m(tool), 0) << closed.name;
    const Eigen::Matrix3d R = randomRotation(random);
    std::vector<Eigen::Vector3d> vertices;
    for (const Eigen::Vector3f& p : tool.vertices_T()) vertices.emplace_back(R * p.cast<double>() / closed.voxel_m);
    const std::vector<VoxelRun> truth = internal::voxelize(vertices, tool.triangles(), true);
    const internal::SolidVoxels found = internal::ToolSolid(tool).voxels(vertices, closed.voxel_m, -1);
    EXPECT_EQ(internal::countVoxels(internal::voxelsWithout(truth, found.runs)), 0u) << closed.name;
    EXPECT_EQ(internal::countVoxels(found.runs), internal::countVoxels(truth)) << closed.name;
    EXPECT_EQ(found.counted, internal::countVoxels(truth)) << closed.name;
  }
}

TEST(OpenTools, ClosingNeverLetsAToolTouchMore) {
  Random random(11);
  const std::vector<Named> tools = closedTools();
  for (int trial = 0; trial < 100; ++trial) {
    const Named& closed = tools[std::size_t(trial) % tools.size()];
    const auto [mesh, what] = damaged(closed.mesh, random);
    const ToolGeometry tool = toolOf(mesh);
    if (isWideOpen(tool)) continue;
    const Eigen::Matrix3d R = randomRotation(random);
    std::vector<Eigen::Vector3d> vertices;
    for (const Eigen::Vector3f& p : tool.vertices_T()) vertices.emplace_back(R * p.cast<double>() / closed.voxel_m);
    EXPECT_LE(internal::ToolSolid(tool).voxels(vertices, closed.voxel_m, -1).counted,
              internal::countVoxels(truthOf(closed.mesh, R, closed.voxel_m)))
        << trial << " " << closed.name << what;
  }
}

TEST(OpenTools, ASurfaceWithTwoSidesHasAnInsideToo) {
  for (const Named& closed : closedTools()) {
    test::Mesh both = closed.mesh;
    for (const auto& t : closed.mesh.triangles) both.triangles.push_back({t[0], t[2], t[1]});
    const ToolGeometry tool = toolOf(both);
    EXPECT_TRUE(tool.watertight()) << closed.name;
    const Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
    EXPECT_EQ(internal::countVoxels(voxelsOf(tool, R, closed.voxel_m)),
              internal::countVoxels(truthOf(closed.mesh, R, closed.voxel_m)))
        << closed.name;
  }
}

TEST(OpenTools, AnOpeningIsAsWideAsTheBallThatFitsThrough) {
  // A face of 0.2 by 0.2 m is missing: the ball that touches all four edges.
  test::Mesh open = test::box({0, -0.1f, -0.1f}, {1, 0.1f, 0.1f});
  std::erase_if(open.triangles, [&](const auto& t) {
    return std::all_of(t.begin(), t.end(), [&](std::uint32_t v) { return open.vertices[v].x() == 1; });
  });
  ASSERT_EQ(open.triangles.size(), 10u);
  EXPECT_NEAR(openingWidth_m(toolOf(open)), 0.2, 0.01);
  EXPECT_FALSE(isWideOpen(toolOf(open)));
  // Of a box half as long it is too wide to guess what was there.
  for (Eigen::Vector3f& p : open.vertices) p.x() *= 0.5f;
  EXPECT_TRUE(isWideOpen(toolOf(open)));
  // A cut all around is as wide as the cut, not as the tool.
  test::Mesh cut = test::torus({0.3f, 0, 0}, 0.2, 0.08, 24, 12);
  std::erase_if(cut.triangles, [&](const auto& t) { return t[0] / 12 == 5; });
  const double width_m = openingWidth_m(toolOf(cut));
  EXPECT_GT(width_m, 2 * 0.2 * std::numbers::pi / 24 * 0.6);
  EXPECT_LT(width_m, 2 * 0.2 * std::numbers::pi / 24 * 1.7);
}

TEST(OpenTools, ASheetIsWideOpen) {
  test::Mesh sheet;
  sheet.vertices = {{0, 0, 0}, {0.5f, 0, 0}, {0.5f, 0.4f, 0}, {0, 0.4f, 0}};
  sheet.triangles = {{0, 1, 2}, {0, 2, 3}};
  EXPECT_TRUE(isWideOpen(toolOf(sheet)));
}

/// As some programs write them: each triangle with corners of its own, a little apart. Where many meet, some are much
/// nearer to each other than to the rest.
TEST(OpenTools, FacesThatAreNowhereWeldedAreNotRefused) {
  std::mt19937_64 random(3);
  for (const test::Mesh& whole : {cone(0.4, 0.1, 12), hook(), builtin("builtin:pruner")}) {
    for (const double apart_m : {1e-6, 1e-5}) {
      for (int n = 0; n < 8; ++n) {
        std::uniform_real_distribution<double> jitter(-apart_m, apart_m);
        test::Mesh torn;
        for (const auto& t : whole.triangles) {
          for (const std::uint32_t v : t) {
            const Eigen::Vector3d moved(jitter(random), jitter(random), jitter(random));
            torn.vertices.push_back(whole.vertices[v] + moved.cast<float>());
          }
          const auto last = std::uint32_t(torn.vertices.size());
          torn.triangles.push_back({last - 3, last - 2, last - 1});
        }
        const ToolGeometry tool = ToolGeometry::fromTriangles(torn.vertices, torn.triangles, "torn");
        EXPECT_GT(openingWidth_m(tool), 0) << apart_m;
        EXPECT_FALSE(isWideOpen(tool)) << apart_m << " " << openingWidth_m(tool);
      }
    }
  }
}

}  // namespace
}  // namespace accessvdb

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Voxels against two independent answers: exact box-against-cube separation, and for any mesh the thirteen-axis
/// triangle/cube test of every cell with the solid angle for its inside.
#include "tool/voxelize.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <random>
#include <set>
#include <tuple>
#include <utility>

#include "test_meshes.h"
#include "tool/mesh_repair.h"
#include "tool/yaw_direction.h"

namespace accessvdb::internal {
namespace {

using Cell = std::tuple<int, int, int>;
using Cells = std::set<Cell>;

Cells cellsOf(const std::vector<VoxelRun>& runs) {
  Cells cells;
  for (const VoxelRun& run : runs) {
    for (int k = run.lo; k <= run.hi; ++k) {
      EXPECT_TRUE(cells.insert({run.i, run.j, k}).second) << "a voxel is listed twice";
    }
  }
  return cells;
}

Cells cellsOf(const std::vector<kernels::VoxelColumn>& columns) {
  Cells cells;
  for (const kernels::VoxelColumn& column : columns) {
    for (int bit = 0; bit < 64; ++bit) {
      if (!(column.bits >> bit & 1)) continue;
      EXPECT_TRUE(cells.insert({column.dx, column.dy, column.dz + bit}).second) << "a voxel is listed twice";
    }
  }
  return cells;
}

std::vector<Eigen::Vector3d> placed(const test::Mesh& mesh, double yaw_rad, double scale = 1) {
  std::vector<Eigen::Vector3d> out;
  const Eigen::AngleAxisd R(yaw_rad, Eigen::Vector3d::UnitZ());
  for (const auto& p : mesh.vertices) out.push_back(R * (scale * p.cast<double>()));
  return out;
}

/// Triangle against closed unit cube: the three axes, the normal, and nine cross products of edges.
bool touches(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c, const Cell& cell) {
  const Eigen::Vector3d centre(std::get<0>(cell), std::get<1>(cell), std::get<2>(cell));
  const std::array<Eigen::Vector3d, 3> p = {a - centre, b - centre, c - centre};
  std::vector<Eigen::Vector3d> axes = {Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitY(), Eigen::Vector3d::UnitZ(),
                                       (p[1] - p[0]).cross(p[2] - p[0])};
  for (int e = 0; e < 3; ++e) {
    for (int axis = 0; axis < 3; ++axis) axes.push_back((p[(e + 1) % 3] - p[e]).cross(Eigen::Vector3d::Unit(axis)));
  }
  return std::none_of(axes.begin(), axes.end(), [&](const Eigen::Vector3d& axis) {
    const double half = 0.5 * axis.lpNorm<1>();
    const double low = std::min({axis.dot(p[0]), axis.dot(p[1]), axis.dot(p[2])});
    const double high = std::max({axis.dot(p[0]), axis.dot(p[1]), axis.dot(p[2])});
    return low > half || high < -half;
  });
}

/// Winding number by solid angles (Van Oosterom and Strackee).
int windingNumber(const std::vector<Eigen::Vector3d>& v, const std::vector<std::array<std::uint32_t, 3>>& triangles,
                  const Eigen::Vector3d& at) {
  double angle = 0;
  for (const auto& t : triangles) {
    const Eigen::Vector3d a = v[t[0]] - at, b = v[t[1]] - at, c = v[t[2]] - at;
    const double na = a.norm(), nb = b.norm(), nc = c.norm();
    angle += 2 * std::atan2(a.dot(b.cross(c)), na * nb * nc + a.dot(b) * nc + b.dot(c) * na + c.dot(a) * nb);
  }
  return int(std::lround(angle / (4 * std::numbers::pi)));
}

Cells bruteForce(const std::vector<Eigen::Vector3d>& v, const std::vector<std::array<std::uint32_t, 3>>& triangles,
                 bool solid) {
  Eigen::AlignedBox3d all;
  for (const auto& p : v) all.extend(p);
  Cells cells;
  for (int i = int(all.min().x()) - 2; i <= all.max().x() + 2; ++i) {
    for (int j = int(all.min().y()) - 2; j <= all.max().y() + 2; ++j) {
      for (int k = int(all.min().z()) - 2; k <= all.max().z() + 2; ++k) {
        const bool touched = std::any_of(triangles.begin(), triangles.end(), [&](const auto& t) {
          return touches(v[t[0]], v[t[1]], v[t[2]], {i, j, k});
        });
        if (touched || (solid && windingNumber(v, triangles, {double(i), double(j), double(k)}) != 0)) {
          cells.insert({i, j, k});
        }
      }
    }
  }
  return cells;
}

TEST(Voxelize, AlignedBoxHasTheCountThatArithmeticGives) {
  // From 0.25 to 7.75: cells 0..8; from -3.2 to 2.6: cells -3..3; from 0.6 to 0.9: cell 1.
  const test::Mesh mesh = test::box({0.25f, -3.2f, 0.6f}, {7.75f, 2.6f, 0.9f});
  EXPECT_EQ(countVoxels(voxelize(placed(mesh, 0), mesh.triangles, true)), 9u * 7u * 1u);
  // Cells are closed: faces on their boundary belong to both sides. 0.5 to 3.5 touches 0..4.
  const test::Mesh on_boundary = test::box({0.5f, 0.5f, 0.5f}, {3.5f, 3.5f, 3.5f});
  EXPECT_EQ(countVoxels(voxelize(placed(on_boundary, 0), on_boundary.triangles, true)), 125u);
  // Without an inside, a shell is left: 5^3 minus the one cell (2,2,2) that no face touches.
  EXPECT_EQ(countVoxels(voxelize(placed(on_boundary, 0), on_boundary.triangles, false)), 124u);
}

TEST(Voxelize, RotatedBoxIsEveryCubeThatMeetsIt) {
  const Eigen::Vector3f low(-1.3f, -7.1f, -2.2f), high(20.4f, 4.9f, 9.7f);
  const test::Mesh mesh = test::box(low, high);
  for (int d = 0; d < 36; ++d) {
    const CosSin yaw = yawDirection(d, 36);
    std::vector<Eigen::Vector3d> v;
    for (const auto& p : mesh.vertices) {
      v.emplace_back(yaw.cos * p.x() - yaw.sin * p.y(), yaw.sin * p.x() + yaw.cos * p.y(), p.z());
    }
    // A cube meets the solid box exactly if their z ranges meet and no edge direction of either square separates
    // their outlines from above.
    const Eigen::Vector2d ex(yaw.cos, yaw.sin), ey(-yaw.sin, yaw.cos);
    const Eigen::Vector2d middle = 0.5 * ((double(low.x()) + high.x()) * ex + (double(low.y()) + high.y()) * ey);
    const double hx = 0.5 * (double(high.x()) - low.x()), hy = 0.5 * (double(high.y()) - low.y());
    Cells expected;
    for (int i = -30; i <= 30; ++i) {
      for (int j = -30; j <= 30; ++j) {
        const Eigen::Vector2d to = Eigen::Vector2d(i, j) - middle;
        bool apart = false;
        for (const Eigen::Vector2d& axis : {Eigen::Vector2d(1, 0), Eigen::Vector2d(0, 1), ex, ey}) {
          apart = apart || std::abs(to.dot(axis)) >
                               hx * std::abs(ex.dot(axis)) + hy * std::abs(ey.dot(axis)) + 0.5 * axis.lpNorm<1>();
        }
        for (int k = -10; k <= 15 && !apart; ++k) {
          if (k + 0.5 >= low.z() && k - 0.5 <= high.z()) expected.insert({i, j, k});
        }
      }
    }
    EXPECT_EQ(cellsOf(voxelize(v, mesh.triangles, true)), expected) << "direction " << d;
  }
}

TEST(Voxelize, AnyMeshEqualsTheTestOfEveryCell) {
  test::Mesh sphere = test::torus({2.3f, -1.1f, 0.4f}, 0.02, 5.3, 14, 11);  // a spindle: it runs through itself
  test::Mesh ring = test::torus({-1.2f, 0.7f, 2.2f}, 6.1, 2.2, 17, 9);
  test::Mesh overlapping = test::box({-4.1f, -3.3f, -2.7f}, {3.2f, 2.6f, 4.4f});
  overlapping.add(test::box({-0.6f, -5.2f, -1.4f}, {7.3f, 0.8f, 1.9f}));
  overlapping.add(test::torus({0.2f, 0.1f, 0.3f}, 4.2, 1.3, 12, 7));
  test::Mesh sliver = test::box({-6.03f, -0.04f, -0.03f}, {6.2f, 0.05f, 0.02f});
  for (const test::Mesh* mesh : {&sphere, &ring, &overlapping, &sliver}) {
    const RepairedMesh repaired = repairMesh(mesh->vertices, mesh->triangles);
    ASSERT_TRUE(repaired.watertight);
    for (double yaw_rad : {0.0, 2.5}) {
      const auto v = placed({repaired.vertices, repaired.triangles}, yaw_rad);
      for (bool solid : {false, true}) {
        EXPECT_EQ(cellsOf(voxelize(v, repaired.triangles, solid)), bruteForce(v, repaired.triangles, solid))
            << "mesh of " << repaired.triangles.size() << " triangles, yaw " << yaw_rad << ", solid " << solid;
      }
    }
  }
}

/// Each triangle's cells by themselves, for meshes with many small ones.
Cells bruteForceByTriangle(const std::vector<Eigen::Vector3d>& v,
                           const std::vector<std::array<std::uint32_t, 3>>& triangles, bool solid) {
  Eigen::AlignedBox3d all;
  Cells cells;
  for (const auto& t : triangles) {
    Eigen::AlignedBox3d own;
    for (const std::uint32_t n : t) own.extend(v[n]);
    all.extend(own);
    const Eigen::Vector3i low = own.min().array().floor().cast<int>() - 1,
                          high = own.max().array().ceil().cast<int>() + 1;
    for (int i = low.x(); i <= high.x(); ++i) {
      for (int j = low.y(); j <= high.y(); ++j) {
        for (int k = low.z(); k <= high.z(); ++k) {
          if (touches(v[t[0]], v[t[1]], v[t[2]], {i, j, k})) cells.insert({i, j, k});
        }
      }
    }
  }
  for (int i = int(all.min().x()); solid && i <= all.max().x(); ++i) {
    for (int j = int(all.min().y()); j <= all.max().y(); ++j) {
      for (int k = int(all.min().z()); k <= all.max().z(); ++k) {
        if (cells.count({i, j, k}) > 0) continue;
        if (windingNumber(v, triangles, {double(i), double(j), double(k)}) != 0) cells.insert({i, j, k});
      }
    }
  }
  return cells;
}

/// Most triangles of such meshes touch nothing new, and are passed over: never one that does.
TEST(Voxelize, FineMeshesEqualTheTestOfEveryCellInAnyOrientation) {
  std::mt19937 random(4);
  std::uniform_real_distribution<float> off(-0.4f, 0.4f);
  const test::Mesh smooth = test::torus({0.3f, -0.2f, 0.1f}, 3.1, 1.3, 50, 30);
  test::Mesh crumpled = smooth;  // closed still, with creases and folds everywhere
  for (auto& p : crumpled.vertices) p += Eigen::Vector3f(off(random), off(random), off(random));
  test::Mesh half = test::torus({0.3f, -0.2f, 0.1f}, 2.2, 0.9, 160, 90);
  half.triangles.resize(half.triangles.size() / 2);
  for (const test::Mesh* mesh : {&smooth, &std::as_const(crumpled), &std::as_const(half)}) {
    for (const double turn_rad : {0.0, 1.1, 2.9}) {
      std::vector<Eigen::Vector3d> v;
      const Eigen::AngleAxisd R(turn_rad, Eigen::Vector3d(0.4, -1.2, turn_rad).normalized());
      for (const auto& p : mesh->vertices) v.push_back(R * p.cast<double>());
      const bool closed = mesh != &half;
      for (const bool solid : {false, true}) {
        if (solid && !closed) continue;
        EXPECT_EQ(cellsOf(voxelize(v, mesh->triangles, solid)), bruteForceByTriangle(v, mesh->triangles, solid))
            << "mesh of " << mesh->triangles.size() << " triangles, turn " << turn_rad << ", solid " << solid;
      }
    }
  }
}

/// Meshes are collected as bits where their box is small, as runs otherwise: by each as by the other.
TEST(Voxelize, LargeBoxesHoldTheSameVoxels) {
  const test::Mesh near = test::torus({0.3f, -0.2f, 0.1f}, 9.1, 3.3, 60, 40),
                   far = test::box({700, 700, 700}, {704, 704, 704});
  test::Mesh both = near;
  both.add(far);
  for (const bool solid : {false, true}) {
    Cells apart = cellsOf(voxelize(placed(near, 0.7), near.triangles, solid));
    EXPECT_GT(apart.size(), 1000u);
    apart.merge(cellsOf(voxelize(placed(far, 0.7), far.triangles, solid)));
    EXPECT_EQ(cellsOf(voxelize(placed(both, 0.7), both.triangles, solid)), apart);
  }
}

TEST(Voxelize, CentresOnVertexColumnsAndEdgesAreCountedOnce) {
  // Octahedron whose apexes, edges and diagonals are all on cell centres: the worst case for a vertical ray.
  test::Mesh mesh;
  mesh.vertices = {{9, 0, 0}, {-9, 0, 0}, {0, 9, 0}, {0, -9, 0}, {0, 0, 9}, {0, 0, -9}};
  mesh.triangles = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
  const Cells cells = cellsOf(voxelize(placed(mesh, 0), mesh.triangles, true));
  for (int i = -12; i <= 12; ++i) {
    for (int j = -12; j <= 12; ++j) {
      for (int k = -12; k <= 12; ++k) {
        // |x|+|y|+|z| <= 9 meets the cube exactly if its nearest point does.
        const double nearest =
            std::max(0.0, std::abs(i) - 0.5) + std::max(0.0, std::abs(j) - 0.5) + std::max(0.0, std::abs(k) - 0.5);
        EXPECT_EQ(cells.count({i, j, k}) == 1, nearest <= 9) << i << " " << j << " " << k;
      }
    }
  }
}

TEST(PackColumns, HoldsTheSameVoxelsInOrder) {
  const std::vector<VoxelRun> runs = {{-3, 5, -70, 130}, {-3, 6, 0, 0},   {-3, 6, 2, 5},   {-3, 6, 62, 66},
                                      {-3, 6, 200, 200}, {0, -1, -1, 62}, {0, -1, 64, 64}, {2, 2, -30000, -29990},
                                      {2, 3, 0, 0},      {2, 3, 63, 63}};
  const std::vector<kernels::VoxelColumn> columns = packColumns(runs);
  EXPECT_EQ(cellsOf(columns), cellsOf(runs));
  for (std::size_t n = 0; n < columns.size(); ++n) {
    EXPECT_EQ(columns[n].bits & 1u, 1u) << "a column begins at its lowest voxel";
    EXPECT_EQ(columns[n].unused, 0);
    if (n == 0) continue;
    const auto &a = columns[n - 1], &b = columns[n];
    EXPECT_LT(std::tie(a.dx, a.dy, a.dz), std::tie(b.dx, b.dy, b.dz));
    if (a.dx != b.dx || a.dy != b.dy) continue;
    EXPECT_GE(b.dz, a.dz + 64) << "columns of one place must not overlap";
  }
  EXPECT_EQ(columns.size(), 4u + 3u + 2u + 1u + 1u);
}

TEST(RemoveBall, TakesExactlyTheCentresWithinTheRadius) {
  for (double radius : {0.0, 1.0, 2.5, 3.0, 5.99}) {
    std::vector<VoxelRun> runs;
    for (int i = -7; i <= 7; ++i) {
      for (int j = -7; j <= 7; ++j) {
        runs.push_back({i, j, -7, -2});
        runs.push_back({i, j, 0, 7});
      }
    }
    const Cells before = cellsOf(runs);
    const std::uint64_t removed = removeBall(runs, radius);
    Cells expected;
    for (const auto& [i, j, k] : before) {
      if (!(i * i + j * j + k * k <= radius * radius)) expected.insert({i, j, k});
    }
    EXPECT_EQ(cellsOf(runs), expected) << radius;
    EXPECT_EQ(removed, before.size() - expected.size()) << radius;
  }
}

}  // namespace
}  // namespace accessvdb::internal

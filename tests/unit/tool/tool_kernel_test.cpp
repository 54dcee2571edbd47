// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/tool_kernel.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <set>
#include <tuple>

#include "accessvdb/error.h"
#include "support/box_tool.h"
#include "test_meshes.h"

namespace accessvdb::internal {
namespace {

using Cells = std::set<std::tuple<int, int, int>>;

Cells cellsAt(const ToolKernel& kernel, int d) {
  Cells cells;
  for (std::uint32_t n = kernel.column_begin[d]; n < kernel.column_begin[d + 1]; ++n) {
    const kernels::VoxelColumn& column = kernel.columns[n];
    for (int bit = 0; bit < 64; ++bit) {
      if (column.bits >> bit & 1) cells.insert({column.dx, column.dy, column.dz + bit});
    }
  }
  return cells;
}

FieldParams paramsFor(double voxel_size_m, double self_exclusion_voxels = 3, int num_directions = 180) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_size_m;
  params.scoring.self_exclusion_voxels = self_exclusion_voxels;
  params.approach.num_directions = num_directions;
  return params;
}

ToolGeometry toolOf(const test::Mesh& mesh) { return ToolGeometry::fromTriangles(mesh.vertices, mesh.triangles, "t"); }

TEST(DirectionTable, IsTheUnitCircleAndExactOnTheAxes) {
  for (int D : {4, 7, 36, 180, 256}) {
    const kernels::DirectionTable table = ExpandedOrientations::of(paramsFor(0.01, 3, D).approach).table();
    ASSERT_EQ(table.xy.size(), std::size_t(2 * D));
    for (int d = 0; d < D; ++d) {
      const long double yaw = 2 * std::numbers::pi_v<long double> * d / D;
      // Half a unit in the last place of float32 near 1, plus the error of double before rounding.
      EXPECT_NEAR(table.xy[2 * d], double(std::cos(yaw)), 3.1e-8) << d << " of " << D;
      EXPECT_NEAR(table.xy[2 * d + 1], double(std::sin(yaw)), 3.1e-8) << d << " of " << D;
    }
    if (D % 4 != 0) continue;
    for (int d = 0; d < D; ++d) {
      const int turned = (d + D / 4) % D;
      EXPECT_EQ(table.xy[2 * turned], -table.xy[2 * d + 1]);
      EXPECT_EQ(table.xy[2 * turned + 1], table.xy[2 * d]);
    }
  }
}

TEST(ToolKernel, QuarterTurnIsExact) {
  const ToolKernel kernel = ToolKernel::make(ToolGeometry::builtin("builtin:pruner"), paramsFor(0.02));
  for (int d : {0, 7, 45, 90, 111}) {
    Cells turned;
    for (const auto& [i, j, k] : cellsAt(kernel, d)) turned.insert({-j, i, k});
    EXPECT_EQ(cellsAt(kernel, (d + 45) % 180), turned) << d;
  }
}

/// Tilted and rolled, against the box that the tool is: voxels whose centre is inside by half a diagonal are there, and
/// none that is outside by that.
TEST(ToolKernel, IsTurnedByEveryOrientation) {
  const Eigen::Vector3d low(0.02, -0.03, -0.05), high(0.31, 0.05, 0.08);
  const ToolGeometry tool = test::boxTool(low.cast<float>(), high.cast<float>());
  FieldParams params = paramsFor(0.01, -1, 36);
  std::vector<ToolOrientation> list;
  for (int n = 0; n < 40; ++n) list.push_back(orientationOf(77.0 * n, 90 * std::sin(3.0 * n), 31.0 * n));
  for (const OrientationSet& set : {OrientationSet::sphere(30), OrientationSet::of(list)}) {
    params.approach.orientations = set;
    params.approach.rolls = 1;
    const ToolKernel kernel = ToolKernel::make(tool, params);
    const auto orientations = set.orientations(36);
    ASSERT_EQ(kernel.num_directions, static_cast<int>(orientations.size()));
    ASSERT_EQ(kernel.column_begin.size(), orientations.size() + 1);
    constexpr double kHalfDiagonal = 0.8661;
    for (std::size_t d = 0; d < orientations.size(); ++d) {
      const Cells cells = cellsAt(kernel, static_cast<int>(d));
      std::size_t inside = 0;
      for (int i = -36; i <= 36; ++i) {
        for (int j = -36; j <= 36; ++j) {
          for (int k = -36; k <= 36; ++k) {
            const Eigen::Vector3d p_T = orientations[d].R_WT.transpose() * Eigen::Vector3d(i, j, k);
            const double margin = std::min((p_T - low * 100).minCoeff(), (high * 100 - p_T).minCoeff());
            if (margin > kHalfDiagonal) {
              ASSERT_TRUE(cells.contains({i, j, k})) << d;
              ++inside;
            }
            if (margin < -kHalfDiagonal) {
              ASSERT_FALSE(cells.contains({i, j, k})) << d;
            }
          }
        }
      }
      ASSERT_GT(inside, 1000u);
      for (const auto& [i, j, k] : cells) ASSERT_LE(std::max({std::abs(i), std::abs(j), std::abs(k)}), 36);
    }
    // The limit is that of the yaw directions.
    params.approach.orientations = OrientationSet::yaw();
    EXPECT_EQ(kernel.collision_limit, ToolKernel::make(tool, params).collision_limit);
  }
}

/// Else a larger set could lower it, and take access away.
TEST(ToolKernel, LimitsCollisionsByTheYawDirectionsForEverySet) {
  const ToolGeometry tool = ToolGeometry::builtin("builtin:pruner");
  FieldParams params = paramsFor(0.01, 3, 12);
  const int of_yaw = ToolKernel::make(tool, params).collision_limit;
  bool would_differ = false;
  for (const OrientationSet& set : {OrientationSet::pitch(40, 40, 1), OrientationSet::sphere(45),
                                    OrientationSet::of({orientationOf(10, 20, 30)})}) {
    params.approach.orientations = set;
    const ToolKernel kernel = ToolKernel::make(tool, params);
    EXPECT_EQ(kernel.collision_limit, of_yaw) << set.text();
    const auto fewest = *std::min_element(kernel.voxel_count.begin(), kernel.voxel_count.end());
    would_differ = would_differ || static_cast<int>(0.005 * fewest) + 1 != of_yaw;
  }
  EXPECT_TRUE(would_differ);  // otherwise this would prove nothing
}

TEST(ToolKernel, TablesAgreeWithEachOther) {
  const FieldParams params = paramsFor(0.01, 3, 40);
  const ToolGeometry tool = ToolGeometry::builtin("builtin:pruner");
  const ToolKernel kernel = ToolKernel::make(tool, params), whole = ToolKernel::make(tool, paramsFor(0.01, -1, 40));
  ASSERT_EQ(kernel.column_begin.size(), 41u);
  ASSERT_EQ(kernel.voxel_count.size(), 40u);
  EXPECT_EQ(kernel.column_begin.back(), kernel.columns.size());
  std::array<int, 3> low = {99999, 99999, 99999}, high = {-99999, -99999, -99999};
  std::uint32_t fewest = ~0u;
  for (int d = 0; d < 40; ++d) {
    const Cells cells = cellsAt(kernel, d);
    EXPECT_EQ(cells.size(), kernel.voxel_count[d]);
    fewest = std::min(fewest, kernel.voxel_count[d]);
    Cells expected = cellsAt(whole, d);
    std::erase_if(expected, [](const auto& c) {
      const auto& [i, j, k] = c;
      return i * i + j * j + k * k <= 9;
    });
    EXPECT_EQ(cells, expected) << d;
    for (const auto& [i, j, k] : cells) {
      low = {std::min(low[0], i), std::min(low[1], j), std::min(low[2], k)};
      high = {std::max(high[0], i), std::max(high[1], j), std::max(high[2], k)};
    }
  }
  EXPECT_EQ(kernel.min_ijk, low);
  EXPECT_EQ(kernel.max_ijk, high);
  double hidden = 0;  // where it is most
  for (std::size_t d = 0; d < 40; ++d) {
    hidden = std::max(hidden, 1.0 - double(kernel.voxel_count[d]) / double(whole.voxel_count[d]));
  }
  EXPECT_NEAR(kernel.hidden_share, hidden, 1e-12);
  EXPECT_GT(hidden, 1.0 - double(kernel.voxel_count[0]) / double(whole.voxel_count[0]));
  EXPECT_EQ(whole.hidden_share, 0.0);
  EXPECT_EQ(kernel.collision_limit, int(0.005 * fewest) + 1);
  EXPECT_GT(kernel.collision_limit, 100);
  const kernels::ToolKernelView view = kernel.view();
  EXPECT_EQ(view.columns, kernel.columns.data());
  EXPECT_EQ(view.column_begin, kernel.column_begin.data());
  EXPECT_EQ(view.collision_limit, kernel.collision_limit);
  EXPECT_FALSE(view.use_samples);
}

TEST(ToolKernel, BodyPointsAlongTheDirection) {
  const ToolKernel kernel = ToolKernel::make(ToolGeometry::builtin("builtin:pruner"), paramsFor(0.01));
  for (int d = 0; d < 180; ++d) {
    double x = 0, y = 0;
    for (const auto& [i, j, k] : cellsAt(kernel, d)) x += i, y += j;
    EXPECT_NEAR(std::remainder(std::atan2(y, x) - 2 * std::numbers::pi * d / 180, 2 * std::numbers::pi), 0, 0.002) << d;
  }
}

TEST(ToolKernel, FatterToolCoversTheThinnerOne) {
  const ToolKernel thin =
      ToolKernel::make(toolOf(test::box({0, -0.02f, -0.01f}, {0.3f, 0.02f, 0.01f})), paramsFor(0.01));
  const ToolKernel fat =
      ToolKernel::make(toolOf(test::box({-0.003f, -0.024f, -0.016f}, {0.304f, 0.021f, 0.017f})), paramsFor(0.01));
  for (int d = 0; d < 180; ++d) {
    const Cells small = cellsAt(thin, d), large = cellsAt(fat, d);
    EXPECT_TRUE(std::includes(large.begin(), large.end(), small.begin(), small.end())) << d;
    EXPECT_GT(large.size(), small.size()) << d;
  }
}

TEST(ToolKernel, OpenMeshCountsItsSurfaceOnly) {
  test::Mesh closed = test::box({0.1f, -0.1f, -0.1f}, {0.3f, 0.1f, 0.1f}), open = closed;
  open.triangles.pop_back();
  open.triangles.pop_back();
  const ToolKernel solid = ToolKernel::make(toolOf(closed), paramsFor(0.01)),
                   shell = ToolKernel::make(toolOf(open), paramsFor(0.01));
  EXPECT_TRUE(cellsAt(solid, 3).count({20, 2, 0}));
  EXPECT_FALSE(cellsAt(shell, 3).count({20, 2, 0}));
}

TEST(ToolKernel, CollisionLimitRuleAndOverride) {
  const ToolGeometry pencil = ToolGeometry::builtin("builtin:pencil");
  FieldParams params = paramsFor(0.01);
  EXPECT_EQ(ToolKernel::make(pencil, params).collision_limit, 2);  // a dozen voxels: at least one may collide
  params.scoring.max_collisions = 7;
  EXPECT_EQ(ToolKernel::make(pencil, params).collision_limit, 8);
  params.scoring.max_collisions = 0;
  params.scoring.form = ToolForm::SurfaceSamples;
  EXPECT_EQ(ToolKernel::make(pencil, params).collision_limit, 5);  // the paper's n_c
}

TEST(ToolKernel, SamplesLieOnTheSurfaceInProportionToArea) {
  // 0.4 x 0.2 x 0.1 m: the two faces across x have 0.04 of 0.28 m2.
  const Eigen::Vector3f low(0, -0.1f, -0.05f), high(0.4f, 0.1f, 0.05f);
  FieldParams params = paramsFor(0.01);
  params.scoring.form = ToolForm::SurfaceSamples;
  params.scoring.surface_samples = 20000;
  const ToolKernel kernel = ToolKernel::make(toolOf(test::box(low, high)), params);
  ASSERT_TRUE(kernel.use_samples);
  ASSERT_EQ(kernel.sample_begin.size(), 181u);
  EXPECT_EQ(3 * std::size_t(kernel.sample_begin.back()), kernel.samples.size());
  const std::uint32_t count = kernel.sample_begin[1];
  // The ball of 3 cm around the tip is in the middle of the face at x = 0: pi 0.03^2 of 0.28 m2.
  const double share_hidden = std::numbers::pi * 0.03 * 0.03 / 0.28;
  EXPECT_NEAR(count, 20000 * (1 - share_hidden), 5 * std::sqrt(20000 * share_hidden));
  std::uint32_t on_far_end = 0;
  for (std::uint32_t n = 0; n < count; ++n) {
    const Eigen::Vector3f p(kernel.samples[3 * n], kernel.samples[3 * n + 1], kernel.samples[3 * n + 2]);
    EXPECT_GT(p.norm(), 0.03f - 1e-7f);
    const float off = std::min((p - low).cwiseAbs().minCoeff(), (p - high).cwiseAbs().minCoeff());
    EXPECT_LE(off, 1e-7f);  // float32 rounding at 0.4 m
    on_far_end += std::abs(p.x() - high.x()) <= 1e-7f;
    // The same sample at d = 45 is turned by a quarter, exactly.
    const float* turned = &kernel.samples[3 * (kernel.sample_begin[45] + n)];
    EXPECT_EQ(turned[0], -p.y());
    EXPECT_EQ(turned[1], p.x());
    EXPECT_EQ(turned[2], p.z());
  }
  const double expected = 20000 * 0.02 / 0.28;
  EXPECT_NEAR(on_far_end, expected, 5 * std::sqrt(expected));
  // Wherever the point is in its voxel, sample voxels stay in the box.
  for (std::size_t n = 0; n < kernel.samples.size(); ++n) {
    for (double at : {-0.4999, 0.0, 0.4999}) {
      const int voxel = int(std::lround(kernel.samples[n] / 0.01 + at));
      ASSERT_GE(voxel, kernel.min_ijk[n % 3]);
      ASSERT_LE(voxel, kernel.max_ijk[n % 3]);
    }
  }
}

TEST(ToolKernel, IsTheSameWhateverTheNumberOfThreads) {
  const ToolGeometry tool = ToolGeometry::builtin("builtin:pruner");
  const ToolKernel many = ToolKernel::make(tool, paramsFor(0.02));
  tbb::task_arena one(1);
  const ToolKernel alone = one.execute([&] { return ToolKernel::make(tool, paramsFor(0.02)); });
  ASSERT_EQ(many.columns.size(), alone.columns.size());
  EXPECT_EQ(std::memcmp(many.columns.data(), alone.columns.data(), 16 * many.columns.size()), 0);
  EXPECT_EQ(many.column_begin, alone.column_begin);
}

TEST(ToolKernel, RefusesWhatDoesNotFit) {
  const ToolGeometry tool = toolOf(test::box({0, -5, -0.01f}, {10, 5, 0.01f}));
  EXPECT_THROW((void)ToolKernel::make(tool, paramsFor(0.0003)), ResourceLimit);  // 33 000 voxels long
  EXPECT_THROW((void)ToolKernel::make(tool, paramsFor(0.002)), ResourceLimit);   // 25 million columns x 180
  EXPECT_THROW((void)ToolKernel::make(tool, paramsFor(std::nan(""))), ResourceLimit);
}

/// Refused before the tables of the other 179 directions are made, naming a voxel size that fits.
TEST(ToolKernel, RefusesTablesOfMoreThanFourGibibytes) {
  const ToolGeometry pruner = ToolGeometry::builtin("builtin:pruner");
  try {
    (void)ToolKernel::make(pruner, paramsFor(0.0008));
    FAIL() << "1.6 million columns x 180 x 16 bytes";
  } catch (const ResourceLimit& error) {
    EXPECT_EQ(error.id(), "tool.columns");
    EXPECT_NE(error.problem().find("at a voxel size of 0.0008 m"), std::string::npos) << error.what();
    EXPECT_NE(error.problem().find("take 4.3 GiB; at most 4 GiB"), std::string::npos) << error.what();
    EXPECT_NE(error.advice().find("Use voxel_size_m 0.0009 or larger"), std::string::npos) << error.what();
  }
  // The advised size fits: its first direction shows the total.
  const ToolKernel few = ToolKernel::make(pruner, paramsFor(0.0009, 3, 4));
  EXPECT_LT(static_cast<double>(few.columns.size()) / 4 * 180 * sizeof(kernels::VoxelColumn), 4.0 * (1 << 30));
}

TEST(Builtin, ToolsHaveTheirDocumentedSizes) {
  const ToolGeometry pencil = ToolGeometry::builtin("builtin:pencil");
  EXPECT_TRUE(pencil.watertight());
  EXPECT_TRUE(pencil.notes().empty());
  EXPECT_FLOAT_EQ(pencil.min_T().x(), 0);
  EXPECT_FLOAT_EQ(pencil.max_T().x(), 0.15f);
  EXPECT_FLOAT_EQ(pencil.max_T().y(), 0.004f);
  const ToolGeometry pruner = ToolGeometry::builtin("builtin:pruner");
  EXPECT_TRUE(pruner.watertight());
  EXPECT_TRUE(pruner.notes().empty());
  EXPECT_EQ(pruner.min_T(), Eigen::Vector3f(0, -0.25f, -0.1f));
  EXPECT_EQ(pruner.max_T(), Eigen::Vector3f(1.1f, 0.25f, 0.1f));
  for (const auto& p : pruner.vertices_T()) {
    if (p.x() >= 0.6f) continue;
    EXPECT_LE(std::hypot(p.y(), p.z()), 0.0251f) << "nothing wide within the reach";
  }
  EXPECT_THROW((void)ToolGeometry::builtin("builtin:spoon"), InvalidArgument);
}

}  // namespace
}  // namespace accessvdb::internal

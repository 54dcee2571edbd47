// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Pseudo truth (docs/evaluation.md, "Pseudo truth") in worlds whose answers are known by plain geometry.
#include "eval/pseudo_truth.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <random>

#include "accessvdb/error.h"

namespace accessvdb::eval {
namespace {

using Eigen::Vector3d;

constexpr double kV = 0.005;

DenseViewOptions viewOptions(double noise_m = 0) { return {kV, noise_m, std::max(4 * kV, 5 * noise_m)}; }

TruthOptions pencilOptions() {
  FieldParams params;
  params.tsdf.voxel_size_m = kV;
  params.tsdf.range_noise_m = 0;
  return truthOptions(params.resolved());
}

/// A rectangle at this x, seen from `sensor_W`: a return every 3 mm, which is closer than the patches' 7.5 mm.
void addWall(std::vector<SeenReturn>& returns, double x, double y_low, double y_high, double z_low, double z_high,
             const Vector3d& sensor_W) {
  for (double y = y_low; y < y_high; y += 0.003) {
    for (double z = z_low; z < z_high; z += 0.003) returns.push_back({{x, y, z}, sensor_W});
  }
}

/// A wall at x = 0, which is reached from +x, and for z > 0 a board 50 mm before it. The pencil, 150 mm long, comes
/// within 70 degrees of +x: in every such direction it crosses the board, 50 / cos(70 degrees) = 146 mm away at most.
/// For z < -0.02 no part of it (8 mm thick) comes near the board.
std::vector<SeenReturn> wallBehindBoard() {
  std::vector<SeenReturn> returns;
  for (const double side : {-0.8, 0.8}) {  // through the gap, from both sides, and from far in front below the board
    addWall(returns, 0, -0.2, 0.2, -0.2, 0.2, {0.03, side, 0});
    addWall(returns, 0.05, -0.6, 0.6, 0, 0.5, {1, side, 0.2});
    addWall(returns, 0, -0.2, 0.2, -0.2, -0.001, {1, side, -0.2});
  }
  return returns;
}

TEST(PseudoTruth, AgreesWithPlainGeometryBehindABoard) {
  const DenseView view(wallBehindBoard(), viewOptions());
  std::vector<Vector3d> positions, normals;
  for (double y = -0.1; y <= 0.1; y += 0.02) {
    for (double z = -0.1; z <= 0.1; z += 0.005) {
      if (std::abs(z) < 0.02) continue;
      positions.emplace_back(0, y, z);
      normals.emplace_back(Vector3d::UnitX());
    }
  }
  const auto verdicts = judgeBy(view, ToolGeometry::builtin("builtin:pencil"), pencilOptions(), positions, normals);
  std::size_t accessible = 0;
  for (std::size_t n = 0; n < verdicts.size(); ++n) {
    const bool free = positions[n].z() < 0;
    EXPECT_EQ(verdicts[n], free ? PseudoVerdict::Accessible : PseudoVerdict::Blocked) << positions[n].transpose();
    accessible += free ? 1 : 0;
  }
  EXPECT_GT(accessible, 100u);
}

TEST(PseudoTruth, WhatTheDenseHalfDidNotSeeIsNotJudged) {
  std::vector<SeenReturn> returns;
  // Seen from 40 mm away only: of the 150 mm of the pencil most would be where no ray went.
  for (double y = -0.1; y < 0.1; y += 0.002) {
    for (double z = -0.1; z < 0.1; z += 0.002) returns.push_back({{0, y, z}, {0.04, y, z}});
  }
  const ToolGeometry pencil = ToolGeometry::builtin("builtin:pencil");
  const std::vector<Vector3d> positions = {{0, 0, 0}, {0, 0.3, 0}, {0, 0, 0.3}, {0.1, 0, 0}};
  const std::vector<Vector3d> normals(4, Vector3d::UnitX());
  const DenseView near(returns, viewOptions());
  const auto verdicts = judgeBy(near, pencil, pencilOptions(), positions, normals);
  EXPECT_EQ(verdicts[0], PseudoVerdict::Undecided);
  for (std::size_t n = 1; n < 4; ++n) EXPECT_EQ(verdicts[n], PseudoVerdict::NoSurface) << n;

  // The same wall from 1 m: the space before it is known.
  for (SeenReturn& seen : returns) seen.sensor_W.x() = 1;
  EXPECT_EQ(judgeBy(DenseView(returns, viewOptions()), pencil, pencilOptions(), positions, normals)[0],
            PseudoVerdict::Accessible);
  // A point without a normal has no direction in its cone, whatever is before it.
  EXPECT_EQ(judgeBy(near, pencil, pencilOptions(), {positions.data(), 1}, std::vector<Vector3d>{Vector3d::Zero()})[0],
            PseudoVerdict::Blocked);
}

/// A ball of 0.1 m, seen from all sides, with noise along the rays; returns 2 mm apart.
std::vector<SeenReturn> ball(double noise_m) {
  std::vector<SeenReturn> returns;
  std::mt19937_64 draw(5);
  std::normal_distribution<double> noise(0, 1);
  constexpr int kCount = 30000;
  for (int n = 0; n < kCount; ++n) {  // Fibonacci's spiral: evenly spread
    const double z = 1 - 2 * (n + 0.5) / kCount, turn = std::numbers::pi * (1 + std::sqrt(5.0)) * n,
                 r = std::sqrt(1 - z * z);
    const Vector3d out(r * std::cos(turn), r * std::sin(turn), z);
    returns.push_back({(0.1 + noise_m * noise(draw)) * out, 0.8 * out});
  }
  return returns;
}

/// Beside the surface the side is known. Without noise a patch has 7.5 mm radius, and its plane lies inside the ball by
/// 7.5^2 / (4 * 100) = 0.14 mm at most (the mean of what is bent): 1 mm is plenty. With noise of one voxel, 5 mm, it
/// has 21 mm and about 330 returns, a third of which count fully: at most 1.1 mm of bend and 5 / sqrt(110) = 0.48 mm of
/// noise; 2 mm leave room for two sigma, and one draw in 40 beyond them on one of the two sides.
TEST(PseudoTruth, FindsTheSurfaceThroughNoise) {
  for (const double noise_m : {0.0, kV}) {
    const DenseView view(ball(noise_m), viewOptions(noise_m));
    EXPECT_GT(view.patches(), 1000u);
    const double beside_m = noise_m > 0 ? 0.002 : 0.001;
    std::mt19937_64 draw(9);
    std::normal_distribution<double> axis(0, 1);
    int wrong = 0;
    constexpr int kDraws = 5000;
    for (int n = 0; n < kDraws; ++n) {
      const Vector3d out = Vector3d(axis(draw), axis(draw), axis(draw)).normalized();
      EXPECT_TRUE(view.hasSurfaceAt(0.1 * out));
      wrong += view.at((0.1 + beside_m) * out, 0) != DenseView::Is::Free ? 1 : 0;
      wrong += view.at((0.1 - beside_m) * out, 0) != DenseView::Is::Solid ? 1 : 0;
      // The threshold shifts the surface outwards.
      wrong += view.at((0.1 + kV / 2 - beside_m) * out, kV / 2) != DenseView::Is::Solid ? 1 : 0;
      wrong += view.at(0.3 * out, kV / 2) != DenseView::Is::Free ? 1 : 0;  // rays passed
    }
    EXPECT_LE(wrong, noise_m > 0 ? kDraws / 40 : 0) << noise_m;
    EXPECT_EQ(view.at(Vector3d::Zero(), 0), DenseView::Is::Unseen);
  }
}

/// Scans of a wall at x = 0 from 0.8 m; `board` says in which there is a board 50 mm before its upper half.
PseudoTruthRequest recording(std::function<bool(std::size_t scan)> board) {
  PseudoTruthRequest request;
  request.name = "walls";
  request.scans = 8;
  request.params.tsdf.voxel_size_m = kV;
  request.params.tsdf.range_noise_m = 0;
  request.params.backend = BackendKind::Cpu;
  request.read = [board](std::size_t scan) {
    io::ScanRecord record;
    const double side = scan % 4 < 2 ? -0.15 : 0.15;
    const auto add = [&](double x, double y, double z, const Vector3d& sensor_W) {
      record.points_W.emplace_back(x, y + 0.0002 * static_cast<double>(scan), z);
      record.origins_W.push_back(sensor_W);
    };
    for (double y = -0.1; y < 0.1; y += 0.003) {
      for (double z = -0.1; z < 0.1; z += 0.003) {
        add(0, y, z, {0.8, side, 0});
        if (z > 0 && board(scan)) add(0.05, 3 * y, z, {0.8, side, 0});
      }
    }
    return record;
  };
  return request;
}

struct WallCounts {
  std::size_t upper_accessible = 0, upper_blocked = 0, lower_accessible = 0, lower_blocked = 0;
};
WallCounts onTheWall(const PseudoTruthRun& run) {
  WallCounts counts;
  for (std::size_t n = 0; n < run.verdicts.size(); ++n) {
    const Vector3d& p = run.positions_W[n];
    if (std::abs(p.x()) > kV || std::abs(p.z()) < 0.02 || run.verdicts[n] == PseudoVerdict::NoSurface) continue;
    const bool accessible = run.verdicts[n] == PseudoVerdict::Accessible;
    if (run.verdicts[n] == PseudoVerdict::Undecided) continue;
    ++(p.z() > 0 ? (accessible ? counts.upper_accessible : counts.upper_blocked)
                 : (accessible ? counts.lower_accessible : counts.lower_blocked));
  }
  return counts;
}

/// Nothing is in both halves: what is in one alone is not in the other's answer.
TEST(PseudoTruth, EachHalfKnowsOnlyItsOwnScans) {
  const Observer observer;
  const ToolGeometry pencil = ToolGeometry::builtin("builtin:pencil");
  PseudoTruthRequest request = recording([](std::size_t scan) { return scan % 2 == 0; });
  request.densities = {1};
  const PseudoTruthRun dense_has_it = pseudoTruth(request, pencil, observer).runs.at(0);
  WallCounts counts = onTheWall(dense_has_it);
  EXPECT_EQ(counts.upper_accessible, 0u);
  EXPECT_GT(counts.upper_blocked, 100u);
  EXPECT_GT(counts.lower_accessible, 100u);
  EXPECT_EQ(counts.lower_blocked, 0u);
  // The map of the sparse half does not know the board.
  EXPECT_GT(dense_has_it.judged().false_accessible, 100u);

  request = recording([](std::size_t scan) { return scan % 2 == 1; });
  request.densities = {1};
  const PseudoTruthRun sparse_has_it = pseudoTruth(request, pencil, observer).runs.at(0);
  counts = onTheWall(sparse_has_it);
  EXPECT_EQ(counts.upper_blocked, 0u);
  EXPECT_GT(counts.upper_accessible, 100u);
  EXPECT_GT(sparse_has_it.judged().false_blocked, 100u);
  EXPECT_GT(sparse_has_it.percentOf(PseudoVerdict::NoSurface), 5);  // the board's own points
}

TEST(PseudoTruth, DensitiesAreSharesOfTheSparseHalf) {
  const Observer observer;
  const ToolGeometry pencil = ToolGeometry::builtin("builtin:pencil");
  for (const HalvesBy halves : {HalvesBy::Scans, HalvesBy::Returns}) {
    PseudoTruthRequest request = recording([](std::size_t) { return false; });
    request.halves = halves;
    request.scans = 4;
    const PseudoTruthResult result = pseudoTruth(request, pencil, observer);
    std::uint64_t all = 0;
    for (std::size_t scan = 0; scan < request.scans; ++scan) all += request.read(scan).points_W.size();
    ASSERT_EQ(result.runs.size(), 3u);
    EXPECT_EQ(result.dense_returns + result.runs[0].returns, all);
    // Lots: within five sigma of sqrt(n p (1 - p)).
    const auto near = [](std::uint64_t drawn, double n, double p) {
      EXPECT_NEAR(static_cast<double>(drawn), n * p, 5 * std::sqrt(n * p * (1 - p)) + 0.5);
    };
    near(result.dense_returns, static_cast<double>(all), 0.5);
    for (const PseudoTruthRun& run : result.runs) {
      near(run.returns, static_cast<double>(result.runs[0].returns), run.density);
      EXPECT_GT(run.judged().points(), 0u);
    }
  }
}

TEST(PseudoTruth, WhatCannotBeJudgedIsRefused) {
  const Observer observer;
  const ToolGeometry pencil = ToolGeometry::builtin("builtin:pencil");
  const auto idOf = [&](const PseudoTruthRequest& request) -> std::string {
    try {
      (void)pseudoTruth(request, pencil, observer);
    } catch (const Error& error) {
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
      return error.id();
    }
    return "";
  };
  PseudoTruthRequest request = recording([](std::size_t) { return false; });
  request.scans = 1;
  EXPECT_EQ(idOf(request), "pseudo_truth.scans");
  request.halves = HalvesBy::Returns;
  EXPECT_EQ(idOf(request), "");
  request.scans = 0;
  EXPECT_EQ(idOf(request), "pseudo_truth.scans");

  for (const double density : {0.0, 1.5, std::nan("")}) {
    request = recording([](std::size_t) { return false; });
    request.densities = {1, density};
    EXPECT_EQ(idOf(request), "pseudo_truth.density") << density;
  }
  // The halves saw different places.
  request = recording([](std::size_t) { return false; });
  request.read = [read = request.read](std::size_t scan) {
    io::ScanRecord record = read(scan);
    for (Vector3d& p_W : record.points_W) p_W.z() += scan % 2 == 0 ? 0 : 5;
    for (Vector3d& sensor_W : record.origins_W) sensor_W.z() += scan % 2 == 0 ? 0 : 5;
    return record;
  };
  EXPECT_EQ(idOf(request), "pseudo_truth.nothing");
}

}  // namespace
}  // namespace accessvdb::eval

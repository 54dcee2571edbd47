// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/trajectory.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>

#include "accessvdb/error.h"
#include "sim/scene_catalogue.h"

namespace accessvdb::sim {
namespace {

using Eigen::Vector3d;
constexpr double kDegree = std::numbers::pi / 180;

Helix sample() {
  Helix shape;
  shape.centre_W = {1, 2, 3};
  shape.radius_m = 0.5;
  shape.height_begin_m = -0.4;
  shape.height_end_m = 0.4;
  shape.azimuth_begin_rad = 0.3;
  shape.azimuth_end_rad = 0.3 + 7 * 2 * std::numbers::pi;
  return shape;
}

void expectRigid(const Eigen::Isometry3d& T) {
  EXPECT_TRUE((T.linear() * T.linear().transpose()).isIdentity(1e-12));
  EXPECT_NEAR(T.linear().determinant(), 1, 1e-12);
}

TEST(Trajectory, HelixHoldsTheObjectInTheMiddleOfTheView) {
  for (const Eigen::Isometry3d& T_W_S : helix(sample(), 101)) {
    expectRigid(T_W_S);
    const Vector3d object_S = T_W_S.inverse() * Vector3d(1, 2, 3);
    EXPECT_NEAR(std::asin(object_S.z() / object_S.norm()), 22.5 * kDegree, 1e-12);
    EXPECT_NEAR(object_S.y(), 0, 1e-12);
    EXPECT_GT(object_S.x(), 0) << "straight ahead";
    EXPECT_NEAR(T_W_S.linear().col(1).z(), 0, 1e-12) << "no roll: left is level";
    EXPECT_GT(T_W_S.linear().col(2).z(), 0) << "not upside down";
  }
}

TEST(Trajectory, HelixHasItsEndsAndEvenSteps) {
  const Trajectory path = helix(sample(), 101);
  ASSERT_EQ(path.size(), 101u);
  EXPECT_TRUE(path.front().translation().isApprox(Vector3d(1 + 0.5 * std::cos(0.3), 2 + 0.5 * std::sin(0.3), 2.6)));
  EXPECT_TRUE(path.back().translation().isApprox(Vector3d(1 + 0.5 * std::cos(0.3), 2 + 0.5 * std::sin(0.3), 3.4)));
  for (std::size_t i = 0; i < path.size(); ++i) {
    const Vector3d from_centre = path[i].translation() - Vector3d(1, 2, 3);
    EXPECT_NEAR(std::hypot(from_centre.x(), from_centre.y()), 0.5, 1e-12);
    EXPECT_NEAR(from_centre.z(), -0.4 + 0.008 * static_cast<double>(i), 1e-12);
  }
  EXPECT_NEAR(helix(sample(), 1).front().translation().z(), 3, 1e-12) << "one frame stands in the middle";
}

TEST(Trajectory, OrbitVisitsNoPlaceTwice) {
  const Trajectory path = orbit(sample(), 8);
  ASSERT_EQ(path.size(), 8u);
  for (std::size_t i = 0; i < 8; ++i) {
    EXPECT_NEAR(path[i].translation().z(), 2.6, 1e-12);
    const double step = (path[i].translation() - path[(i + 1) % 8].translation()).norm();
    EXPECT_NEAR(step, 2 * 0.5 * std::sin(22.5 * kDegree), 1e-12);
  }
}

TEST(Trajectory, WalkLooksAheadAndDown) {
  const Trajectory path = walk({0, 0, 1}, {0, 4, 1}, 10 * kDegree, 5);
  ASSERT_EQ(path.size(), 5u);
  EXPECT_TRUE(path[1].translation().isApprox(Vector3d(0, 1, 1)));
  EXPECT_TRUE(path[4].translation().isApprox(Vector3d(0, 4, 1)));
  for (const Eigen::Isometry3d& T_W_S : path) {
    expectRigid(T_W_S);
    const Vector3d ahead_W = T_W_S.linear().col(0);
    EXPECT_TRUE(ahead_W.isApprox(Vector3d(0, std::cos(10 * kDegree), -std::sin(10 * kDegree))));
  }
}

TEST(Trajectory, RefusesNothingAndNonsense) {
  EXPECT_THROW((void)helix(sample(), 0), UnusableInput);
  EXPECT_THROW((void)orbit(sample(), -3), UnusableInput);
  EXPECT_THROW((void)walk({0, 0, 0}, {1, 0, 0}, 0, 0), UnusableInput);
  EXPECT_THROW((void)walk({1, 2, 3}, {1, 2, 3}, 0, 5), InvalidArgument);
  Helix shape = sample();
  shape.radius_m = 0;
  EXPECT_THROW((void)helix(shape, 5), InvalidArgument);
  shape = sample();
  shape.height_end_m = std::nan("");
  EXPECT_THROW((void)helix(shape, 5), InvalidArgument);
}

TEST(Trajectory, ReadsTumPoses) {
  const std::filesystem::path file =
      std::filesystem::temp_directory_path() / ("accessvdb_trajectory_" + std::to_string(::getpid()) + ".txt");
  std::ofstream(file) << "# stamp x y z qx qy qz qw\n0.0 1 2 3 0 0 0 1\n0.1 4 5 6 0 0 0.70710678118654752 "
                         "0.70710678118654752\n";
  const Trajectory path = readTrajectory(file);
  ASSERT_EQ(path.size(), 2u);
  EXPECT_TRUE(path[0].translation().isApprox(Vector3d(1, 2, 3)));
  EXPECT_TRUE((path[1].linear() * Vector3d::UnitX()).isApprox(Vector3d::UnitY()));
  std::ofstream(file) << "0.0 1 2 3 0 0 zero 1\n";
  EXPECT_THROW((void)readTrajectory(file), InputError);
  std::filesystem::remove(file);
  EXPECT_THROW((void)readTrajectory(file), InputError);
}

TEST(BenchmarkScene, HasTheDimensionsOfTheSpecification) {
  struct Row {
    const char* name;
    int frames;
    double radius_m, height_m, azimuth_range_deg;
  };
  const Row rows[] = {{"torus", 1000, 0.5, 0.4, 7 * 360}, {"sphere_a", 750, 0.6, 0.3, 7 * 360},
                      {"sphere_b", 1000, 0.8, 0.35, 84},  {"box", 75, 0.5, 0.05, 360},
                      {"wall", 110, 0.6, 0.14, 70},       {"ring", 1000, 0.5, 0.4, 7 * 360}};
  for (const Row& row : rows) {
    SCOPED_TRACE(row.name);
    const BenchmarkScene made = benchmarkScene(row.name, 0.002);
    EXPECT_EQ(made.scene.name, row.name);
    ASSERT_EQ(made.trajectory.size(), static_cast<std::size_t>(row.frames));
    const Vector3d first = made.trajectory.front().translation(), last = made.trajectory.back().translation();
    EXPECT_NEAR(first.head<2>().norm(), row.radius_m, 1e-12);
    EXPECT_NEAR(first.z(), -row.height_m, 1e-12);
    EXPECT_NEAR(last.z(), row.height_m, 1e-12);
    EXPECT_NEAR((made.path.azimuth_end_rad - made.path.azimuth_begin_rad) / kDegree, row.azimuth_range_deg, 1e-9);
    for (const Eigen::Isometry3d& T_W_S : made.trajectory)
      EXPECT_GT(made.scene.distance->at(T_W_S.translation()), 0.05);
  }
  EXPECT_NEAR(benchmarkScene("torus", 0.002).scene.distance->at({0.06, 0, 0}), -0.02, 1e-12);
  EXPECT_NEAR(benchmarkScene("sphere_a", 0.002).scene.distance->at({0, 0, 0}), -0.08, 1e-12);
  EXPECT_NEAR(benchmarkScene("sphere_b", 0.002).scene.distance->at({0, 0, 0}), -0.10, 1e-12);
  EXPECT_NEAR(benchmarkScene("box", 0.002).scene.distance->at({0, 0, 0.3}), 0.1, 1e-12);
  EXPECT_NEAR(benchmarkScene("wall", 0.002).scene.distance->at({0, 0, 0}), -0.01, 1e-12);
  EXPECT_NEAR(benchmarkScene("wall", 0.002).scene.distance->at({0, 0.24, 0}), 0.1, 1e-12);
  EXPECT_NEAR(benchmarkScene("ring", 0.002).scene.distance->at({0.06, 0, 0}), -0.003, 1e-12);
  EXPECT_NEAR(benchmarkScene("ring", 0.001).scene.distance->at({0.06, 0, 0}), -0.0015, 1e-12);
  EXPECT_EQ(benchmarkScene("torus", 0.002, 20).trajectory.size(), 20u);
}

TEST(BenchmarkScene, ArcsAreSweptToAndFroSevenTimes) {
  for (const auto& [name, most_rad] : {std::pair("sphere_b", 42 * kDegree), std::pair("wall", 35 * kDegree)}) {
    SCOPED_TRACE(name);
    const BenchmarkScene made = benchmarkScene(name, 0.002);
    int turning_points = 0;
    double before_rad = -most_rad, step_before_rad = 1;
    for (const Eigen::Isometry3d& T_W_S : made.trajectory) {
      const double azimuth_rad = std::atan2(T_W_S.translation().y(), T_W_S.translation().x());
      EXPECT_LE(std::abs(azimuth_rad), most_rad + 1e-9);
      const double step_rad = azimuth_rad - before_rad;
      if (step_rad * step_before_rad < 0) ++turning_points;
      before_rad = azimuth_rad;
      if (step_rad != 0) step_before_rad = step_rad;
    }
    EXPECT_EQ(turning_points, 6);
    EXPECT_NEAR(before_rad, most_rad, 1e-9);  // an odd number of sweeps ends on the other side
  }
}

/// Changing these means drawing again, and then they are no longer unseen.
TEST(BenchmarkScene, UnseenScenesStayAsTheyWereDrawn) {
  const char* drawn[] = {"major radius 0.067 m, minor radius 0.023 m",
                         "major radius 0.096 m, minor radius 0.031 m",
                         "major radius 0.056 m, minor radius 0.02 m",
                         "0.38 x 0.259 x 0.252 m",
                         "0.266 x 0.223 x 0.308 m",
                         "radius 0.055 m"};
  const int frames[] = {789, 945, 898, 256, 273, 933};
  const double radius_m[] = {0.524, 0.575, 0.749, 0.731, 0.634, 0.645};
  const double height_m[] = {0.208, 0.154, 0.270, 0.062, 0.080, 0.256};
  for (int n = 0; n < 6; ++n) {
    const BenchmarkScene made = benchmarkScene("unseen_" + std::to_string(n + 1), 0.002);
    SCOPED_TRACE(made.scene.description);
    EXPECT_NE(made.scene.description.find(drawn[n]), std::string::npos);
    EXPECT_EQ(made.frames, frames[n]);
    EXPECT_NEAR(made.path.radius_m, radius_m[n], 1e-9);
    EXPECT_NEAR(made.path.height_end_m, height_m[n], 1e-9);
    EXPECT_TRUE(made.path.centre_W.isApprox(made.scene.centre_W));
    EXPECT_GT(made.scene.centre_W.minCoeff(), 0);
    EXPECT_LT(made.scene.centre_W.maxCoeff(), 0.005);
  }
}

TEST(BenchmarkScene, UnknownNamesAreRefusedWithTheKnownOnes) {
  for (const char* name : {"tours", "unseen_0", "unseen_7", "unseen_01", ""}) {
    try {
      (void)benchmarkScene(name, 0.002);
      FAIL() << name;
    } catch (const InvalidArgument& error) {
      EXPECT_NE(error.advice().find("sphere_b"), std::string::npos);
    }
  }
  EXPECT_THROW((void)benchmarkScene("ring", 0), InvalidArgument);
  EXPECT_THROW((void)benchmarkScene("torus", 0.002, -1), UnusableInput);
}

}  // namespace
}  // namespace accessvdb::sim

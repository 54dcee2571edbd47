// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "eval/tool_samples.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "eval/ball_tree.h"
#include "sim/scene.h"

namespace accessvdb::eval {
namespace {

TEST(ToolSamples, LieOnThePencilInProportionToItsArea) {
  const ToolGeometry pencil = ToolGeometry::builtin("builtin:pencil");
  const int count = 40000;
  const auto samples = sampleToolSurface(pencil, count, 3);
  ASSERT_EQ(samples.size(), static_cast<std::size_t>(count));
  // A cone of 20 mm, then a cylinder of 4 mm radius to 0.15 m, both with 24 sides, and the disk at the end.
  const double tip = std::count_if(samples.begin(), samples.end(), [](const auto& p) { return p.x() < 0.02; });
  const double end = std::count_if(samples.begin(), samples.end(), [](const auto& p) { return p.x() > 0.15 - 1e-6; });
  const double radius = 0.004, side = 2 * radius * std::sin(M_PI / 24), flat = radius * std::cos(M_PI / 24);
  const double cone_area = 24 * 0.5 * side * std::hypot(0.02, flat), body_area = 24 * side * 0.13,
               end_area = 24 * 0.5 * side * flat, area = cone_area + body_area + end_area;
  const auto within = [count](double found, double share) {  // four standard errors of a binomial count
    return std::abs(found - count * share) < 4 * std::sqrt(count * share * (1 - share));
  };
  EXPECT_TRUE(within(tip, cone_area / area)) << tip << " of " << count * cone_area / area;
  EXPECT_TRUE(within(end, end_area / area)) << end << " of " << count * end_area / area;
  for (const auto& p : samples) {
    const double r = std::hypot(p.y(), p.z()), outer = radius * std::clamp(p.x() / 0.02, 0.0, 1.0);
    EXPECT_LE(r, outer + 1e-7);
    EXPECT_GE(r, p.x() < 0.15 - 1e-6 ? outer * std::cos(M_PI / 24) - 1e-7 : 0);
  }
  // All around: mean near the axis.
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const auto& p : samples) mean += p / count;
  EXPECT_LT(std::hypot(mean.y(), mean.z()), 4 * radius / std::sqrt(2.0 * count));
}

TEST(ToolSamples, AreTheSameForTheSameSeedOnly) {
  const ToolGeometry tool = ToolGeometry::builtin("builtin:pruner");
  EXPECT_EQ(sampleToolSurface(tool, 500, 3), sampleToolSurface(tool, 500, 3));
  EXPECT_NE(sampleToolSurface(tool, 500, 3), sampleToolSurface(tool, 500, 4));
  EXPECT_TRUE(sampleToolSurface(tool, 0, 3).empty());
}

TEST(BallTree, CountsWhatCountingOneByOneGives) {
  const sim::Scene torus = sim::makeTorus(0.06, 0.02);
  auto samples = sampleToolSurface(ToolGeometry::builtin("builtin:pencil"), 700, 9);
  samples.push_back(samples.front());  // the same position twice counts twice
  const BallTree tree(samples);
  EXPECT_EQ(tree.size(), 701);
  std::mt19937 random(4);
  const auto uniform = [&random](double low, double high) { return low + (high - low) * (random() * 0x1p-32); };
  int some = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const double threshold_m = uniform(-0.004, 0.02);
    const Eigen::Vector3d axis = Eigen::Vector3d(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)).normalized();
    const ToolPlacement tool{{uniform(-0.2, 0.2), uniform(-0.2, 0.2), uniform(-0.05, 0.05)},
                             Eigen::AngleAxisd(uniform(-4, 4), axis).toRotationMatrix()};
    int expected = 0;
    for (const auto& p : samples) expected += torus.distance->at(tool.at(p)) < threshold_m ? 1 : 0;
    EXPECT_EQ(tree.countBelow(*torus.distance, tool, {threshold_m}, 100000), expected);
    const int stopped = tree.countBelow(*torus.distance, tool, {threshold_m}, 5);
    EXPECT_EQ(stopped < 5, expected < 5);
    EXPECT_EQ(std::min(stopped, 5), std::min(expected, 5));
    some += expected > 0 && expected < 701 ? 1 : 0;
  }
  EXPECT_GE(some, 50);  // which poses they are depends on the order in which a compiler draws numbers
  EXPECT_EQ(BallTree({}).countBelow(*torus.distance, {{0, 0, 0}, Eigen::Matrix3d::Identity()}, {1}, 5), 0);
}

}  // namespace
}  // namespace accessvdb::eval

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Ground truth (docs/PAPER.md, "Ground truth") against a plain double loop, and in cases whose answer is known without
/// computing it.
#include "eval/ground_truth.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <random>

#include "eval/collision_field.h"
#include "eval/tool_samples.h"
#include "sim/scene.h"

namespace accessvdb::eval {
namespace {

using Eigen::Vector3d;

/// Wraps a function that is a signed distance.
class FunctionDistance final : public sim::SignedDistance {
 public:
  explicit FunctionDistance(std::function<double(const Vector3d&)> distance) : distance_(std::move(distance)) {}
  double at(const Vector3d& p_W) const override { return distance_(p_W); }
  Vector3d outwardNormal(const Vector3d&) const override { return Vector3d::UnitX(); }

 private:
  std::function<double(const Vector3d&)> distance_;
};

std::shared_ptr<const sim::SignedDistance> distanceOf(std::function<double(const Vector3d&)> distance) {
  return std::make_shared<FunctionDistance>(std::move(distance));
}

/// Everything at x <= 0 is solid.
std::shared_ptr<const sim::SignedDistance> halfSpace() {
  return distanceOf([](const Vector3d& p_W) { return p_W.x(); });
}

TruthOptions optionsAt(double voxel_m) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_m;
  params.tsdf.range_noise_m = 0;
  return truthOptions(params.resolved());
}

/// docs/PAPER.md, "Ground truth", literally, without shortcuts. Uses only the tool's samples.
bool plainTruth(const sim::SignedDistance& distance, const ToolGeometry& tool, const TruthOptions& o, const Vector3d& s,
                const Vector3d& normal) {
  const std::vector<Vector3d> samples = sampleToolSurface(tool, o.surface_samples, o.seed);
  bool any = false;
  for (int d = 0; d < o.num_directions; ++d) {
    const Eigen::Rotation2Dd turn(2 * std::numbers::pi * d / o.num_directions);
    const Eigen::Vector2d a = turn * Eigen::Vector2d::UnitX();
    if (!normal.allFinite() || normal.norm() == 0 || a.dot(normal.head<2>()) < std::cos(o.normal_cone_rad)) continue;
    bool arm_free = true;
    for (const double m : o.arm_m) arm_free &= distance.at(s + m * Vector3d(a.x(), a.y(), 0)) > 0;
    int collisions = 0;
    for (const Vector3d& t : samples) {
      const Eigen::Vector2d xy = turn * t.head<2>();
      if (t.norm() > o.self_exclusion_m && distance.at(s + Vector3d(xy.x(), xy.y(), t.z())) < o.collision_distance_m) {
        ++collisions;
      }
    }
    any |= arm_free && collisions < o.collision_limit;
  }
  return any;
}

/// Random points near the surface of a scene, with slightly wrong normals, and a few without.
struct Points {
  std::vector<Vector3d> positions_W, normals_W;

  Points(const sim::SignedDistance& distance, double extent_m, int count, unsigned seed) {
    std::mt19937 random(seed);  // the engine's sequence is the same everywhere; its distributions are not
    const auto uniform = [&random] { return random() * 0x1p-32 * 2 - 1; };
    while (static_cast<int>(positions_W.size()) < count) {
      Vector3d p(uniform() * extent_m, uniform() * extent_m, uniform() * extent_m);
      for (int step = 0; step < 3; ++step) p -= distance.at(p) * distance.outwardNormal(p);
      if (!(std::abs(distance.at(p)) < 1e-3)) continue;
      positions_W.push_back(p + 0.0003 * Vector3d(uniform(), uniform(), uniform()));
      Vector3d n = distance.outwardNormal(p) + 0.3 * Vector3d(uniform(), uniform(), uniform());
      normals_W.push_back(positions_W.size() % 20 == 0 ? Vector3d::Zero() : n.normalized());
    }
  }
};

void expectEqualToPlain(const sim::Scene& scene, double extent_m, const std::string& tool_name, double voxel_m,
                        double corridor_m) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_m;
  params.tsdf.range_noise_m = 0;
  params.approach.num_directions = 36;
  params.approach.corridor_length_m = corridor_m;
  TruthOptions options = truthOptions(params.resolved());
  EXPECT_EQ(options.num_directions, 180);  // the truth uses every direction, however few the method tries
  options.num_directions = 36;
  options.surface_samples = 300;
  options.collision_limit = 3;
  const ToolGeometry tool = ToolGeometry::builtin(tool_name);
  const Points points(*scene.distance, extent_m, 150, 11);
  const GroundTruth truth(scene.distance, tool, options);
  const auto found = truth.accessible(points.positions_W, points.normals_W);
  int accessible = 0, differ = 0;
  for (std::size_t n = 0; n < found.size(); ++n) {
    const bool expected = plainTruth(*scene.distance, tool, options, points.positions_W[n], points.normals_W[n]);
    differ += expected != (found[n] != 0) ? 1 : 0;
    accessible += expected ? 1 : 0;
  }
  EXPECT_EQ(differ, 0) << scene.name << " with " << tool_name;
  // Otherwise the comparison would prove little.
  EXPECT_GT(accessible, 15) << scene.name;
  EXPECT_LT(accessible, 140) << scene.name;
}

TEST(GroundTruth, EqualsThePlainLoopOnATorus) {
  expectEqualToPlain(sim::makeTorus(0.06, 0.02), 0.08, "builtin:pencil", 0.002, 0);
}

TEST(GroundTruth, EqualsThePlainLoopOnABoxAndASphere) {
  expectEqualToPlain(sim::makeBox({0.1, 0.2, 0.15}), 0.1, "builtin:pencil", 0.005, 0);
  expectEqualToPlain(sim::makeSphere(0.08), 0.08, "builtin:pencil", 0.001, 0);
}

TEST(GroundTruth, EqualsThePlainLoopForALargeToolAndALongCorridor) {
  expectEqualToPlain(sim::makeTorus(0.9, 0.25), 1.1, "builtin:pruner", 0.02, 0.5);
}

TEST(GroundTruth, TheSlowDistancePathGivesTheSameAnswers) {
  const sim::Scene scene = sim::makeTorus(0.06, 0.02);
  const ToolGeometry tool = ToolGeometry::builtin("builtin:pencil");
  const TruthOptions options = optionsAt(0.002);
  const auto field = std::make_shared<const CollisionField>(
      scene.distance, Eigen::AlignedBox3d(Vector3d(-0.1, -0.1, -0.05), Vector3d(0.1, 0.1, 0.05)), 0.004);
  const Points points(*scene.distance, 0.08, 600, 5);
  EXPECT_EQ(GroundTruth(scene.distance, tool, options).accessible(points.positions_W, points.normals_W),
            GroundTruth(field, tool, options).accessible(points.positions_W, points.normals_W));
}

// In front of a plane, every direction inside the cone of 70 degrees is free: the pencil's tip opens by 11.3 degrees.
// So the answer is whether any horizontal direction is inside the cone.
TEST(GroundTruth, APlaneIsAccessibleUnlessItLooksUpOrDown) {
  for (const double elevation_deg : {0.0, 30.0, 60.0, 69.0, 71.0, 80.0, 90.0, -69.0, -71.0}) {
    const double e = elevation_deg * std::numbers::pi / 180;
    const Vector3d normal(std::cos(e), 0, std::sin(e));
    const auto plane = distanceOf([normal](const Vector3d& p_W) { return p_W.dot(normal); });
    const GroundTruth truth(plane, ToolGeometry::builtin("builtin:pencil"), optionsAt(0.002));
    EXPECT_EQ(truth.accessible(Vector3d::Zero(), normal), std::abs(elevation_deg) < 70) << elevation_deg;
  }
}

TEST(GroundTruth, EachDirectionOfTheCountIsTried) {
  // A shaft along one direction in solid material: only directions along it are free.
  for (const int open : {0, 7, 45, 90, 133, 179}) {
    const double yaw = 2 * std::numbers::pi * open / 180;
    const Vector3d a(std::cos(yaw), std::sin(yaw), 0);
    const auto shaft = distanceOf([a](const Vector3d& p_W) {
      const double across = (p_W - a * p_W.dot(a)).norm();
      return std::min(p_W.dot(a), 0.006 - across);  // a bound, which is enough for the tree
    });
    const GroundTruth truth(shaft, ToolGeometry::builtin("builtin:pencil"), optionsAt(0.002));
    int free_directions = 0;
    for (int d = 0; d < 180; ++d) free_directions += truth.free(Vector3d::Zero(), d) ? 1 : 0;
    EXPECT_TRUE(truth.free(Vector3d::Zero(), open)) << open;
    EXPECT_LE(free_directions, 3) << open;  // the shaft is 2 mm wider than the pencil, which is 150 mm long
    EXPECT_TRUE(truth.accessible(Vector3d::Zero(), a));
    EXPECT_FALSE(truth.accessible(Vector3d::Zero(), -a));  // the cone is around the normal, not the shaft
  }
}

TEST(GroundTruth, AWallAcrossTheToolBlocksItAndOneBehindItDoesNot) {
  for (const double gap_m : {0.03, 0.10, 0.14, 0.16, 0.3}) {
    const auto slot = distanceOf([gap_m](const Vector3d& p_W) { return std::min(p_W.x(), gap_m - p_W.x()); });
    TruthOptions options = optionsAt(0.002);
    const GroundTruth truth(slot, ToolGeometry::builtin("builtin:pencil"), options);
    // The pencil is 0.15 m long; leaning by 70 degrees it needs 0.15 cos 70 and slightly more for its thickness: 0.055
    // m.
    EXPECT_EQ(truth.free(Vector3d::Zero(), 0), gap_m > 0.15) << gap_m;
    EXPECT_EQ(truth.accessible(Vector3d::Zero(), Vector3d::UnitX()), gap_m > 0.06) << gap_m;
  }
}

TEST(GroundTruth, TheCorridorIsPartOfTheTest) {
  // A grain of radius 0.3 mm at the arm's second sample. It is off the tool's surface, so only the arm meets
  // it.
  const TruthOptions options = optionsAt(0.002);
  ASSERT_EQ(options.arm_m.size(), 3u);
  for (const double arm_m : options.arm_m) {
    const auto grain = distanceOf(
        [arm_m](const Vector3d& p_W) { return std::min(p_W.x(), (p_W - Vector3d(arm_m, 0, 0)).norm() - 0.0003); });
    TruthOptions no_tool = options;
    no_tool.collision_distance_m = -1;  // nothing is that deep inside
    const GroundTruth truth(grain, ToolGeometry::builtin("builtin:pencil"), no_tool);
    EXPECT_FALSE(truth.free(Vector3d::Zero(), 0)) << arm_m;
    EXPECT_TRUE(truth.free(Vector3d::Zero(), 30)) << arm_m;
  }
  EXPECT_NEAR(options.arm_m[0], 0.6 * 4 * 0.002, 1e-15);
  EXPECT_NEAR(options.arm_m[1], 1.25 * 4 * 0.002, 1e-15);
  EXPECT_NEAR(options.arm_m[2], 2.25 * 4 * 0.002, 1e-15);
}

TEST(GroundTruth, SamplesNearTheTipAreIgnored) {
  // The tip is 5 mm inside a plane's material: all samples up to there collide, unless they are excluded.
  const Vector3d sunk(-0.005, 0, 0);
  TruthOptions options = optionsAt(0.002);
  options.arm_m = {0.02};
  options.self_exclusion_m = 0.003;
  options.surface_samples = 20000;
  options.collision_limit = 5;
  EXPECT_FALSE(GroundTruth(halfSpace(), ToolGeometry::builtin("builtin:pencil"), options).free(sunk, 0));
  options.self_exclusion_m = 0.0062;  // colliding samples reach to x = 6 mm, where the cone's edge is 6.12 mm away
  EXPECT_TRUE(GroundTruth(halfSpace(), ToolGeometry::builtin("builtin:pencil"), options).free(sunk, 0));
}

TEST(GroundTruth, NoNormalMeansNotAccessible) {
  const GroundTruth truth(halfSpace(), ToolGeometry::builtin("builtin:pencil"), optionsAt(0.002));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(truth.accessible(Vector3d::Zero(), Vector3d::UnitX()));
  EXPECT_FALSE(truth.accessible(Vector3d::Zero(), Vector3d::Zero()));
  EXPECT_FALSE(truth.accessible(Vector3d::Zero(), Vector3d(nan, 0, 0)));
  EXPECT_FALSE(truth.accessible(Vector3d(nan, 0, 0), Vector3d::UnitX()));
}

TEST(GroundTruth, LengthsFollowTheParameters) {
  FieldParams paper = FieldParams::paper(0.001);
  TruthOptions options = truthOptions(paper.resolved());
  EXPECT_DOUBLE_EQ(options.collision_distance_m, 0.0005);
  EXPECT_DOUBLE_EQ(options.self_exclusion_m, 0.003);
  EXPECT_DOUBLE_EQ(options.arm_m.back(), 0.045);
  EXPECT_EQ(options.surface_samples, 1000);
  EXPECT_EQ(options.collision_limit, 5);
  FieldParams product;
  product.tsdf.voxel_size_m = 0.01;
  product.tsdf.range_noise_m = 0;
  product.approach.corridor_length_m = 0.2;
  options = truthOptions(product.resolved());
  EXPECT_DOUBLE_EQ(options.collision_distance_m, 0.005);
  EXPECT_DOUBLE_EQ(options.arm_m.back(), 0.2);
  for (std::size_t n = 1; n < options.arm_m.size(); ++n) EXPECT_LE(options.arm_m[n] - options.arm_m[n - 1], 0.0401);
}

TEST(GroundTruth, RefusesWhatCannotBeKnown) {
  EXPECT_ANY_THROW(GroundTruth(std::shared_ptr<const sim::SignedDistance>(), ToolGeometry::builtin("builtin:pencil"),
                               optionsAt(0.002)));
  TruthOptions options = optionsAt(0.002);
  options.surface_samples = 0;
  EXPECT_ANY_THROW(GroundTruth(halfSpace(), ToolGeometry::builtin("builtin:pencil"), options));
}

}  // namespace
}  // namespace accessvdb::eval

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The truth's own sets of orientations against the library's, and the truth over them against a plain double loop and
/// cases whose answer is known.
#include "eval/truth_orientations.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "accessvdb/error.h"
#include "accessvdb/orientations.h"
#include "accessvdb/tool_tables.h"
#include "eval/ground_truth.h"
#include "eval/tool_samples.h"
#include "sim/counter_random.h"
#include "sim/tilt_scenes.h"

namespace accessvdb::eval {
namespace {

using Eigen::Matrix3d, Eigen::Vector3d;

void expectTheSame(const std::vector<Matrix3d>& truth, const std::vector<ToolOrientation>& library,
                   const std::string& words) {
  ASSERT_EQ(truth.size(), library.size()) << words;
  // Sines and cosines of the same angles, rounded a few times.
  constexpr double kRounding = 1e-14;
  for (std::size_t n = 0; n < truth.size(); ++n) {
    EXPECT_LT((truth[n] - library[n].R_WT).cwiseAbs().maxCoeff(), kRounding) << words << ", " << n;
  }
}

TEST(TruthOrientations, AreThoseOfTheLibraryInItsOrder) {
  for (const char* text :
       {"yaw", "pitch:-30:30:10", "pitch:-90:90:45", "pitch:12.5:12.5:1", "pitch:0:40:30", "sphere:90", "sphere:45",
        "sphere:30", "sphere:25", "sphere:15", "sphere:12.5", "sphere:20+yaw"}) {
    for (const int yaws : {4, 7, 36}) {
      expectTheSame(truthOrientations(text, yaws), OrientationSet::parse(text).orientations(yaws),
                    std::string(text) + " of " + std::to_string(yaws));
    }
  }
  for (const double yaw : {0.0, 33.3, -120.0, 270.0}) {
    for (const double pitch : {-90.0, -40.0, 0.0, 61.5, 90.0}) {
      for (const double roll : {0.0, 45.0, -75.0, 180.0}) {
        expectTheSame({heldAt(yaw, pitch, roll)}, {orientationOf(yaw, pitch, roll)}, "three angles");
      }
    }
  }
}

/// In the order of the library's direction and roll.
TEST(TruthOrientations, RollAsTheLibraryDoes) {
  const ToolGeometry pruner = ToolGeometry::builtin("builtin:pruner");
  ApproachParams approach;
  approach.orientations = OrientationSet::sphere(30);
  ASSERT_EQ(rollsOf(pruner, approach), 6);
  const std::vector<Matrix3d> truth = rolled(truthOrientations("sphere:30", 180), 6, 2);
  std::vector<ToolOrientation> library;
  for (const ToolOrientation& axis : approach.orientations.orientations(180)) {
    const double degrees = 180 / std::numbers::pi;
    for (int roll = 0; roll < 6; ++roll) {
      library.push_back(orientationOf(axis.yaw_rad * degrees, axis.pitch_rad * degrees, 30.0 * roll));
    }
  }
  expectTheSame(truth, library, "rolls");
}

TEST(TruthOrientations, HaveTheSizesOfTheDocument) {
  EXPECT_EQ(truthOrientations("pitch:-30:30:10", 36).size(), 252u);
  EXPECT_EQ(truthOrientations("sphere:15", 180).size(), 186u);
  EXPECT_EQ(truthOrientations("sphere:12.5", 180).size(), 254u);
  EXPECT_EQ(truthOrientations("sphere:15+yaw", 36).size(), 210u);
  EXPECT_EQ(truthOrientations("sphere:3.8", 180).size(), 2906u);
}

TEST(TruthOrientations, AreWhatTheDocumentSaysTheyAre) {
  // From above: the body points up. Without roll the tool's top is as far up as it can be.
  EXPECT_LT((heldAt(0, 90, 0).col(0) - Vector3d::UnitZ()).norm(), 1e-15);
  const double half = std::sqrt(0.5);
  EXPECT_LT((heldAt(90, 45, 0).col(0) - Vector3d(0, half, half)).norm(), 1e-15);
  EXPECT_LT((heldAt(90, 45, 0).col(2) - Vector3d(0, -half, half)).norm(), 1e-15);
  EXPECT_LT((heldAt(0, 0, 90).col(1) - Vector3d::UnitZ()).norm(), 1e-15) << "its left side turns up";
  for (const char* text : {"", "yaw ", "sphere:", "sphere:0", "sphere:nan", "sphere:10 ", "sphere:10+yaws", "pitch:0:1",
                           "pitch:0:10:0", "pitch:0:100:10", "list:some"}) {
    EXPECT_THROW((void)truthOrientations(text, 36), InvalidArgument) << text;
  }
}

TruthOptions optionsFor(double voxel_m) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_m;
  params.tsdf.range_noise_m = 0;
  return truthOptions(params.resolved());
}

TEST(GroundTruth, TheYawDirectionsByNameAndByListAreTheSame) {
  const sim::Scene scene = sim::tiltScene("open_box")->scene;
  const ToolGeometry tool = ToolGeometry::builtin("builtin:pencil");
  const TruthOptions by_number = optionsFor(0.002);
  TruthOptions by_list = by_number;
  by_list.orientations = truthOrientations("yaw", 180);
  std::vector<Vector3d> positions_W, normals_W;
  sim::CounterRandom random({3});
  for (int n = 0; n < 400; ++n) {
    positions_W.emplace_back(random.uniform(-0.09, 0.09), random.uniform(-0.07, 0.07), random.uniform(-0.07, 0.07));
    normals_W.push_back(scene.distance->outwardNormal(positions_W.back()));
  }
  const auto found = GroundTruth(scene.distance, tool, by_number).accessible(positions_W, normals_W);
  EXPECT_EQ(found, GroundTruth(scene.distance, tool, by_list).accessible(positions_W, normals_W));
  EXPECT_GT(std::count(found.begin(), found.end(), 1), 20);
}

/// docs/PAPER.md, "Ground truth", over orientations: without order, early end or tree.
bool plainTruthOver(const sim::SignedDistance& distance, const ToolGeometry& tool, const TruthOptions& o,
                    const Vector3d& s, const Vector3d& normal) {
  bool any = false;
  for (const Matrix3d& R_WT : o.orientations) {
    const Eigen::Quaterniond turn(R_WT);
    const Vector3d axis = turn * Vector3d::UnitX();
    bool free = axis.dot(normal) >= std::cos(o.normal_cone_rad);
    for (const double m : o.arm_m) free &= distance.at(s + m * axis) > 0;
    int collisions = 0;
    for (const Vector3d& t : sampleToolSurface(tool, o.surface_samples, o.seed)) {
      collisions += t.norm() > o.self_exclusion_m && distance.at(s + turn * t) < o.collision_distance_m ? 1 : 0;
    }
    any |= free && collisions < o.collision_limit;
  }
  return any;
}

TEST(GroundTruth, EqualsThePlainLoopOverTiltedAndRolledTools) {
  int all_accessible = 0, all_tried = 0;
  for (const std::string& name : sim::tiltSceneNames()) {
    const sim::Scene scene = sim::tiltScene(name)->scene;
    const ToolGeometry tool = ToolGeometry::builtin("builtin:pencil");
    TruthOptions options = optionsFor(0.002);
    options.surface_samples = 150;
    options.collision_limit = 2;
    options.orientations = {heldAt(20, 30, 40),   heldAt(200, -50, 10), heldAt(-75, 60, 90),
                            heldAt(110, 75, -30), heldAt(0, 90, 15),    heldAt(280, 5, 0)};
    const GroundTruth truth(scene.distance, tool, options);
    sim::CounterRandom random({5});
    int accessible = 0, tried = 0;
    while (tried < 60) {
      Vector3d p(random.uniform(-0.1, 0.1), random.uniform(-0.1, 0.1), random.uniform(-0.08, 0.08));
      p -= scene.distance->at(p) * scene.distance->outwardNormal(p);
      if (!(std::abs(scene.distance->at(p)) < 1e-4)) continue;
      ++tried;
      const Vector3d normal = scene.distance->outwardNormal(p);
      const bool expected = plainTruthOver(*scene.distance, tool, options, p, normal);
      EXPECT_EQ(truth.accessible(p, normal), expected) << name << " at " << p.transpose();
      accessible += expected ? 1 : 0;
    }
    all_accessible += accessible;
    all_tried += tried;
  }
  // Otherwise the comparison would prove little.
  EXPECT_GT(all_accessible, 20);
  EXPECT_LT(all_accessible, all_tried - 20);
}

TEST(GroundTruth, OnTheFloorOfAConeWellTheFreeAxesAreACap) {
  // Seen from the middle of the floor the rim is (61.2, 80) mm away. The pencil, 4 mm thick on each side, passes as
  // long as its middle line is 4 mm and the collision distance away from the rim: |61.2 cos t - 80 sin t| mm at a tilt
  // of t.
  const sim::Scene scene = sim::tiltScene("cone_well")->scene;
  TruthOptions options = optionsFor(0.001);
  options.collision_limit = 1;
  options.surface_samples = 20000;
  const double rim_m = 0.015 + 0.08 * std::tan(std::numbers::pi / 6);
  const auto clearance_m = [&](double tilt_deg) {
    const double tilt = tilt_deg * std::numbers::pi / 180;
    return rim_m * std::cos(tilt) - 0.08 * std::sin(tilt) - 0.004 - options.collision_distance_m;
  };
  std::vector<double> tilts_deg;
  for (double tilt_deg = 0.25; tilt_deg < 60; tilt_deg += 0.5) {
    tilts_deg.push_back(tilt_deg);
    options.orientations.push_back(heldAt(77, 90 - tilt_deg, 0));
  }
  const GroundTruth truth(scene.distance, ToolGeometry::builtin("builtin:pencil"), options);
  for (std::size_t n = 0; n < tilts_deg.size(); ++n) {
    // Samples are 1 mm apart and the pencil has 24 sides: half a degree from the limit is 0.9 mm at the rim.
    if (std::abs(clearance_m(tilts_deg[n])) < 0.0009) continue;
    EXPECT_EQ(truth.free({0, 0, -0.03}, static_cast<int>(n)), clearance_m(tilts_deg[n]) > 0) << tilts_deg[n];
  }
}

TEST(GroundTruth, OnlyARolledToolComesToTheEndOfTheSlot) {
  // A blade 0.25 m long, 0.12 m wide, 10 mm thick, in a slot of 0.075 m.
  const sim::Scene scene = sim::tiltScene("slot")->scene;
  std::vector<Eigen::Vector3f> corners_T;
  for (int n = 0; n < 8; ++n) {
    corners_T.emplace_back(n & 1 ? 0.25f : 0.02f, n & 2 ? 0.06f : -0.06f, n & 4 ? 0.005f : -0.005f);
  }
  const ToolGeometry blade = ToolGeometry::fromTriangles(corners_T,
                                                         {{0, 4, 6},
                                                          {0, 6, 2},
                                                          {1, 3, 7},
                                                          {1, 7, 5},
                                                          {0, 1, 5},
                                                          {0, 5, 4},
                                                          {2, 6, 7},
                                                          {2, 7, 3},
                                                          {0, 2, 3},
                                                          {0, 3, 1},
                                                          {4, 5, 7},
                                                          {4, 7, 6}},
                                                         "blade");
  TruthOptions options = optionsFor(0.002);
  std::vector<double> rolls_deg;
  for (int roll_deg = 0; roll_deg < 180; roll_deg += 5) {
    rolls_deg.push_back(roll_deg);
    options.orientations.push_back(heldAt(0, 0, roll_deg));
  }
  const GroundTruth truth(scene.distance, blade, options);
  for (std::size_t n = 0; n < rolls_deg.size(); ++n) {
    const double roll = rolls_deg[n] * std::numbers::pi / 180;
    const double width_m = 0.12 * std::abs(std::cos(roll)) + 0.01 * std::abs(std::sin(roll));
    // Five samples of 1000 may collide, on a blade with 2 * 0.12 * 0.23 m2: about 1 mm at each edge, and as much for
    // the collision distance.
    if (std::abs(width_m - 0.075) < 0.005) continue;
    EXPECT_EQ(truth.free({0, 0, 0}, static_cast<int>(n)), width_m < 0.075) << rolls_deg[n];
  }
  EXPECT_TRUE(truth.accessible({0, 0, 0}, Vector3d::UnitX()));
  options.orientations = truthOrientations("yaw", 36);
  EXPECT_FALSE(GroundTruth(scene.distance, blade, options).accessible({0, 0, 0}, Vector3d::UnitX()));
}

TEST(GroundTruth, MoreOrientationsNeverTakeAccessAway) {
  const sim::Scene scene = sim::tiltScene("branch_below")->scene;
  const ToolGeometry tool = ToolGeometry::builtin("builtin:pencil");
  TruthOptions few = optionsFor(0.002), many = few;
  few.orientations = truthOrientations("yaw", 36);
  many.orientations = truthOrientations("sphere:20+yaw", 36);
  const GroundTruth level(scene.distance, tool, few), all(scene.distance, tool, many);
  sim::CounterRandom random({6});
  int gained = 0;
  for (int n = 0; n < 300; ++n) {
    Vector3d p(random.uniform(-0.1, 0.1), random.uniform(-0.1, 0.1), random.uniform(-0.08, 0.08));
    const Vector3d normal = scene.distance->outwardNormal(p);
    const bool before = level.accessible(p, normal), after = all.accessible(p, normal);
    EXPECT_TRUE(after || !before) << p.transpose();
    gained += after && !before ? 1 : 0;
  }
  EXPECT_GT(gained, 10);
}

TEST(GroundTruth, RefusesWhatIsNoRotation) {
  TruthOptions options = optionsFor(0.002);
  options.orientations = {Matrix3d::Identity(), 1.001 * Matrix3d::Identity()};
  const sim::Scene scene = sim::makeSphere(0.05);
  EXPECT_THROW(GroundTruth(scene.distance, ToolGeometry::builtin("builtin:pencil"), options), InvalidArgument);
  options.orientations[1](0, 0) = std::nan("");
  EXPECT_THROW(GroundTruth(scene.distance, ToolGeometry::builtin("builtin:pencil"), options), InvalidArgument);
}

}  // namespace
}  // namespace accessvdb::eval

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The fit finds constants that samples were drawn with, and the deciles are those of counting by hand. What the
/// library's constants say of points, in a scene that they were not fitted on, comes true.
#include "eval/probability_fit.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "accessvdb/accessibility_field.h"
#include "eval/ground_truth.h"
#include "eval/scene_run.h"

namespace accessvdb::eval {
namespace {

TEST(ProbabilityFit, FindsWhatSamplesWereDrawnWith) {
  std::mt19937 engine(3);
  std::uniform_real_distribution<double> share(0, 1);
  std::vector<FitSample> samples(40000);
  for (FitSample& sample : samples) {
    const double x = 6 * share(engine), y = share(engine);
    sample.terms = {1, static_cast<float>(x), 0, static_cast<float>(y), 2, 0, 0};  // some the same for all
    sample.accessible = share(engine) < 1 / (1 + std::exp(-(2 - 1.5 * x + 0.8 * y)));
  }
  const auto free = fitOdds(samples, {0, -1, -1, 0, 0, 0, 0});
  EXPECT_NEAR(free[0], 2, 0.1);  // four standard errors of 40 000 samples
  EXPECT_NEAR(free[1], -1.5, 0.08);
  EXPECT_NEAR(free[3], 0.8, 0.25);
  EXPECT_EQ(free[2], 0);
  EXPECT_EQ(free[4], 0);
  const auto signed_fit = fitOdds(samples, {0, -1, 0, -1, 0, 0, 0});  // the third may not rise
  EXPECT_EQ(signed_fit[3], 0);
  EXPECT_NEAR(signed_fit[1], -1.5, 0.08);
}

TEST(ProbabilityFit, DecilesAreCountedAndFewPointsAreNoEvidence) {
  Reliability reliability;
  for (int n = 0; n < 600; ++n) reliability.add(0.9F, true, n % 4 != 0);    // said 90, was 75
  for (int n = 0; n < 499; ++n) reliability.add(0.25F, false, true);        // far off, but too few
  for (int n = 0; n < 1000; ++n) reliability.add(1.0F, true, n % 50 != 0);  // said 100, was 98: the same decile
  ASSERT_EQ(reliability.points(), 2099U);
  const Reliability::Decile& top = reliability.deciles()[9];
  EXPECT_EQ(top.points, 1600U);
  EXPECT_NEAR(top.saidPercent(), (600 * 90 + 1000 * 100) / 1600.0, 1e-4);
  EXPECT_NEAR(top.wasPercent(), (450 + 980) / 16.0, 1e-9);
  EXPECT_EQ(reliability.deciles()[2].points, 499U);
  EXPECT_NEAR(reliability.farthestOff(), 96.25 - 89.375, 1e-4);
  EXPECT_NEAR(reliability.brierOfLabels(), (150 + 499 + 20) / 2099.0, 1e-9);
  EXPECT_NEAR(reliability.brier(), (450 * 0.01 + 150 * 0.81 + 499 * 0.5625 + 20) / 2099.0, 1e-4);
}

/// A torus of another size, with noise: the deciles with enough points are within 5 percent points.
TEST(ProbabilityFit, WhatIsSaidComesTrueWhereItWasNotFitted) {
  ScanStore scans("", {});
  ScanRequest request;
  request.scene = "unseen_2";
  request.voxel_size_m = 0.005;
  request.range_noise_m = 0.005;
  request.frames = 60;
  const auto stored = scans.get(request);
  AccessibilityField field(ToolGeometry::builtin("builtin:pencil"),
                           productRun("unseen_2", 0.005, request.range_noise_m).params);
  for (const StoredFrame& frame : stored->frames) (void)field.integrateScan(frame.hits_S, frame.T_W_S);
  (void)field.update();
  std::vector<SurfacePoint> said;
  std::vector<Eigen::Vector3d> positions_W, normals_W;
  for (const SurfacePoint& point : field.snapshot().points) {
    if (point.access_probability < 0) continue;
    said.push_back(point);
    positions_W.push_back(point.position_W);
    normals_W.emplace_back(point.normal_W.cast<double>());
  }
  const auto truth = GroundTruth(stored->benchmark.scene.distance, field.tool(), truthOptions(field.params()))
                         .accessible(positions_W, normals_W);
  Reliability reliability;
  for (std::size_t n = 0; n < said.size(); ++n)
    reliability.add(said[n].access_probability, said[n].label == PointLabel::Accessible, truth[n] != 0);
  EXPECT_GT(reliability.points(), 3000U);
  EXPECT_LE(reliability.farthestOff(), 5);
}

}  // namespace
}  // namespace accessvdb::eval

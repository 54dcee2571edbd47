// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "accessvdb/params.h"

#include <gtest/gtest.h>

#include <map>
#include <sstream>

#include "accessvdb/error.h"

namespace accessvdb {
namespace {

std::map<std::string, std::string> described(const FieldParams& params) {
  std::map<std::string, std::string> values;
  std::istringstream lines(params.describe());
  for (std::string line; std::getline(lines, line);) {
    const auto blank = line.find(' ');
    EXPECT_NE(blank, std::string::npos) << line;
    EXPECT_TRUE(values.emplace(line.substr(0, blank), line.substr(blank + 1)).second) << "twice: " << line;
  }
  return values;
}

FieldParams withVoxel(double voxel_size_m, double range_noise_m) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_size_m;
  params.tsdf.range_noise_m = range_noise_m;
  return params;
}

TEST(FieldParams, TruncationIsFourVoxelsOrFiveSigma) {
  EXPECT_DOUBLE_EQ(withVoxel(0.01, 0.02).resolved().tsdf.truncation_distance_m, 0.1);
  EXPECT_DOUBLE_EQ(withVoxel(0.05, 0.02).resolved().tsdf.truncation_distance_m, 0.2);
  EXPECT_DOUBLE_EQ(withVoxel(0.05, 0).resolved().tsdf.truncation_distance_m, 0.2);
  FieldParams given = withVoxel(0.05, 0.02);
  given.tsdf.truncation_distance_m = 0.3;
  EXPECT_DOUBLE_EQ(given.resolved().tsdf.truncation_distance_m, 0.3);
}

TEST(FieldParams, CollisionDistanceIsHalfAVoxel) {
  EXPECT_DOUBLE_EQ(withVoxel(0.01, 0).resolved().scoring.collision_distance_m, 0.005);
  FieldParams given = withVoxel(0.01, 0);
  given.scoring.collision_distance_m = 0.002;
  EXPECT_DOUBLE_EQ(given.resolved().scoring.collision_distance_m, 0.002);
}

TEST(FieldParams, NeighboursGrowWithTheNoise) {
  EXPECT_EQ(withVoxel(0.05, 0).resolved().scoring.neighbours, 10);
  EXPECT_EQ(withVoxel(0.05, 0.0249).resolved().scoring.neighbours, 10);
  EXPECT_EQ(withVoxel(0.05, 0.025).resolved().scoring.neighbours, 30);
  EXPECT_EQ(withVoxel(0.05, 0.0499).resolved().scoring.neighbours, 30);
  EXPECT_EQ(withVoxel(0.05, 0.05).resolved().scoring.neighbours, 60);
  EXPECT_EQ(withVoxel(0.05, 0.0999).resolved().scoring.neighbours, 60);
  EXPECT_EQ(withVoxel(0.05, 0.1).resolved().scoring.neighbours, 100);
  FieldParams given = withVoxel(0.05, 0.05);
  given.scoring.neighbours = 7;
  EXPECT_EQ(given.resolved().scoring.neighbours, 7);
}

TEST(FieldParams, TheCacheOnTheDeviceGrowsWithSmallerVoxels) {
  for (const auto& [voxel_size_m, gigabytes] : {std::pair{0.5, 4.0},
                                                {0.01, 4.0},
                                                {static_cast<double>(0.01F), 4.0},
                                                {0.0099, 20.0},
                                                {0.005, 20.0},
                                                {0.004, 64.0},
                                                {0.0025, 64.0},
                                                {0.00125, 64.0},
                                                {0.001, 64.0},
                                                {0.0005, 64.0}}) {
    EXPECT_EQ(withVoxel(voxel_size_m, 0).resolved().device_cache_bytes, static_cast<std::uint64_t>(1e9 * gigabytes))
        << voxel_size_m;
  }
  FieldParams given = withVoxel(0.005, 0);
  given.device_cache_bytes = 64'000'000;
  EXPECT_EQ(given.resolved().device_cache_bytes, 64'000'000u);
}

TEST(FieldParams, TheClearedBandReachesAsFarAsTheCorridor) {
  FieldParams params = withVoxel(0.05, 0);
  EXPECT_DOUBLE_EQ(params.resolved().tsdf.cleared_end_tau, 2.25);
  params.approach.corridor_length_m = 1.0;  // 5 tau
  EXPECT_DOUBLE_EQ(params.resolved().tsdf.cleared_end_tau, 5);
}

TEST(FieldParams, ResolvingTwiceChangesNothing) {
  FieldParams params = withVoxel(0.03, 0.02);
  params.approach.corridor_length_m = 0.7;
  const FieldParams once = params.resolved();
  EXPECT_EQ(once.resolved().describe(), once.describe());
  EXPECT_EQ(FieldParams::paper(0.01).resolved().resolved().describe(), FieldParams::paper(0.01).resolved().describe());
}

TEST(FieldParams, PaperConstants) {
  const FieldParams p = FieldParams::paper(0.01).resolved();
  EXPECT_DOUBLE_EQ(p.tsdf.voxel_size_m, 0.01);
  EXPECT_DOUBLE_EQ(p.tsdf.truncation_distance_m, 0.04);
  EXPECT_DOUBLE_EQ(FieldParams::paper(0.002).resolved().tsdf.truncation_distance_m, 0.02);
  EXPECT_EQ(p.tsdf.region, UpdateRegion::FullCube);
  EXPECT_EQ(p.tsdf.max_weight, 2000u);
  EXPECT_DOUBLE_EQ(p.tsdf.cleared_radius_voxels, 0);
  EXPECT_DOUBLE_EQ(p.tsdf.cleared_begin_tau, 1);
  EXPECT_DOUBLE_EQ(p.tsdf.cleared_end_tau, 2.25);
  EXPECT_EQ(p.approach.num_directions, 180);
  EXPECT_NEAR(p.approach.normal_cone_rad, 70 * 3.14159265358979 / 180, 1e-12);
  EXPECT_DOUBLE_EQ(p.approach.observation_cos_min, 0.25);
  EXPECT_EQ(p.approach.arm_tau, (std::array<double, 3>{0.6, 1.25, 2.25}));
  EXPECT_TRUE(p.approach.coarse_to_fine);
  EXPECT_TRUE(p.approach.viewpoints);
  EXPECT_DOUBLE_EQ(p.scoring.collision_distance_m, 0.0005);
  EXPECT_DOUBLE_EQ(p.scoring.self_exclusion_voxels, 3);
  EXPECT_EQ(p.scoring.form, ToolForm::SurfaceSamples);
  EXPECT_EQ(p.scoring.surface_samples, 1000);
  EXPECT_EQ(p.scoring.neighbours, 10);
  EXPECT_FALSE(p.scoring.mean_positions);
  EXPECT_FALSE(p.scoring.join_neighbour_views);
  EXPECT_FALSE(p.scoring.neighbourhood_weight);
  EXPECT_DOUBLE_EQ(p.scoring.confidence_half_weight, 5);
  EXPECT_DOUBLE_EQ(p.scoring.confidence_min, 0.2);
  EXPECT_EQ(p.update.policy, UpdatePolicy::Paper);
  EXPECT_EQ(p.update.changed_voxel_sample, 256);
  EXPECT_DOUBLE_EQ(p.update.changed_voxel_radius_voxels, 3);
  EXPECT_DOUBLE_EQ(p.update.requeue_motion_m, 0.1);
  EXPECT_DOUBLE_EQ(p.update.stability_min, 0.7);
}

TEST(FieldParams, DescribesEveryEffectiveValue) {
  const auto values = described(FieldParams{}.resolved());
  for (const char* name : {"voxel_size_m",
                           "truncation_distance_m",
                           "range_noise_m",
                           "min_range_m",
                           "max_range_m",
                           "region",
                           "cone_cos_min",
                           "clamp_min_m",
                           "max_weight",
                           "cleared_radius_voxels",
                           "cleared_begin_tau",
                           "cleared_end_tau",
                           "num_directions",
                           "normal_cone_rad",
                           "observation_cos_min",
                           "arm_tau",
                           "corridor_length_m",
                           "coarse_to_fine",
                           "viewpoints",
                           "collision_distance_m",
                           "self_exclusion_voxels",
                           "tool_form",
                           "surface_samples",
                           "max_collisions",
                           "neighbours",
                           "mean_positions",
                           "join_neighbour_views",
                           "neighbourhood_weight",
                           "confidence_half_weight",
                           "confidence_min",
                           "policy",
                           "budget_points",
                           "stability_min"}) {
    EXPECT_TRUE(values.contains(name)) << name;
  }
  EXPECT_EQ(values.at("voxel_size_m"), "0.01");
  EXPECT_EQ(values.at("truncation_distance_m"), "0.1");
  EXPECT_EQ(values.at("max_range_m"), "inf");
  EXPECT_EQ(values.at("region"), "double_cone");
  EXPECT_EQ(values.at("arm_tau"), "0.6 1.25 2.25");
  EXPECT_EQ(values.at("policy"), "exact");
}

/// "Every effective value" includes those that affect the paper's policy.
TEST(FieldParams, DescribesThePaperPolicy) {
  const auto values = described(FieldParams::paper(0.01).resolved());
  for (const char* name : {"changed_voxel_sample", "changed_voxel_radius_voxels", "requeue_motion_m", "seed"}) {
    EXPECT_TRUE(values.contains(name)) << name;
  }
}

TEST(FieldParams, DescriptionChangesWithTheValue) {
  FieldParams params;
  params.tsdf.cone_cos_min = 0.9;
  params.scoring.max_collisions = 17;
  params.update.policy = UpdatePolicy::Paper;
  const auto values = described(params);
  EXPECT_EQ(values.at("cone_cos_min"), "0.9");
  EXPECT_EQ(values.at("max_collisions"), "17");
  EXPECT_EQ(values.at("policy"), "paper");
}

TEST(FieldParams, BoundsAreRefusedByName) {
  const auto subjectOf = [](const auto& change) -> std::string {
    FieldParams params;
    change(params);
    try {
      static_cast<void>(params.resolved());
    } catch (const InvalidArgument& error) {
      return error.subject();
    }
    return "accepted";
  };
  EXPECT_EQ(subjectOf([](FieldParams& p) { p.tsdf.voxel_size_m = 0; }), "voxel_size_m");
  EXPECT_EQ(subjectOf([](FieldParams& p) { p.tsdf.voxel_size_m = 0.0004; }), "voxel_size_m");
  EXPECT_EQ(subjectOf([](FieldParams& p) { p.tsdf.voxel_size_m = 11; }), "voxel_size_m");
  EXPECT_EQ(subjectOf([](FieldParams& p) { p.tsdf.max_weight = 0; }), "max_weight");
  EXPECT_EQ(subjectOf([](FieldParams& p) { p.tsdf.max_weight = 4096; }), "max_weight");
  EXPECT_EQ(subjectOf([](FieldParams& p) { p.tsdf.clamp_min_m = 0.001; }), "clamp_min_m");
  EXPECT_EQ(subjectOf([](FieldParams& p) { p.tsdf.clamp_min_m = -0.1; }), "accepted");  // -tau
  EXPECT_EQ(subjectOf([](FieldParams& p) { p.approach.num_directions = 3; }), "num_directions");
  EXPECT_EQ(subjectOf([](FieldParams& p) { p.approach.num_directions = 257; }), "num_directions");
  EXPECT_EQ(subjectOf([](FieldParams& p) { p.approach.num_directions = 256; }), "accepted");
  EXPECT_EQ(subjectOf([](FieldParams& p) { p.approach.normal_cone_rad = 1.6; }), "normal_cone_rad");
  EXPECT_EQ(subjectOf([](FieldParams& p) { p.approach.corridor_length_m = 5.1; }), "corridor_length_m");
  EXPECT_EQ(subjectOf([](FieldParams& p) { p.scoring.max_collisions = -2; }), "max_collisions");
  EXPECT_EQ(subjectOf([](FieldParams& p) { p.scoring.neighbours = 2; }), "neighbours");
  EXPECT_EQ(subjectOf([](FieldParams& p) { p.scoring.confidence_min = 1; }), "confidence_min");
  EXPECT_EQ(subjectOf([](FieldParams& p) { p.update.budget_points = -1; }), "budget_points");
  EXPECT_EQ(subjectOf([](FieldParams& p) { p.threads = -1; }), "threads");
  EXPECT_EQ(subjectOf([](FieldParams& p) { p.device_cache_bytes = 63'999'999; }), "device_cache_bytes");
}

}  // namespace
}  // namespace accessvdb

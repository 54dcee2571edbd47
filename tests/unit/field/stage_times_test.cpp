// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The times of the stages against the caller's clock: together they make up the frame.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <random>
#include <vector>

#include "accessvdb/accessibility_field.h"

namespace accessvdb {
namespace {

constexpr int kFrames = 15;
/// What a frame may take outside all stages: two calls and clock readings take a thousandth of this. It bounds the
/// median of the frames, so that a busy machine would have to interrupt most of them there.
constexpr double kMostRest_ms = 0.05;

using Clock = std::chrono::steady_clock;
double millisecondsSince(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

double sumOf(const FrameStats& stats) { return stats.integrate_ms + stats.mirror_ms; }
double sumOf(const UpdateStats& stats) { return stats.update_ms + stats.score_ms; }

/// Collects frames, each as its wall time and the sum of its stages.
class Frames {
 public:
  void add(double frame_ms, double stages_ms) {
    EXPECT_LE(stages_ms, frame_ms + 1e-6) << "something was timed twice";
    rest_ms_.push_back(frame_ms - stages_ms);
    longest_ms_ = std::max(longest_ms_, frame_ms);
  }
  ~Frames() {
    std::ranges::sort(rest_ms_);
    EXPECT_LE(rest_ms_.at(rest_ms_.size() / 2), kMostRest_ms);
    EXPECT_GT(longest_ms_, 10 * kMostRest_ms) << "frames this short say nothing";
  }

 private:
  std::vector<double> rest_ms_;
  double longest_ms_ = 0;
};

/// A rough wall 3 m ahead, of which each frame n sees a different part.
std::vector<Eigen::Vector3f> wall_S(int n) {
  std::mt19937 random(static_cast<std::uint32_t>(n));
  const auto uniform = [&](float low, float high) {
    return low + (high - low) * static_cast<float>(random() >> 8) * 0x1.0p-24f;
  };
  std::vector<Eigen::Vector3f> points;
  for (int k = 0; k < 4000; ++k) points.emplace_back(uniform(2.9f, 3.1f), uniform(-2, 2), uniform(-1, 1));
  return points;
}

Eigen::Isometry3d pose_W_S(int n) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translation().y() = 0.15 * n;
  return pose;
}

FieldParams paramsOf(UpdatePolicy policy, int budget_points = 0) {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.05;
  params.approach.num_directions = 36;
  params.update.policy = policy;
  params.update.budget_points = budget_points;
  params.backend = BackendKind::Cpu;
  return params;
}

TEST(StageTimes, AreTheFrame) {
  for (const FieldParams& params :
       {paramsOf(UpdatePolicy::Exact), paramsOf(UpdatePolicy::Exact, 200), paramsOf(UpdatePolicy::Paper)}) {
    AccessibilityField field(ToolGeometry::builtin("builtin:pencil"), params);
    Frames frames;
    for (int n = 0; n < kFrames; ++n) {
      const auto points_S = wall_S(n);
      const auto start = Clock::now();
      const FrameStats integration = field.integrateScan(points_S, pose_W_S(n));
      const UpdateStats update = field.update();
      frames.add(millisecondsSince(start), sumOf(integration) + sumOf(update));
      EXPECT_GT(integration.integrate_ms, 0);
      EXPECT_GT(integration.mirror_ms, 0);
      EXPECT_GT(update.update_ms, 0);
      EXPECT_GT(update.score_ms, 0);
    }
  }
}

TEST(StageTimes, SortingOutReturnsIsOfThem) {
  AccessibilityField field(ToolGeometry::builtin("builtin:pencil"), paramsOf(UpdatePolicy::Exact));
  const std::vector<Eigen::Vector3f> none_S(300'000, Eigen::Vector3f::Zero());
  const std::vector<Eigen::Vector3d> far_W(300'000, Eigen::Vector3d(0, 0, 1e7));
  const std::vector<Eigen::Vector3d> origin_W = {Eigen::Vector3d::Zero()};
  Frames scans, rays;
  for (int n = 0; n < kFrames; ++n) {
    auto start = Clock::now();
    const FrameStats of_scan = field.integrateScan(none_S, pose_W_S(n));
    scans.add(millisecondsSince(start), sumOf(of_scan));
    EXPECT_EQ(of_scan.points_used, 0u);
    start = Clock::now();
    const FrameStats of_rays = field.integrateRays(far_W, origin_W);
    rays.add(millisecondsSince(start), sumOf(of_rays));
    EXPECT_EQ(of_rays.points_used, 0u);
  }
}

/// The scheduler's work during scans counts as the update's, once.
TEST(StageTimes, OfSeveralScansAnUpdate) {
  for (const UpdatePolicy policy : {UpdatePolicy::Exact, UpdatePolicy::Paper}) {
    AccessibilityField field(ToolGeometry::builtin("builtin:pencil"), paramsOf(policy));
    Frames frames;
    for (int n = 0; n < kFrames; ++n) {
      std::vector<std::vector<Eigen::Vector3f>> scans_S;
      for (int k = 0; k < 4; ++k) scans_S.push_back(wall_S(4 * n + k));
      double stages_ms = 0;
      const auto start = Clock::now();
      for (int k = 0; k < 4; ++k) {
        stages_ms += sumOf(field.integrateScan(scans_S[static_cast<std::size_t>(k)], pose_W_S(n)));
      }
      stages_ms += sumOf(field.update());
      frames.add(millisecondsSince(start), stages_ms);
    }
  }
}

}  // namespace
}  // namespace accessvdb

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The method against exact ground truth on the paper's scenes, 5 and 2 mm. Bands for the product profile are this
/// project's requirements. Bands for the paper profile are the paper's printed figures +-4 points, narrowed on the side
/// on which a broken rule would leave them (docs/PAPER_MAP.md, "Where we differ, and why").
#include <gtest/gtest.h>

#include <algorithm>

#include <cmath>

#include "eval/hidden_point_removal.h"
#include "eval/scene_run.h"

namespace accessvdb::eval {
namespace {

/// One process per test, so scans are only shared within a test.
class BenchmarkScenes : public testing::Test {
 protected:
  std::shared_ptr<const EvaluatedRun> run(const RunRequest& request) { return runner_.run(request); }

  Observer observer_;
  ScanStore scans_{{}, observer_};
  SceneRunner runner_{scans_, BackendKind::Cpu, 0, observer_};
};

#define EXPECT_BETWEEN(value, low, high) \
  do {                                   \
    EXPECT_GE(value, low);               \
    EXPECT_LE(value, high);              \
  } while (false)

RunRequest unclamped(RunRequest request) {
  request.params.tsdf.clamp_min_m = -request.params.resolved().tsdf.truncation_distance_m;
  return request;
}

/// Voxels that a return updates by the product's rule, counted one by one over rays from all around: the double cone
/// of cos 0.95 and what is within v, in the cube of +-4 v.
double doubleConeVoxels() {
  constexpr int kRays = 2000;
  std::uint64_t count = 0;
  for (int n = 0; n < kRays; ++n) {
    // Directions on a spiral, returns anywhere in their voxel (additive sequences, no generator needed).
    const double z = -1 + (2 * n + 1.0) / kRays, turn = 2.399963 * n, flat = std::sqrt(1 - z * z);
    const Eigen::Vector3d ray(flat * std::cos(turn), flat * std::sin(turn), z);
    const Eigen::Vector3d p(std::fmod(0.8191725 * n, 1) - 0.5, std::fmod(0.6710436 * n, 1) - 0.5,
                            std::fmod(0.5497005 * n, 1) - 0.5);
    for (int i = -5; i <= 5; ++i) {
      for (int j = -5; j <= 5; ++j) {
        for (int k = -5; k <= 5; ++k) {
          const Eigen::Vector3d offset = Eigen::Vector3d(i, j, k) - p;
          if (offset.lpNorm<Eigen::Infinity>() > 4) continue;
          count += std::abs(offset.dot(ray)) > 0.95 * offset.norm() || offset.norm() <= 1 ? 1 : 0;
        }
      }
    }
  }
  return static_cast<double>(count) / kRays;
}

TEST_F(BenchmarkScenes, Torus) {
  for (const double voxel_m : {0.005, 0.002}) {
    SCOPED_TRACE(voxel_m);
    const auto product = run(productRun("torus", voxel_m));
    EXPECT_GE(product->shared().f1(), 99.5);
    EXPECT_GE(product->shared().precision(), 99.9);
    // An independent prototype found 2,586 points at 5 mm, 14,748 at 2 mm; 53.6 and 50.9 percent accessible.
    EXPECT_BETWEEN(product->found.size(), voxel_m > 0.004 ? 2400u : 14000u, voxel_m > 0.004 ? 2700u : 15500u);
    EXPECT_BETWEEN(product->shared().truthPercent(), 49, 56);
    // Both halves of the cone, and nothing else. A return off the sensor's axis varies little.
    const double updates = static_cast<double>(product->distance_updates) / static_cast<double>(product->returns);
    EXPECT_NEAR(updates, doubleConeVoxels(), 0.05 * doubleConeVoxels());

    const double printed = voxel_m > 0.004 ? 86.7 : 85.1;
    const Confusion paper = run(paperRun("torus", voxel_m))->shared();
    EXPECT_BETWEEN(paper.f1(), printed - 4, printed + 4);
    EXPECT_BETWEEN(paper.precision(), 70, 82);  // the opposite tube is eroded by the positive clamp
    EXPECT_GE(paper.recall(), 99);
  }
  const Confusion open = run(unclamped(paperRun("torus", 0.002)))->shared();
  // 83 with many tool samples, up to 94 with an unlucky thousand; 99.7 with the clamp.
  EXPECT_BETWEEN(open.recall(), 78, 95);
  EXPECT_GE(open.precision(), 99);
}

TEST_F(BenchmarkScenes, Box) {
  const auto product = run(productRun("box", 0.005));
  EXPECT_GE(product->shared().f1(), 99.5);
  const auto paper = run(paperRun("box", 0.005));
  EXPECT_BETWEEN(paper->shared().f1(), 96.7 - 4, 96.7 + 4);
  // Everything is accessible; the paper's profile only misses points because it does not know the corridor.
  EXPECT_DOUBLE_EQ(paper->shared().truthPercent(), 100);
  EXPECT_BETWEEN(paper->shared().recall(), 91, 97.5);
  EXPECT_GE(paper->reasons[static_cast<int>(PointReason::Unknown)], 9 * paper->shared().false_blocked / 10);
}

TEST_F(BenchmarkScenes, Sphere) {
  const auto product = run(productRun("sphere_a", 0.005));
  EXPECT_GE(product->shared().f1(), 99.5);
  EXPECT_BETWEEN(product->shared().truthPercent(), 93, 97);  // the caps look up and down
  EXPECT_GE(run(paperRun("sphere_a", 0.005))->shared().f1(), 99);
  // No single viewpoint sees the far side.
  const auto from_one = visibleFrom(product->positions_W, product->viewpoints_W.front());
  EXPECT_BETWEEN(100.0 * static_cast<double>(std::count(from_one.begin(), from_one.end(), 1)) /
                     static_cast<double>(from_one.size()),
                 20, 60);
  // All of it is seen from somewhere, so visibility calls everything accessible (paper, HPR).
  const auto visible = visibleFromAny(
      product->positions_W, std::vector<Eigen::Vector3d>(product->viewpoints_W.begin(), product->viewpoints_W.end()));
  const Confusion hpr = compare(product->truth_shared, visible);
  EXPECT_NEAR(hpr.precision(), product->shared().truthPercent(), 1);
  EXPECT_GE(hpr.recall(), 99);
}

TEST_F(BenchmarkScenes, Wall) {
  EXPECT_GE(run(productRun("wall", 0.002))->shared().f1(), 99);
  EXPECT_GE(run(paperRun("wall", 0.005))->shared().f1(), 96);
}

// A tube thinner than a few voxels: negative distances from behind would fill it, so the clamp is needed.
TEST_F(BenchmarkScenes, ThinRingNeedsTheClamp) {
  EXPECT_GE(run(productRun("ring", 0.002))->shared().f1(), 99);
  EXPECT_LT(run(unclamped(productRun("ring", 0.002)))->shared().f1(), 97);
}

TEST_F(BenchmarkScenes, NoisyTorusWithTrueNormals) {
  RunRequest request = productRun("torus", 0.002, 0.002);
  request.scans.frames = 250;
  request.true_normals = true;
  EXPECT_GE(run(request)->exact().f1(), 96);
}

TEST_F(BenchmarkScenes, IncrementalEqualsBatch) {
  RunRequest request = productRun("torus", 0.005);
  request.scans.frames = 250;
  request.update_every = 5;
  const auto incremental = run(request);
  EXPECT_EQ(incremental->labels_unlike_scratch, 0u);
  request.update_every = 0;
  EXPECT_EQ(run(request)->found, incremental->found);
}

}  // namespace
}  // namespace accessvdb::eval

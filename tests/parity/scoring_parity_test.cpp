// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the pipeline says about every point of random maps equals what the plain oracle says: label, reason, score,
/// direction, exactly.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <functional>
#include <random>
#include <string>

#include "parity/scoring_reference.h"

namespace accessvdb::test {
namespace {

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  double uniform(double low, double high) {
    return low + (high - low) * static_cast<double>(engine_() >> 11) * 0x1.0p-53;
  }
  int below(int n) { return static_cast<int>(engine_() % static_cast<std::uint64_t>(n)); }

 private:
  std::mt19937_64 engine_;
};

ToolGeometry boxTool(Random& random, double voxel_size_m) {
  const auto v = static_cast<float>(voxel_size_m);
  const auto size = [&](double low, double high) { return static_cast<float>(random.uniform(low, high)) * v; };
  const Eigen::Vector3f low(size(-1, 4), -size(0.5, 3), -size(0.5, 4)),
      high(low.x() + size(4, 14), size(0.5, 3), size(0.5, 9));
  std::vector<Eigen::Vector3f> vertices;
  for (int n = 0; n < 8; ++n) {
    vertices.emplace_back((n & 1) != 0 ? high.x() : low.x(), (n & 2) != 0 ? high.y() : low.y(),
                          (n & 4) != 0 ? high.z() : low.z());
  }
  return ToolGeometry::fromTriangles(vertices,
                                     {{{0, 2, 1}},
                                      {{1, 2, 3}},
                                      {{4, 5, 6}},
                                      {{5, 7, 6}},
                                      {{0, 1, 4}},
                                      {{1, 5, 4}},
                                      {{2, 6, 3}},
                                      {{3, 6, 7}},
                                      {{0, 4, 2}},
                                      {{2, 4, 6}},
                                      {{1, 3, 5}},
                                      {{3, 7, 5}}},
                                     "box");
}

/// A world of a few dozen voxels: clutter, or a rough wall with clutter before it, anywhere around the origin.
std::vector<RayScan> randomScans(Random& random, double v) {
  const Eigen::Vector3d centre(random.uniform(-40, 40) * v, random.uniform(-40, 40) * v, random.uniform(-40, 40) * v);
  const bool wall = random.below(2) == 0;
  const double yaw = random.uniform(0, 6.3), lean = random.uniform(-0.7, 0.7);
  const Eigen::Vector3d normal(std::cos(yaw), std::sin(yaw), lean), along(-std::sin(yaw), std::cos(yaw), 0);
  const double half = random.uniform(5, 10) * v;
  std::vector<RayScan> scans;
  for (int scan = 0; scan < 5; ++scan) {
    RayScan& rays = scans.emplace_back();
    const double sensor_yaw = yaw + random.uniform(-1.5, 1.5);
    const double range = random.uniform(30, 80) * v;
    const Eigen::Vector3d sensor =
        centre + range * Eigen::Vector3d(std::cos(sensor_yaw), std::sin(sensor_yaw), random.uniform(-0.5, 0.5));
    for (int n = 0; n < 90; ++n) {
      Eigen::Vector3d p = centre;
      if (wall && random.below(8) != 0) {
        const double u = random.uniform(-half, half), w = random.uniform(-half, half);
        p += u * along + w * Eigen::Vector3d(0, 0, 1) - w * lean * Eigen::Vector3d(std::cos(yaw), std::sin(yaw), 0) +
             random.uniform(-0.5, 0.5) * v * normal;
      } else {
        p += Eigen::Vector3d(random.uniform(-half, half), random.uniform(-half, half), random.uniform(-half, half));
      }
      rays.points_W.push_back(p);
      rays.origins_W.push_back(sensor + Eigen::Vector3d(random.uniform(-v, v), random.uniform(-v, v), 0));
    }
  }
  return scans;
}

FieldParams randomParams(Random& random) {
  constexpr std::array<double, 6> kVoxels = {0.02, 0.025, 0.0375, 0.05, 0.0625, 0.1};
  constexpr std::array<int, 6> kDirections = {4, 17, 36, 90, 180, 256};
  FieldParams params;
  params.tsdf.voxel_size_m = kVoxels[static_cast<std::size_t>(random.below(6))];
  params.tsdf.range_noise_m = random.below(3) * 0.5 * params.tsdf.voxel_size_m;
  params.approach.num_directions = kDirections[static_cast<std::size_t>(random.below(6))];
  if (random.below(4) == 0) params.approach.normal_cone_rad = random.uniform(0.2, 1.5);
  if (random.below(3) == 0) params.approach.corridor_length_m = random.uniform(8, 30) * params.tsdf.voxel_size_m;
  if (random.below(2) == 0) params.scoring.max_collisions = 1 + random.below(20);
  if (random.below(4) == 0) params.scoring.self_exclusion_voxels = random.uniform(0, 5);
  params.scoring.join_neighbour_views = random.below(4) != 0;
  params.scoring.mean_positions = random.below(4) != 0;
  params.scoring.neighbourhood_weight = random.below(4) != 0;
  return params;
}

ToolGeometry randomTool(Random& random, double v) {
  const int kind = random.below(4);
  if (kind == 0) return ToolGeometry::builtin("builtin:pencil");
  if (kind == 1 && v >= 0.05) return ToolGeometry::builtin("builtin:pruner");
  return boxTool(random, v);
}

struct Tally {
  std::array<std::uint64_t, kNumPointReasons> reasons = {};
  std::uint64_t scores_above_zero = 0, normals = 0;
};

/// @param everything  also reason, score and direction of blocked points, which only a single evaluation promises
void expectEqual(const FieldSnapshot& snapshot, const std::vector<BruteForceResult>& expected, bool everything,
                 const std::string& where) {
  ASSERT_EQ(snapshot.points.size(), expected.size()) << where;
  for (std::size_t id = 0; id < expected.size(); ++id) {
    const SurfacePoint& is = snapshot.points[id];
    const BruteForceResult& should = expected[id];
    ASSERT_EQ(name(is.label), name(should.label))
        << where << " point " << id << " " << name(is.reason) << " / " << name(should.reason);
    ASSERT_FLOAT_EQ(is.confidence, static_cast<float>(should.confidence)) << where << " point " << id;
    if (!everything && is.label != PointLabel::Accessible) continue;
    ASSERT_EQ(name(is.reason), name(should.reason)) << where << " point " << id;
    ASSERT_EQ(is.score, should.score) << where << " point " << id << " " << name(is.reason);
    ASSERT_EQ(is.direction, should.direction) << where << " point " << id << " " << name(is.reason);
  }
}

/// Two eigensolvers in double differ by about 1e-15 / gap, the normal is stored in float32: 1e-6 holds for both where
/// the gap exceeds 1e-6. The side is left open where the sensor lies in the plane, as its mean is quantised.
void expectNormalsEqual(const FieldSnapshot& snapshot, const std::vector<BruteForceResult>& expected, Tally& tally) {
  for (std::size_t id = 0; id < expected.size(); ++id) {
    const SurfacePoint& is = snapshot.points[id];
    const BruteForceResult& should = expected[id];
    if (should.label == PointLabel::Unscored) continue;
    ASSERT_NEAR(is.normal_W.norm(), 1, 1e-6);
    if (should.pca_gap < 1e-6) continue;
    const Eigen::Vector3d normal = is.normal_W.cast<double>();
    ASSERT_LT(normal.cross(should.pca_normal).norm(), 1e-6) << id;
    if (should.pca_side > 1e-3) {
      ASSERT_GT(normal.dot(should.pca_normal), 0) << id;
    }
    ++tally.normals;
  }
}

void expectSamePoints(const FieldSnapshot& snapshot, const std::vector<GatheredPoint>& points) {
  ASSERT_EQ(snapshot.points.size(), points.size());
  for (std::size_t id = 0; id < points.size(); ++id) {
    ASSERT_EQ(snapshot.points[id].id, id);
    const Eigen::Vector3f p_L = (snapshot.points[id].position_W - snapshot.origin_W).cast<float>();
    ASSERT_EQ(p_L, points[id].first_L) << id;
  }
}

/// A direction's rank by the rule, lower is better; only directions in the cone come here.
std::array<double, 5> rankOf(const BruteForceDirection& d) {
  const bool tool = d.seen && !d.arm_blocked;
  return {d.seen ? (tool ? 0.0 : 1.0) : 2.0, -static_cast<double>(d.arm_passed), static_cast<double>(d.collisions),
          -static_cast<double>(d.dot), static_cast<double>(d.index)};
}

/// The oracle for the sample form: stages before the tool from bruteForceDirections, the samples counted one by one.
void scoreWithSamples(const AccessibilityField& field, const BruteForceInput& input,
                      std::vector<BruteForceResult>& results) {
  const internal::ToolKernel kernel = toolKernel(field);
  const auto inverse = static_cast<float>(1.0 / input.voxel_size_m);
  for (std::size_t id = 0; id < results.size(); ++id) {
    BruteForceResult& result = results[id];
    if (result.label == PointLabel::Unscored) continue;
    const BruteForcePoint& point = input.points[id];
    const BruteForceDirection* best = nullptr;
    auto directions = bruteForceDirections(input, point, result.normal, result.effective_seen);
    for (BruteForceDirection& d : directions) {
      if (!d.in_cone) continue;
      if (d.collisions == 0) {  // it reached the tool
        const auto index = static_cast<std::size_t>(d.index);
        for (std::size_t n = kernel.sample_begin[index]; n < kernel.sample_begin[index + 1]; ++n) {
          VoxelCoord voxel;
          for (std::size_t a = 0; a < 3; ++a) {
            const float x = point.first_position_L[static_cast<int>(a)] + kernel.samples[3 * n + a];
            const float scaled = x * inverse;
            voxel[a] = static_cast<std::int32_t>(std::floor(scaled + 0.5f));
          }
          const MapVoxel there = input.map(voxel);
          if (there.observed && there.distance_m < input.collision_distance_m) ++d.collisions;
        }
      }
      if (best == nullptr || rankOf(d) < rankOf(*best)) best = &d;
    }
    result.score = kNoScore;
    if (best == nullptr || best->collisions < 0) continue;  // decided before the tool: the oracle's word stands
    result.score = static_cast<std::uint16_t>(best->collisions);
    result.direction = static_cast<std::uint16_t>(best->index);
    const bool free = best->collisions < kernel.collision_limit;
    result.label = free ? PointLabel::Accessible : PointLabel::Blocked;
    result.reason = free ? PointReason::None : PointReason::Tool;
  }
}

void checkSeed(std::uint64_t seed, bool samples, Tally& tally) {
  Random random(seed);
  FieldParams params = randomParams(random);
  const double v = params.tsdf.voxel_size_m;
  if (samples) {
    params.scoring.form = ToolForm::SurfaceSamples;
    params.scoring.surface_samples = 50 + random.below(300);
  }
  const ToolGeometry tool = randomTool(random, v);
  const std::vector<RayScan> scans = randomScans(random, v);
  AccessibilityField field(tool, params), once(tool, params);
  for (const RayScan& scan : scans) {
    EXPECT_EQ(field.integrateRays(scan.points_W, scan.origins_W).points_used, scan.points_W.size());
    field.update();
    once.integrateRays(scan.points_W, scan.origins_W);
  }
  once.update();

  const FieldSnapshot at_once = once.snapshot();
  const auto points = gatherPoints(scans, once.params(), once.origin_W());
  expectSamePoints(at_once, points);
  if (testing::Test::HasFatalFailure()) return;
  BruteForceInput input = oracleInput(once, points, at_once);
  const DenseMap map = copyOfMap(once.volume());
  input.map = std::ref(map);
  if (samples) input.tool_voxels.assign(static_cast<std::size_t>(input.num_directions), {});
  std::vector<BruteForceResult> expected = bruteForceScore(input);
  if (samples) scoreWithSamples(once, input, expected);

  const std::string where = "seed " + std::to_string(seed);
  expectEqual(at_once, expected, true, where + ", one update");
  expectEqual(field.evaluateFromScratch(), expected, true, where + ", from scratch");
  expectEqual(field.snapshot(), expected, false, where + ", an update a scan");
  expectNormalsEqual(at_once, expected, tally);
  for (const BruteForceResult& result : expected) {
    ++tally.reasons[static_cast<std::size_t>(result.reason)];
    tally.scores_above_zero += result.label == PointLabel::Accessible && result.score > 0 ? 1 : 0;
  }
}

TEST(ScoringParity, EqualsBruteForceOnRandomMaps) {
  Tally tally;
  for (std::uint64_t seed = 1; seed <= 60 && !HasFailure(); ++seed) checkSeed(seed, false, tally);
  // The comparison means something only where every outcome comes up, and often.
  for (int reason = 0; reason < kNumPointReasons; ++reason) {
    EXPECT_GT(tally.reasons[static_cast<std::size_t>(reason)], 40u) << name(static_cast<PointReason>(reason));
    RecordProperty(name(static_cast<PointReason>(reason)),
                   std::to_string(tally.reasons[static_cast<std::size_t>(reason)]));
  }
  EXPECT_GT(tally.scores_above_zero, 100u);
  EXPECT_GT(tally.normals, 3000u);
}

TEST(ScoringParity, SurfaceSamplesEqualBruteForceOnRandomMaps) {
  Tally tally;
  for (std::uint64_t seed = 1001; seed <= 1020 && !HasFailure(); ++seed) checkSeed(seed, true, tally);
  EXPECT_GT(tally.reasons[static_cast<std::size_t>(PointReason::None)], 40u);
  EXPECT_GT(tally.reasons[static_cast<std::size_t>(PointReason::Tool)], 40u);
  EXPECT_GT(tally.scores_above_zero, 40u);
}

}  // namespace
}  // namespace accessvdb::test

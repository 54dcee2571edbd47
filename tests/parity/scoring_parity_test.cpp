// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the pipeline says about every point of random maps equals what the plain oracle says: label, reason, score,
/// direction, exactly.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <string>

#include "accessvdb/access_map.h"
#include "parity/random_world.h"
#include "parity/scoring_reference.h"

namespace accessvdb::test {
namespace {

struct Tally {
  std::array<std::uint64_t, kNumPointReasons> reasons = {};
  std::uint64_t scores_above_zero = 0, normals = 0, rolled = 0;
};

/// @param rolls  per direction: the oracle's directions are d rolls + roll
/// @param everything  also reason, score and direction of blocked points, which only a single evaluation guarantees
void expectEqual(const FieldSnapshot& snapshot, const std::vector<BruteForceResult>& expected, int rolls,
                 bool everything, const std::string& where) {
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
    const int direction = is.direction == kNoDirection ? kNoDirection : is.direction * rolls + is.roll;
    ASSERT_EQ(direction, should.direction) << where << " point " << id << " " << name(is.reason);
  }
}

/// Two eigensolvers in double differ by about 1e-15 / gap, and the normal is stored in float32: 1e-6 is enough for both
/// if the gap exceeds 1e-6. The side is not checked if the sensor is in the plane, as its mean is quantised.
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

/// A direction's rank by the rule, lower is better; only directions in the cone get here.
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
        const auto rolls = static_cast<std::size_t>(kernel.rolls.count), n_th = static_cast<std::size_t>(d.index);
        const std::size_t index = rolls == 1 ? n_th : n_th / rolls * (rolls + 1) + 1 + n_th % rolls;
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
    if (best == nullptr || best->collisions < 0) continue;  // decided before the tool: the oracle's result stands
    result.score = static_cast<std::uint16_t>(best->collisions);
    result.direction = static_cast<std::uint16_t>(best->index);
    const bool free = best->collisions < kernel.collision_limit;
    result.label = free ? PointLabel::Accessible : PointLabel::Blocked;
    result.reason = free ? PointReason::None : PointReason::Tool;
  }
}

/// What accessMap() says of every direction of some points, against the oracle's; and that asking changes nothing.
void expectAccessMapsEqual(const AccessibilityField& field, const FieldSnapshot& snapshot, const BruteForceInput& input,
                           const std::vector<BruteForceResult>& expected) {
  for (std::size_t id = 0; id < expected.size(); id += 1 + expected.size() / 12) {
    const std::optional<AccessMap> map = field.accessMap(snapshot.points[id].position_W);
    ASSERT_TRUE(map);
    ASSERT_EQ(map->point.id, id);
    ASSERT_EQ(map->collision_limit, input.collision_limit);
    const int rolls = field.params().approach.rolls;
    ASSERT_EQ(map->directions.size(), static_cast<std::size_t>(input.num_directions / rolls));
    if (expected[id].label == PointLabel::Unscored) continue;  // its normal is not published
    const auto directions =
        bruteForceDirections(input, input.points[id], expected[id].normal, expected[id].effective_seen);
    std::vector<int> least(map->directions.size(), -1);  // of all rolls, the first that has it
    for (const BruteForceDirection& d : directions) {
      int& best = least[static_cast<std::size_t>(d.index / rolls)];
      if (best < 0 || d.collisions < directions[static_cast<std::size_t>(best)].collisions) best = d.index;
    }
    for (const int best : least) {
      const BruteForceDirection& d = directions[static_cast<std::size_t>(best)];
      const DirectionOutcome& outcome = map->directions[static_cast<std::size_t>(best / rolls)];
      PointReason reason = d.collisions < input.collision_limit ? PointReason::None : PointReason::Tool;
      if (d.arm_blocked) reason = d.arm_unknown ? PointReason::Unknown : PointReason::Arm;
      if (!d.seen) reason = PointReason::Unseen;
      if (!d.in_cone) reason = PointReason::Normal;
      ASSERT_EQ(name(outcome.reason), name(reason)) << "point " << id << ", direction " << d.index;
      ASSERT_EQ(outcome.score, d.collisions < 0 ? kNoScore : d.collisions) << "point " << id;
      ASSERT_EQ(outcome.roll, d.collisions < 0 ? 0 : best % rolls) << "point " << id;
    }
    const SurfacePoint after = *field.pointAt(snapshot.points[id].position_W);
    ASSERT_EQ(after.label, snapshot.points[id].label);
    ASSERT_EQ(after.direction, snapshot.points[id].direction);
    ASSERT_EQ(after.stability, snapshot.points[id].stability);
  }
  EXPECT_FALSE(field.accessMap({1e5, 0, 0}));
  EXPECT_FALSE(field.accessMap({std::numeric_limits<double>::quiet_NaN(), 0, 0}));
}

/// Sets of more directions than a mask holds.
void chooseWideOrientations(Random& random, ApproachParams& approach) {
  approach.rolls = random.below(2) == 0 ? 1 : 2 + random.below(3);
  approach.num_directions = 60 + random.below(60);
  switch (random.below(3)) {
    case 0:
      approach.orientations = OrientationSet::sphere(random.below(2) == 0 ? 9 : 7.5);
      break;
    case 1:
      approach.orientations = OrientationSet::pitch(-40, 40, 20);
      break;
    default: {
      std::vector<ToolOrientation> list;
      for (int n = 257 + random.below(400); n > 0; --n) {
        list.push_back(orientationOf(random.uniform(-360, 360), random.below(9) == 0 ? 0 : random.uniform(-90, 90),
                                     random.uniform(-180, 180)));
      }
      approach.orientations = OrientationSet::of(std::move(list));
      break;
    }
  }
}

enum class Sets { Yaw, Oriented, Wide };

void checkSeed(std::uint64_t seed, bool samples, Tally& tally, Sets sets = Sets::Yaw) {
  Random random(seed);
  FieldParams params = randomParams(random);
  if (sets == Sets::Oriented) chooseOrientations(random, params.approach);
  if (sets == Sets::Wide) chooseWideOrientations(random, params.approach);
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
  const int rolls = field.params().approach.rolls;
  expectEqual(at_once, expected, rolls, true, where + ", one update");
  expectEqual(field.evaluateFromScratch(), expected, rolls, true, where + ", from scratch");
  // Of a wide set nothing is remembered of a point that a change might reach.
  expectEqual(field.snapshot(), expected, rolls, sets == Sets::Wide, where + ", an update a scan");
  if (!samples) expectAccessMapsEqual(once, at_once, input, expected);
  expectNormalsEqual(at_once, expected, tally);
  for (const BruteForceResult& result : expected) {
    ++tally.reasons[static_cast<std::size_t>(result.reason)];
    if (result.direction != kNoDirection) tally.rolled += result.direction % rolls > 0 ? 1 : 0;
    tally.scores_above_zero += result.label == PointLabel::Accessible && result.score > 0 ? 1 : 0;
  }
}

TEST(ScoringParity, EqualsBruteForceOnRandomMaps) {
  Tally tally;
  for (std::uint64_t seed = 1; seed <= 60 && !HasFailure(); ++seed) checkSeed(seed, false, tally);
  // The comparison is only meaningful if every outcome occurs, and often.
  for (int reason = 0; reason < kNumPointReasons; ++reason) {
    const auto of_field = {PointReason::Changed, PointReason::BesideSurface};  // not of the search
    if (std::ranges::find(of_field, static_cast<PointReason>(reason)) != of_field.end()) continue;
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

/// Any orientations. Most points have directions in the cone, whatever their normal.
TEST(ScoringParity, OrientationsEqualBruteForceOnRandomMaps) {
  Tally tally;
  for (std::uint64_t seed = 2001; seed <= 2060 && !HasFailure(); ++seed) checkSeed(seed, false, tally, Sets::Oriented);
  for (std::uint64_t seed = 2101; seed <= 2108 && !HasFailure(); ++seed) checkSeed(seed, true, tally, Sets::Oriented);
  for (const PointReason reason : {PointReason::None, PointReason::Unknown, PointReason::Arm, PointReason::Tool}) {
    EXPECT_GT(tally.reasons[static_cast<std::size_t>(reason)], 40u) << name(reason);
  }
  EXPECT_GT(tally.scores_above_zero, 100u);
  EXPECT_GT(tally.rolled, 100u);
}

/// The minimum of the total order over all orientations, for every point and roll.
TEST(ScoringParity, WideSetsEqualBruteForceOnRandomMaps) {
  Tally tally;
  for (std::uint64_t seed = 3001; seed <= 3010 && !HasFailure(); ++seed) checkSeed(seed, false, tally, Sets::Wide);
  for (std::uint64_t seed = 3101; seed <= 3102 && !HasFailure(); ++seed) checkSeed(seed, true, tally, Sets::Wide);
  for (const PointReason reason : {PointReason::None, PointReason::Unknown, PointReason::Arm, PointReason::Tool}) {
    EXPECT_GT(tally.reasons[static_cast<std::size_t>(reason)], 30u) << name(reason);  // worlds differ by compiler
  }
  EXPECT_GT(tally.scores_above_zero, 40u);
  EXPECT_GT(tally.rolled, 40u);
}

}  // namespace
}  // namespace accessvdb::test

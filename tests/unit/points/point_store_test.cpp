// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/point_store.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <map>
#include <numeric>
#include <set>
#include <tuple>
#include <utility>

#include "unit/points/random_points.h"

namespace accessvdb::internal {
namespace {

using test::directionTable;
using test::pointParams;
using test::Random;

struct Scan {
  std::vector<Eigen::Vector3f> p, q;
};

/// Returns in a few voxels around the origin, so that each voxel gets several, from one sensor or from many.
std::vector<Scan> randomScans(std::uint64_t seed, double v, bool rays) {
  Random random(seed);
  std::vector<Scan> scans(6);
  for (Scan& scan : scans) {
    for (int n = 0; n < 500; ++n) scan.p.push_back(random.point(4 * v));
    for (int n = 0; n < (rays ? 500 : 1); ++n) scan.q.push_back(random.point(2));
  }
  return scans;
}

/// The order in which a scan's points come.
struct LeafByLeaf {
  bool operator()(const Index3& a, const Index3& b) const {
    return std::make_pair(parentOf(a), a) < std::make_pair(parentOf(b), b);
  }
};

Index3 voxelOf(const Eigen::Vector3f& p, double v) {
  Index3 voxel;
  for (int a = 0; a < 3; ++a) {
    const float scaled = p[a] * static_cast<float>(1 / v);
    voxel[static_cast<std::size_t>(a)] = static_cast<std::int32_t>(std::floor(scaled + 0.5f));
  }
  return voxel;
}

class PointStoreSums : public testing::TestWithParam<bool> {};

TEST_P(PointStoreSums, EqualPlainSums) {
  const double v = 0.05;
  const FieldParams params = pointParams(v, 180);
  const std::vector<float> xy = directionTable(180).xy;
  PointStore store(params, {xy, {}});
  struct Plain {
    Eigen::Vector3f first;
    Eigen::Vector3d sum = Eigen::Vector3d::Zero(), sensor = Eigen::Vector3d::Zero();
    std::size_t first_scan = 0, count = 0;
    std::vector<bool> seen = std::vector<bool>(180, false);
  };
  std::map<Index3, Plain> plain;
  const std::vector<Scan> scans = randomScans(1, v, GetParam());
  for (std::size_t s = 0; s < scans.size(); ++s) {
    const std::size_t before = plain.size();
    std::map<Index3, int, LeafByLeaf> of_scan;
    for (std::size_t n = 0; n < scans[s].p.size(); ++n) {
      const Eigen::Vector3f &p = scans[s].p[n], &q = scans[s].q[scans[s].q.size() == 1 ? 0 : n];
      const auto [entry, is_new] = plain.try_emplace(voxelOf(p, v));
      Plain& point = entry->second;
      if (is_new) point.first = p, point.first_scan = s;
      const bool least =
          std::make_tuple(p.x(), p.y(), p.z()) < std::make_tuple(point.first.x(), point.first.y(), point.first.z());
      if (point.first_scan == s && least) point.first = p;
      point.sum += p.cast<double>();
      point.sensor += q.cast<double>();
      ++point.count;
      const Eigen::Vector3f u = (q - p).normalized();
      for (std::size_t d = 0; d < 180; ++d) {
        if (u.x() * xy[2 * d] + u.y() * xy[2 * d + 1] > 0.25f) point.seen[d] = true;
      }
      ++of_scan[entry->first];
    }
    const TouchedPoints touched = store.addReturns(scans[s].p, scans[s].q);
    ASSERT_EQ(touched.new_points, plain.size() - before);
    ASSERT_EQ(touched.all.size(), of_scan.size());
    std::size_t n = 0;
    for (const auto& [voxel, count] : of_scan) ASSERT_EQ(touched.all[n++], store.index().find(voxel));
  }
  ASSERT_EQ(store.size(), plain.size());
  for (const auto& [voxel, point] : plain) {
    const std::uint32_t id = store.index().find(voxel);
    ASSERT_NE(id, kNone);
    ASSERT_EQ(store.first_L(id), point.first);
    ASSERT_EQ(store.voxelOf(store.first_L(id)), voxel);
    const auto n = static_cast<double>(point.count);
    // Sums are kept in 2^-20 voxels and 2^-16 m, half a step each way; the mean is rounded to float32 once.
    ASSERT_LT((store.pca_L(id).cast<double>() - point.sum / n).cwiseAbs().maxCoeff(), v * 0x1p-21 + 0x1p-24);
    ASSERT_LT((store.meanSensor_L(id) - point.sensor / n).cwiseAbs().maxCoeff(), 0x1p-17 * 1.0001);
    std::size_t differing = 0;
    for (int d = 0; d < 180; ++d)
      differing += store.seen(id).test(d) != point.seen[static_cast<std::size_t>(d)] ? 1 : 0;
    ASSERT_EQ(differing, 0u);
  }
}

INSTANTIATE_TEST_SUITE_P(OneSensorOrMany, PointStoreSums, testing::Bool());

TEST(PointStore, OrderInsideAScanDoesNotMatter) {
  for (const bool viewpoints : {false, true}) {
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      FieldParams params = pointParams(0.05, 36);
      params.approach.viewpoints = viewpoints;
      std::vector<Scan> scans = randomScans(seed, 0.05, seed % 2 == 0);
      PointStore a(params, directionTable(36)), b(params, directionTable(36));
      for (Scan& scan : scans) {
        const TouchedPoints touched = a.addReturns(scan.p, scan.q);
        std::vector<std::size_t> order(scan.p.size());
        std::iota(order.begin(), order.end(), std::size_t{0});
        std::shuffle(order.begin(), order.end(), std::mt19937_64(seed));
        Scan shuffled;
        for (const std::size_t n : order) {
          shuffled.p.push_back(scan.p[n]);
          if (scan.q.size() > 1) shuffled.q.push_back(scan.q[n]);
        }
        if (scan.q.size() == 1) shuffled.q = scan.q;
        ASSERT_EQ(b.addReturns(shuffled.p, shuffled.q).all, touched.all);
      }
      ASSERT_EQ(a.size(), b.size());
      for (std::uint32_t id = 0; id < a.size(); ++id) {
        ASSERT_EQ(a.first_L(id), b.first_L(id));
        ASSERT_EQ(a.pca_L(id), b.pca_L(id));
        ASSERT_EQ(a.meanSensor_L(id), b.meanSensor_L(id));
        ASSERT_TRUE(a.seen(id) == b.seen(id));
      }
    }
  }
}

/// Near ones are sorted by numbers of few bits, others and many by their places.
TEST(PointStore, NewPointsComeInTheOrderOfTheirVoxels) {
  const double v = 0.05;
  for (const auto& [spread_m, returns] : {std::pair(0.4, 500), std::pair(30.0, 500),
                                          std::pair(0.9 * kFarthestVoxel * v, 500), std::pair(10.0, 140'000)}) {
    PointStore store(pointParams(v, 36), directionTable(36));
    Random random(5);
    std::vector<Eigen::Vector3f> p;
    for (int n = 0; n < returns; ++n) p.push_back(random.point(spread_m));
    store.addReturns(p, std::vector<Eigen::Vector3f>{{0, 0, 2}});
    std::set<std::uint64_t> places;
    for (const Eigen::Vector3f& p_L : p) places.insert(placeOf(store.voxelOf(p_L)));
    ASSERT_EQ(store.size(), places.size());
    std::uint32_t id = 0;
    for (const std::uint64_t place : places) {
      ASSERT_EQ(placeOf(store.voxelOf(store.first_L(id))), place);
      ASSERT_EQ(store.index().find(voxelAt(place)), id++);
    }
  }
}

TEST(PointStore, ItsPartsMayRunInEitherOrder) {
  for (const bool rays : {false, true}) {
    const FieldParams params = pointParams(0.05, 36);
    PointStore whole(params, directionTable(36)), parts(params, directionTable(36));
    whole.describeTouched(true);
    parts.describeTouched(true);
    for (const Scan& scan : randomScans(7, 0.05, rays)) {
      const TouchedPoints& expected = whole.addReturns(scan.p, scan.q);
      const TouchedPoints& touched = parts.placeReturns(scan.p, scan.q);
      parts.sumReturns(scan.p, scan.q);
      parts.indexNew();
      parts.endReturns();
      ASSERT_EQ(touched.all, expected.all);
      ASSERT_EQ(touched.changed_blocks, expected.changed_blocks);
      ASSERT_EQ(touched.deltas.size(), expected.all.size());
      for (std::size_t n = 0; n < touched.deltas.size(); ++n) {
        const kernels::PointDelta &delta = touched.deltas[n], &other = expected.deltas[n];
        ASSERT_EQ(delta.id, touched.all[n]);
        ASSERT_EQ(delta.block, parts.index().blockAt(parentOf(parts.voxelOf(parts.first_L(delta.id)))));
        ASSERT_EQ(delta.block, other.block);
        ASSERT_EQ(delta.block, parts.blockOf(delta.id));
        ASSERT_TRUE(std::ranges::equal(delta.mean_L, other.mean_L));
        ASSERT_TRUE(delta.seen == other.seen);
      }
    }
    EXPECT_EQ(parts.addReturns({}, std::vector<Eigen::Vector3f>{{0, 0, 1}}).all.size(), 0u);
  }
}

TEST(PointStore, FirstReturnsWhereMeansAreOff) {
  FieldParams params = pointParams(1);
  params.scoring.mean_positions = false;
  PointStore store(params, directionTable(36));
  const std::vector<Eigen::Vector3f> q = {{5, 0, 0}};
  store.addReturns(std::vector<Eigen::Vector3f>{{0.2f, 0.1f, 0}, {0.1f, 0.4f, 0.3f}, {0.1f, 0.4f, -0.3f}}, q);
  store.addReturns(std::vector<Eigen::Vector3f>{{-0.4f, 0, 0}}, q);  // lower, but from a later scan
  ASSERT_EQ(store.size(), 1u);
  EXPECT_EQ(store.first_L(0), Eigen::Vector3f(0.1f, 0.4f, -0.3f));
  EXPECT_EQ(store.pca_L(0), store.first_L(0));
}

TEST(PointStore, RestoresWhatAGateLetsThroughAndNothingElse) {
  const float v = 0.05f;
  const FieldParams params = pointParams(v);
  PointStore store(params, directionTable(36));
  store.addReturns(std::vector<Eigen::Vector3f>{{0.01f, 0, 0}}, std::vector<Eigen::Vector3f>{{2, 0, 0}});
  const auto restores = [&](const Eigen::Vector3f& first_L) {
    StoredPoint point = store.stored(0);
    point.first_L = first_L;
    return PointStore(params, directionTable(36)).restore(std::vector<StoredPoint>{point});
  };
  EXPECT_TRUE(restores({0.01f, 0, 0}));
  EXPECT_TRUE(restores({0, static_cast<float>(1e6 * v), 0}));
  EXPECT_FALSE(restores({0, static_cast<float>(1.00001e6 * v), 0}));
  EXPECT_FALSE(restores({0, 0, -1048576 * v}));  // whose leaf does not fit into placeOf()
}

/// A further return adds nothing to the sums: a count that began again at 0 would have no mean.
TEST(PointStore, CountsNoFurtherThan32Bits) {
  const FieldParams params = pointParams(1);
  const std::vector<Eigen::Vector3f> p = {{0.25f, 0, 0}}, q = {{5, 0, 0}};
  PointStore store(params, directionTable(36));
  store.addReturns(p, q);
  StoredPoint point = store.stored(0);
  constexpr std::uint32_t kMost = std::numeric_limits<std::uint32_t>::max();
  for (std::size_t axis = 0; axis < 3; ++axis) {
    point.sums.offset[axis] *= kMost - 1;
    point.sums.sensor[axis] *= kMost - 1;
  }
  point.sums.returns = kMost - 1;
  PointStore full(params, directionTable(36));
  ASSERT_TRUE(full.restore(std::vector<StoredPoint>{point}));
  for (int n = 0; n < 3; ++n) full.addReturns(p, q);
  EXPECT_EQ(full.stored(0).sums.returns, kMost);
  EXPECT_EQ(full.pca_L(0), store.pca_L(0));
  EXPECT_EQ(full.meanSensor_L(0), store.meanSensor_L(0));
  full.addReturns(p, std::vector<Eigen::Vector3f>{{-5, 0, 0}});
  EXPECT_TRUE(full.seen(0).test(18));  // what it is seen from still counts
}

/// docs/PAPER_MAP.md, "Surface points": a viewpoint is stored if none is closer than 0.10 m, up to eight, and none
/// is ever replaced.
TEST(PointStore, ViewpointsKeepTheirDistanceAndAreNeverReplaced) {
  FieldParams params = pointParams(1);
  params.approach.viewpoints = true;
  PointStore store(params, directionTable(36));
  const std::vector<Eigen::Vector3f> p = {{0, 0, 0}};
  const auto look = [&](float x, float y) {
    const std::vector<Eigen::Vector3f> q = {{x, y, 0}};
    store.addReturns(p, q);
  };
  look(5, 0);
  look(5, 0);
  look(5.09f, 0);
  look(5, 0.0999f);
  EXPECT_EQ(store.stored(0).seen.views.count, 1u);
  look(5.101f, 0);
  EXPECT_EQ(store.stored(0).seen.views.count, 2u);
  look(5.2f, 0.02f);  // 0.101 m from the second
  EXPECT_EQ(store.stored(0).seen.views.count, 3u);
  const DirectionMask east = store.seen(0);
  EXPECT_TRUE(east.test(0));
  EXPECT_FALSE(east.test(18));
  for (int n = 0; n < 5; ++n) look(6 + static_cast<float>(n), 0);
  EXPECT_EQ(store.stored(0).seen.views.count, 8u);
  look(-5, 0);
  EXPECT_EQ(store.stored(0).seen.views.count, 8u);
  EXPECT_FALSE(store.seen(0).test(18));  // no more room for the view from the west
  std::uint64_t joined = std::uint64_t{1} << 18;
  store.joinSeen(0, std::span(&joined, 1));
  EXPECT_EQ(joined, store.seen(0).word[0] | std::uint64_t{1} << 18);
  EXPECT_EQ(store.poses()[store.stored(0).seen.views.pose[0]], Eigen::Vector3f(5, 0, 0));
  EXPECT_EQ(store.poses()[store.stored(0).seen.views.pose[7]], Eigen::Vector3f(10, 0, 0));
}

}  // namespace
}  // namespace accessvdb::internal

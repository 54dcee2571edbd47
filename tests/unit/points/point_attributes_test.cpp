// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Attributes of points against plain counting: a map from voxel to the number of returns with each value.
#include "points/point_attributes.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <limits>
#include <map>
#include <numeric>
#include <tuple>
#include <vector>

#include "points/point_store.h"
#include "unit/points/random_points.h"

namespace accessvdb::internal {
namespace {

using test::directionTable;
using test::pointParams;
using test::Random;

constexpr double kVoxel_m = 0.05;
constexpr std::int32_t kLeastValue = kNoAttribute + 1, kMostValue = std::numeric_limits<std::int32_t>::max();

struct CarryingScan {
  std::vector<Eigen::Vector3f> p, q;
  std::vector<std::int32_t> rows;  ///< [p x 3]: a tree, a class that most share, a number of its own
};

/// Several returns per voxel, some at the same place; values from the ends of the range, and none.
std::vector<CarryingScan> carryingScans(std::uint64_t seed, int returns = 800) {
  Random random(seed);
  const std::int32_t trees[] = {kLeastValue, -1, 0, 7, 8, kMostValue, kNoAttribute, kNoAttribute};
  std::vector<CarryingScan> scans(5);
  for (CarryingScan& scan : scans) {
    scan.q.push_back(random.point(2));
    for (int n = 0; n < returns; ++n) {
      const bool again = n > 0 && random.below(8) == 0;
      scan.p.push_back(again ? scan.p.back() : random.point(4 * kVoxel_m));
      for (const std::int32_t value : {trees[random.below(8)], random.below(20) == 0 ? 1 : 5, n}) {
        scan.rows.push_back(value);
      }
    }
  }
  return scans;
}

PointStore emptyStore() {
  PointStore store(pointParams(kVoxel_m), directionTable(36));
  store.carry({{"tree", Keep::Majority}, {"class", Keep::Majority}, {"row", Keep::First}});
  return store;
}

PointStore storeOf(const std::vector<CarryingScan>& scans) {
  PointStore store = emptyStore();
  for (const CarryingScan& scan : scans) store.addReturns(scan.p, scan.q, scan.rows);
  return store;
}

std::vector<std::int32_t> valuesOf(const PointStore& store) {
  std::vector<std::int32_t> values;
  for (std::uint32_t id = 0; id < store.size(); ++id) {
    for (std::size_t c = 0; c < 3; ++c) values.push_back(store.attributes().value(id, c));
  }
  return values;
}

TEST(PointAttributes, AreThoseOfMostReturnsByPlainCounting) {
  const std::vector<CarryingScan> scans = carryingScans(1);
  const PointStore store = storeOf(scans);
  using Key = std::tuple<std::int32_t, std::int32_t, std::int32_t>;
  struct Plain {
    std::map<std::int32_t, int> votes[2];
    std::tuple<float, float, float> first;
    std::size_t scan = 0;
    std::int32_t row = 0;
  };
  std::map<Key, Plain> plain;
  const auto keyOf = [](const Eigen::Vector3f& p) {
    const auto part = [](float x) {
      return static_cast<std::int32_t>(std::floor(x * static_cast<float>(1 / kVoxel_m) + 0.5f));
    };
    return Key{part(p.x()), part(p.y()), part(p.z())};
  };
  for (std::size_t s = 0; s < scans.size(); ++s) {
    for (std::size_t n = 0; n < scans[s].p.size(); ++n) {
      const Eigen::Vector3f& p = scans[s].p[n];
      Plain& point = plain[keyOf(p)];
      const bool fresh = point.votes[1].empty();
      for (std::size_t c = 0; c < 2; ++c) ++point.votes[c][scans[s].rows[3 * n + c]];
      const std::tuple place = {p.x(), p.y(), p.z()};
      // Of returns at one place the one that comes first.
      if (fresh || (point.scan == s && place < point.first)) {
        point.first = place, point.scan = s, point.row = scans[s].rows[3 * n + 2];
      }
    }
  }
  ASSERT_EQ(store.size(), plain.size());
  int ties = 0, mixed = 0;
  for (std::uint32_t id = 0; id < store.size(); ++id) {
    const Plain& point = plain.at(keyOf(store.first_L(id)));
    for (std::size_t c = 0; c < 2; ++c) {
      std::int32_t best = kNoAttribute;
      int most = 0, with_most = 0;
      for (const auto& [value, count] : point.votes[c]) {  // in ascending order: of several the lowest
        if (value == kNoAttribute) continue;
        with_most = count == most ? with_most + 1 : count > most ? 1 : with_most;
        if (count > most) best = value, most = count;
      }
      EXPECT_EQ(store.attributes().value(id, c), best) << "point " << id << ", column " << c;
      ties += with_most > 1 ? 1 : 0;
      mixed += point.votes[c].size() > 1 ? 1 : 0;
    }
    EXPECT_EQ(store.attributes().value(id, 2), point.row) << "point " << id;
  }
  EXPECT_GT(ties, 20);    // so that the rule for them is tested
  EXPECT_GT(mixed, 200);  // and that for votes
}

/// So many that sorting them by their place leaves them in no order.
TEST(PointAttributes, OfReturnsAtOnePlaceTheFirstOneCounts) {
  CarryingScan scan = {{}, {{1, 0, 0}}, {}};
  for (std::int32_t n = 0; n < 500; ++n) {
    scan.p.emplace_back(0.01f, 0.01f, n % 2 == 0 ? 0.0f : 0.001f);
    scan.rows.insert(scan.rows.end(), {1, 1, n});
  }
  const PointStore store = storeOf({scan});
  ASSERT_EQ(store.size(), 1u);
  EXPECT_EQ(store.attributes().value(0, 2), 0);
}

TEST(PointAttributes, DoNotDependOnThreadsOrTheOrderOfReturns) {
  std::vector<CarryingScan> scans = carryingScans(2, 3000);
  const std::vector<std::int32_t> expected = valuesOf(storeOf(scans));
  {
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    EXPECT_EQ(valuesOf(storeOf(scans)), expected);
  }
  Random random(3);
  for (CarryingScan& scan : scans) {
    std::vector<std::size_t> order(scan.p.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::shuffle(order.begin(), order.end(), random.engine());
    CarryingScan other = {{}, scan.q, {}};
    for (const std::size_t n : order) {
      other.p.push_back(scan.p[n]);
      for (std::size_t c = 0; c < 3; ++c) other.rows.push_back(scan.rows[3 * n + c]);
    }
    scan = other;
  }
  std::vector<std::int32_t> shuffled = valuesOf(storeOf(scans));
  // Between first returns at one place the order does decide.
  for (std::size_t n = 2; n < expected.size(); n += 3) shuffled[n] = expected[n];
  EXPECT_EQ(shuffled, expected);
}

TEST(PointAttributes, GoOnAfterTheyWereSaved) {
  const std::vector<CarryingScan> scans = carryingScans(4);
  const std::vector<CarryingScan> begin(scans.begin(), scans.begin() + 2);
  const PointStore half = storeOf(begin);
  PointStore again = emptyStore();
  std::vector<StoredPoint> points;
  std::vector<std::int32_t> values;
  for (std::uint32_t id = 0; id < half.size(); ++id) points.push_back(half.stored(id));
  ASSERT_TRUE(again.restore(points));
  again.attributes().restore(valuesOf(half));
  std::vector<PointAttributes::Vote> votes;
  for (std::uint32_t id = 0; id < half.size(); ++id) {
    for (std::size_t c = 0; c < 3; ++c) {
      half.attributes().votes(id, c, votes);
      if (votes.empty()) continue;
      ASSERT_TRUE(again.attributes().restoreVotes(id, c, votes));
    }
  }
  for (std::size_t s = 2; s < scans.size(); ++s) again.addReturns(scans[s].p, scans[s].q, scans[s].rows);
  EXPECT_EQ(valuesOf(again), valuesOf(storeOf(scans)));
}

TEST(PointAttributes, RefuseVotesThatNoFieldHas) {
  PointAttributes attributes({{"tree", Keep::Majority}});
  attributes.restore(std::vector<std::int32_t>{4, 7});
  using Votes = std::vector<PointAttributes::Vote>;
  EXPECT_FALSE(attributes.restoreVotes(2, 0, Votes{{4, 1}, {5, 1}}));  // no such point
  EXPECT_FALSE(attributes.restoreVotes(0, 0, Votes{}));
  EXPECT_FALSE(attributes.restoreVotes(0, 0, Votes{{5, 1}, {4, 2}}));             // out of order
  EXPECT_FALSE(attributes.restoreVotes(0, 0, Votes{{4, 1}, {4, 1}}));             // twice
  EXPECT_FALSE(attributes.restoreVotes(0, 0, Votes{{kNoAttribute, 3}, {4, 4}}));  // none has no vote
  EXPECT_FALSE(attributes.restoreVotes(0, 0, Votes{{3, 0}, {4, 1}}));
  EXPECT_FALSE(attributes.restoreVotes(1, 0, Votes{{7, 1}, {8, 2}}));  // another value wins
  EXPECT_TRUE(PointAttributes({{"tree", Keep::Majority}}).columns() == 1);
}

/// 4 bytes and a bit for each point whose returns agree; the chunks of the arrays come on top, 64 KiB each.
TEST(PointAttributes, TakeFourBytesWhereReturnsAgree) {
  constexpr std::uint32_t kPoints = 1 << 20;
  PointAttributes attributes({{"tree", Keep::Majority}});
  const std::vector<std::int32_t> values(kPoints, 3);
  std::vector<std::uint32_t> ids(kPoints), begin(kPoints + 1), ties(kPoints, 1);
  std::iota(ids.begin(), ids.end(), 0u);
  std::iota(begin.begin(), begin.end(), 0u);
  const auto once = [](std::uint32_t) { return 1u; };
  attributes.add({ids, begin, ids, ties, 0}, values, kPoints, once);
  // A byte per point of the last scan is the scan's, as are its lists.
  EXPECT_LE(attributes.bytes(), kPoints * 4.125 + kPoints + 3 * 65536);
  EXPECT_EQ(attributes.voteCount(0), 0u);
  EXPECT_EQ(attributes.value(kPoints - 1, 0), 3);
}

}  // namespace
}  // namespace accessvdb::internal

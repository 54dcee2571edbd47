// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Oracle: the k nearest of all points, sorted.
#include "hostdev/kept_neighbours.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <tuple>
#include <vector>

namespace accessvdb::kernels {
namespace {

using Place = std::array<float, 3>;
constexpr double kStepsPerMetre = 4096;
constexpr std::size_t kWanted = 12, kShared = 4;

struct Nearest {
  std::vector<std::size_t> ids, shared;  ///< in order
  KeptNeighbours kept = {};
};

Nearest nearestOf(const Place& centre, const std::vector<Place>& points) {
  std::vector<std::tuple<std::int64_t, std::size_t>> all;
  for (std::size_t n = 0; n < points.size(); ++n) {
    all.emplace_back(neighbourOffset(centre.data(), points[n].data(), kStepsPerMetre).squared(), n);
  }
  std::ranges::sort(all);
  Nearest nearest;
  NeighbourSums sums;
  for (std::size_t n = 0; n < kWanted; ++n) {
    const std::size_t id = std::get<1>(all[n]);
    nearest.ids.push_back(id);
    if (n < kShared) nearest.shared.push_back(id);
    sums.add(neighbourOffset(centre.data(), points[id].data(), kStepsPerMetre));
  }
  nearest.kept.setSums(sums);
  nearest.kept.farthest = std::get<0>(all[kWanted - 1]);
  nearest.kept.farthest_shared = std::get<0>(all[kShared - 1]);
  std::ranges::sort(nearest.ids);
  std::ranges::sort(nearest.shared);
  return nearest;
}

bool same(const NeighbourSums& a, const NeighbourSums& b) {
  return std::tie(a.count, a.x, a.y, a.z, a.xx, a.xy, a.xz, a.yy, a.yz, a.zz) ==
         std::tie(b.count, b.x, b.y, b.z, b.xx, b.xy, b.xz, b.yy, b.yz, b.zz);
}

/// @param spacing  0: anywhere; else multiples of that, so that many lie at one distance
void follow(unsigned seed, float spacing) {
  std::mt19937 random(seed);
  const auto uniform = [&](float most) {
    const float x = most * (static_cast<float>(random() % 65536) / 32768.0f - 1);
    return spacing > 0 ? std::round(x / spacing) * spacing : x;
  };
  const Place centre = {uniform(0.1f), uniform(0.1f), uniform(0.1f)};
  std::vector<Place> points = {centre};
  for (int n = 0; n < 60; ++n) points.push_back({uniform(1), uniform(1), uniform(1)});
  Nearest before = nearestOf(centre, points);
  int kept = 0, moved = 0, shared = 0, searched = 0;
  for (int n = 0; n < 2000; ++n) {
    const std::size_t id = 1 + random() % (points.size() - 1);
    const Place was = points[id];
    bool holds, shares = false;
    if (n % 16 == 15) {
      points.push_back({uniform(1), uniform(1), uniform(1)});
      holds = before.kept.ignoreNew(neighbourOffset(centre.data(), points.back().data(), kStepsPerMetre));
    } else {
      for (float& x : points[id]) x += uniform(n % 7 == 0 ? 1 : 0.1f);
      holds = before.kept.take(neighbourOffset(centre.data(), was.data(), kStepsPerMetre),
                               neighbourOffset(centre.data(), points[id].data(), kStepsPerMetre), shares);
    }
    const Nearest now = nearestOf(centre, points);
    if (!holds) {
      before = now;
      ++searched;
      continue;
    }
    ASSERT_EQ(before.ids, now.ids) << n;
    ASSERT_EQ(before.shared, now.shared) << n;
    ASSERT_TRUE(same(before.kept.sums(), now.kept.sums())) << n;
    ASSERT_GE(before.kept.farthest, now.kept.farthest) << "what is farther away must not matter";
    if (n % 16 != 15) {
      ASSERT_EQ(shares, std::ranges::binary_search(now.shared, id)) << n;
    }
    ++kept;
    moved += std::ranges::binary_search(now.ids, id) ? 1 : 0;
    shared += shares ? 1 : 0;
  }
  EXPECT_GT(kept, 200);
  EXPECT_GT(moved, 20);
  EXPECT_GT(shared, 2);
  EXPECT_GT(searched, 20);
}

TEST(KeptNeighbours, FollowWhatMovesAsIfSearched) {
  for (unsigned seed = 1; seed <= 10; ++seed) follow(seed, 0);
}

TEST(KeptNeighbours, FollowWhatMovesWhereManyAreEquallyFarAway) {
  for (unsigned seed = 1; seed <= 10; ++seed) follow(seed, 0.0625f);
}

}  // namespace
}  // namespace accessvdb::kernels

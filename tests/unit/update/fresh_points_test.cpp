// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which fresh points are examined, against a plain set of voxels.
#include "update/fresh_points.h"

#include <gtest/gtest.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <set>

#include "unit/points/random_points.h"

namespace accessvdb::internal {
namespace {

using test::directionTable;
using test::pointParams;
using test::Random;

constexpr double kVoxel_m = 0.05;

/// One return in a voxel near the origin, of both signs.
Eigen::Vector3f anyPlace(Random& random) { return random.point(1.5); }

struct Stream {
  Stream() : store(pointParams(kVoxel_m), directionTable(36)), fresh(store) {}

  /// Some points; all that are new become fresh.
  void addPoints(int count) {
    std::vector<Eigen::Vector3f> p;
    for (int n = 0; n < count; ++n) p.push_back(anyPlace(random));
    const std::uint32_t before = store.size();
    const Eigen::Vector3f q(2, 2, 2);
    store.addReturns(p, {&q, 1});
    std::vector<std::uint32_t> ids;
    for (std::uint32_t id = before; id < store.size(); ++id) {
      ids.push_back(id);
      expected.insert(id);
    }
    fresh.add(ids);
  }

  std::vector<Index3> anyLeaves(int count) {
    std::vector<Index3> leaves;
    for (int n = 0; n < count; ++n) {
      leaves.push_back({random.between(-9, 9), random.between(-9, 9), random.between(-9, 9)});
      if (n % 3 == 0) leaves.push_back(leaves.back());  // a leaf may come several times
    }
    return leaves;
  }

  [[nodiscard]] std::set<std::uint32_t> expectedIn(const std::set<Index3>& leaves) const {
    std::set<std::uint32_t> ids;
    for (const std::uint32_t id : expected) {
      if (leaves.contains(parentOf(store.voxelOf(store.first_L(id))))) ids.insert(id);
    }
    return ids;
  }

  Random random{1};
  PointStore store;
  FreshPoints fresh;
  std::set<std::uint32_t> expected;  ///< ids that are fresh
};

std::set<std::uint32_t> idsOf(const PointStore& store, const FreshPlaces& places) {
  std::set<std::uint32_t> ids;
  EXPECT_EQ(places.voxels.size(), places.blocks.size());
  for (std::size_t n = 0; n < places.voxels.size(); ++n) {
    const std::uint32_t id = store.index().findIn(places.blocks[n], places.voxels[n]);
    EXPECT_NE(id, kNone);
    EXPECT_EQ(store.blockOf(id), places.blocks[n]);
    EXPECT_TRUE(ids.insert(id).second) << "twice";
  }
  return ids;
}

TEST(FreshPoints, AreLookedAtWhereTheirLeafWasReached) {
  Stream stream;
  FreshPlaces places;
  stream.fresh.takeReached(places);  // none at all
  EXPECT_TRUE(places.voxels.empty());
  std::size_t looked_at = 0, removed = 0;
  for (int update = 0; update < 30; ++update) {
    stream.addPoints(update % 7 == 3 ? 0 : 400);
    std::set<Index3> leaves;
    for (int scan = 0; scan < update % 3; ++scan) {
      const std::vector<Index3> reached = stream.anyLeaves(300);
      leaves.insert(reached.begin(), reached.end());
      tbb::parallel_for(0, 10, [&](int part) {
        const std::size_t size = reached.size() / 10;
        const std::size_t begin = static_cast<std::size_t>(part) * size;
        stream.fresh.noteReached(std::span(reached).subspan(begin, part == 9 ? reached.size() - begin : size));
      });
    }
    std::set<std::uint32_t> expected = stream.expectedIn(leaves);
    if (update % 10 == 9) {
      stream.fresh.noteAll();
      expected = stream.expected;
    }
    stream.fresh.takeReached(places);
    ASSERT_EQ(idsOf(stream.store, places), expected) << "update " << update;
    looked_at += expected.size();
    // Some of them become confident; in later rounds whole blocks.
    std::vector<std::uint32_t> entries;
    for (std::uint32_t n = 0; n < places.voxels.size(); ++n) {
      const bool goes = update < 15 ? stream.random.below(3) == 0 : places.blocks[n] % 2 == 0;
      if (!goes) continue;
      entries.push_back(n);
      stream.expected.erase(stream.store.index().findIn(places.blocks[n], places.voxels[n]));
    }
    removed += entries.size();
    stream.fresh.remove(places, entries);
    FreshPlaces again;
    stream.fresh.takeReached(again);  // taken once
    ASSERT_TRUE(again.voxels.empty());
  }
  EXPECT_GT(looked_at, 5000u);
  EXPECT_GT(removed, 2000u);
}

TEST(FreshPoints, AreTakenInAFixedOrder) {
  FreshPlaces places[2];
  for (FreshPlaces& taken : places) {
    Stream stream;
    stream.addPoints(3000);
    const std::vector<Index3> reached = stream.anyLeaves(2000);
    tbb::parallel_for(std::size_t{0}, reached.size(), [&](std::size_t n) {
      const std::size_t from = &taken == places ? n : reached.size() - 1 - n;
      stream.fresh.noteReached(std::span(reached).subspan(from, 1));
    });
    stream.fresh.takeReached(taken);
  }
  EXPECT_GT(places[0].voxels.size(), 500u);
  EXPECT_EQ(places[0].voxels, places[1].voxels);
  EXPECT_EQ(places[0].blocks, places[1].blocks);
}

}  // namespace
}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is remembered about directions stays true while voxels stop colliding, for every point of a block; and the
/// inverse table of the corridor misses no sample. The oracle counts voxel by voxel.
#include "update/known_directions.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <random>
#include <set>

#include "hostdev/cell_counts.h"
#include "hostdev/occupancy_query.h"
#include "tests/unit/hostdev/occupancy_fixture.h"
#include "update/corridor_offsets.h"

namespace accessvdb::internal {
namespace {

using test::below;
using test::between;
using test::Voxel;

constexpr int kYaws = 20;

/// An arm of voxels that turns with the direction.
test::ToolFixture turningTool(int yaws = kYaws) {
  test::ToolFixture tool;
  for (int d = 0; d < yaws; ++d) {
    const double yaw = 2 * 3.141592653589793 * d / yaws;
    std::set<std::array<int, 2>> places;
    for (double r = 2; r < 16; r += 0.5) {
      for (double side = -2; side <= 2; side += 0.5) {
        places.insert({static_cast<int>(std::floor(r * std::cos(yaw) - side * std::sin(yaw))),
                       static_cast<int>(std::floor(r * std::sin(yaw) + side * std::cos(yaw)))});
      }
    }
    for (const auto& [x, y] : places) tool.columns.push_back(test::column(x, y, -3, 0x7f));
    tool.endDirection();
  }
  return tool;
}

int collisions(const test::ToolFixture& tool, int d, const Voxel& point, const std::set<Voxel>& colliding) {
  int count = 0;
  for (const Voxel& v : tool.voxels(d)) {
    count += colliding.contains({point[0] + v[0], point[1] + v[1], point[2] + v[2]}) ? 1 : 0;
  }
  return count;
}

/// @param yaws  some of them are learned and looked at
void expectNoFalsePromise(int yaws) {
  std::mt19937_64 random(5);
  const test::ToolFixture tool = turningTool(yaws);
  const int step = yaws / kYaws;
  std::uint64_t promised = 0, forgotten = 0;
  for (const int limit : {1, 12}) {
    for (int round = 0; round < 6; ++round) {
      const Index3 leaf = {below(random, 9) - 4, below(random, 9) - 4, below(random, 9) - 4};
      std::set<Voxel> colliding;
      const auto near = [&](int axis) { return leaf[static_cast<std::size_t>(axis)] * 8 + below(random, 48) - 20; };
      for (int n = 0; n < 12000; ++n) colliding.insert({near(0), near(1), leaf[2] * 8 + below(random, 24) - 8});
      const bool as_sets = round % 2 != 0;  // of directions, as for other orientations than yaw
      KnownDirections known(tool.view(limit), yaws, as_sets);
      ASSERT_EQ(known.cells().sets().empty(), !as_sets);
      known.grow(10, 1);
      ASSERT_FALSE(known.cells().empty());
      std::vector<std::uint32_t> ids;
      std::vector<Voxel> points;
      for (std::uint32_t id = 0; id < 10; ++id) {
        ids.push_back(id);
        points.push_back(
            {leaf[0] * 8 + below(random, 8), leaf[1] * 8 + below(random, 8), leaf[2] * 8 + below(random, 8)});
      }
      const int base = kernels::baseCollisions(false, 0, limit);
      for (int update = 0; update < 12; ++update) {
        for (const std::uint32_t id : ids) {  // some are looked at again
          if (update > 0 && below(random, 6) != 0) continue;
          kernels::SearchNotes notes;
          for (int d = 0; d < yaws; d += step) {
            notes.arm_free.set(d);
            notes.counted.set(d);
            notes.least[d] = static_cast<std::uint16_t>(collisions(tool, d, points[id], colliding));
          }
          kernels::learn(known.of(id, 0), known.scale().levels, notes, base, base);
        }
        std::map<Index3, LeafBits> freed;
        for (auto voxel = colliding.begin(); voxel != colliding.end();) {
          if (below(random, 25) != 0) {
            ++voxel;
            continue;
          }
          const Voxel& v = *voxel;
          freed[parentOf(v)][static_cast<std::size_t>(v[0] & 7)] |= std::uint64_t{1} << ((v[1] & 7) * 8 + (v[2] & 7));
          voxel = colliding.erase(voxel);
        }
        FreedVoxels sums;
        for (const auto& [at, bits] : freed) {
          sums.add(known.cells(), yaws, {at[0] - leaf[0], at[1] - leaf[1], at[2] - leaf[2]},
                   kernels::countCells(bits.data()));
        }
        known.age(0, ids, sums, kernels::allDirections(yaws));
        for (const std::uint32_t id : ids) {
          const kernels::KnownPoint of = known.of(id, 0);
          const KnownDirections::LowestLevels lowest = known.lowestWithMore(0);
          DirectionMask open = {};
          for (int w = 0; w < kernels::kMaxDirectionWords; ++w) {
            open.word[w] = KnownDirections::notKnownWorse(of, lowest, w, kernels::allDirections(yaws).word[w]);
          }
          for (int d = 0; d < yaws; d += step) {
            const int is = collisions(tool, d, points[id], colliding);
            const int least = kernels::knownCollisions(of, known.scale().levels, base, d);
            ASSERT_LE(least, is) << "update " << update << ", direction " << d;
            if (!open.test(d)) {
              ASSERT_GT(is, base) << "update " << update << ", direction " << d;
              ++promised;
            } else {
              ++forgotten;
            }
          }
        }
      }
    }
  }
  EXPECT_GT(promised, 2000u);
  EXPECT_GT(forgotten, 200u);
}

TEST(KnownDirections, NeverPromiseMoreCollisionsThanThereAre) { expectNoFalsePromise(kYaws); }
/// Rows of several cache lines, the last of them used in part and as a whole.
TEST(KnownDirections, OfSeveralMaskWordsNeverDoEither) {
  expectNoFalsePromise(180);
  expectNoFalsePromise(256);
}

TEST(KnownDirections, ForgetCorridorsThatMayBeFree) {
  const test::ToolFixture tool = turningTool();
  KnownDirections known(tool.view(1), kYaws);
  known.grow(2, 1);
  kernels::SearchNotes notes;
  notes.arm_blocked = kernels::allDirections(kYaws);
  for (const std::uint32_t id : {0u, 1u}) kernels::learn(known.of(id, 0), known.scale().levels, notes, 0, 0);
  DirectionMask better = {};
  better.set(3);
  better.set(17);
  known.forgetCorridors(1, better);
  const std::uint64_t all = kernels::allDirections(kYaws).word[0];
  const KnownDirections::LowestLevels lowest = known.lowestWithMore(0);
  EXPECT_EQ(KnownDirections::notKnownWorse(known.of(0, 0), lowest, 0, all), 0u);
  EXPECT_EQ(KnownDirections::notKnownWorse(known.of(1, 0), lowest, 0, all), better.word[0]);
}

TEST(CorridorOffsets, FindEverySample) {
  std::mt19937_64 random(6);
  constexpr double kVoxel = 0.05;
  const float inverse = static_cast<float>(1 / kVoxel);
  const test::ApproachFixture approach(kYaws, {0.12, 0.25, 0.45});
  const CorridorOffsets offsets(approach.view, kVoxel);
  ASSERT_FALSE(offsets.empty());
  int empty = 0;
  for (int n = 0; n < 20000; ++n) {
    const double far = n % 2 == 0 ? 0 : 40000;  // 800 000 voxels: float32 has steps of 0.08 voxels
    float p[3];
    for (float& axis : p) axis = static_cast<float>(far + between(random, -2, 2));
    const int d = below(random, kYaws), sample = below(random, 3);
    const float* offset = approach.view.arm_offsets + 3 * (3 * d + sample);
    const auto at = [&](int axis, float shift) { return kernels::voxelIndex(p[axis] + shift, inverse); };
    const auto* directions = offsets.at(at(0, offset[0]) - at(0, 0), at(1, offset[1]) - at(1, 0));
    ASSERT_NE(directions, nullptr);
    ASSERT_TRUE(directions->test(d)) << "direction " << d << ", sample " << sample;
    for (int other = 0; other < kYaws; ++other) empty += directions->test(other) ? 0 : 1;
  }
  EXPECT_GT(empty, 1000) << "otherwise the table would say nothing";
  EXPECT_EQ(offsets.table().size(), static_cast<std::size_t>((2 * offsets.reach() + 1) * (2 * offsets.reach() + 1)));
  const kernels::CorridorView view = {offsets.table().data(), offsets.reach()};
  for (std::int32_t dx = -offsets.reach() - 1; dx <= offsets.reach() + 1; ++dx) {
    for (std::int32_t dy = -offsets.reach() - 1; dy <= offsets.reach() + 1; ++dy) {
      ASSERT_EQ(view.at(dx, dy), offsets.at(dx, dy)) << dx << ", " << dy;  // as a device looks it up
    }
  }
  const test::ApproachFixture far(4, {5.0});
  EXPECT_TRUE(CorridorOffsets(far.view, kVoxel).empty());
  EXPECT_FALSE(CorridorOffsets(far.view, kVoxel, 256).empty());
  test::ApproachFixture tilted(4, {0.5});
  tilted.offsets[5] = 0.1f;
  EXPECT_TRUE(CorridorOffsets(tilted.view, kVoxel).empty());
}

}  // namespace
}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The filters in front of re-testing never miss: a direction that reads a flipped voxel is always found. The
/// voxel-exact ones find nothing else.
#include "points/leaf_footprint.h"

#include <gtest/gtest.h>

#include <map>
#include <set>

#include "unit/points/random_points.h"

namespace accessvdb::internal {
namespace {

using test::directionTable;
using test::Random;

constexpr int kDirections = 24;

/// Flips as plain sets, and as the library takes them.
struct Flips {
  std::set<Index3> collides_on, collides_off, arm_on, arm_off;
  FlipSet set;

  explicit Flips(Random& random, const Index3& around, int count, std::int32_t extent) {
    std::map<Index3, LeafChange> changes;
    for (int n = 0; n < count; ++n) {
      const Index3 v = {around[0] + random.between(-extent, extent), around[1] + random.between(-extent, extent),
                        around[2] + random.between(-extent, extent)};
      LeafChange& change = changes[parentOf(v)];
      change.origin_ijk = {v[0] & ~7, v[1] & ~7, v[2] & ~7};
      const std::uint64_t bit = std::uint64_t{1} << ((v[1] & 7) * 8 + (v[2] & 7));
      const auto word = static_cast<std::size_t>(v[0] & 7);
      switch (random.below(4)) {
        case 0:
          change.collides_on[word] |= bit, collides_on.insert(v);
          break;
        case 1:
          change.collides_off[word] |= bit, collides_off.insert(v);
          break;
        case 2:
          change.arm_free_on[word] |= bit, arm_on.insert(v);
          break;
        default:
          change.arm_free_off[word] |= bit, arm_off.insert(v);
          break;
      }
    }
    for (const auto& [leaf, change] : changes) set.add({&change, 1});
  }
};

struct Tables {
  std::vector<kernels::VoxelColumn> columns;
  std::vector<std::uint32_t> column_begin = {0}, sample_begin = {0};
  std::vector<float> samples, xy = directionTable(kDirections), offsets;
  kernels::ToolKernelView tool;
  kernels::ApproachView approach;

  Tables(Random& random, double v, bool use_samples) {
    for (int d = 0; d < kDirections; ++d) {
      for (int n = random.below(6); n >= 0; --n) {
        const auto at = [&](int low, int high) { return static_cast<std::int16_t>(random.between(low, high)); };
        const std::uint64_t bits = random.below(4) == 0 ? ~std::uint64_t{0} : random.bits() >> random.below(64) | 1;
        columns.push_back({at(-20, 20), at(-20, 20), at(-40, 20), 0, bits});
        for (int a = 0; a < 3; ++a) samples.push_back(static_cast<float>(random.uniform(-20, 20) * v));
      }
      column_begin.push_back(static_cast<std::uint32_t>(columns.size()));
      sample_begin.push_back(static_cast<std::uint32_t>(samples.size() / 3));
      for (const double s : {2.4, 5.0, 9.0, 13.0}) {
        offsets.push_back(static_cast<float>(s * v * std::cos(2 * 3.141592653589793 * d / kDirections)));
        offsets.push_back(static_cast<float>(s * v * std::sin(2 * 3.141592653589793 * d / kDirections)));
        offsets.push_back(0);
      }
    }
    tool.columns = columns.data();
    tool.column_begin = column_begin.data();
    tool.samples = samples.data();
    tool.sample_begin = sample_begin.data();
    tool.use_samples = use_samples;
    approach.direction_xy = xy.data();
    approach.arm_offsets = offsets.data();
    approach.num_directions = kDirections;
    approach.num_arm = 4;
  }
};

Index3 voxelOf(const Eigen::Vector3f& p, const float* offset, double v) {
  Index3 voxel;
  for (int a = 0; a < 3; ++a) {
    const float x = p[a] + (offset == nullptr ? 0.0f : offset[a]);
    const float scaled = x * static_cast<float>(1 / v);
    voxel[static_cast<std::size_t>(a)] = static_cast<std::int32_t>(std::floor(scaled + 0.5f));
  }
  return voxel;
}

/// Every voxel that a direction reads, from the tables alone.
std::vector<Index3> toolVoxels(const Tables& t, const Eigen::Vector3f& p, std::size_t d, double v) {
  std::vector<Index3> voxels;
  if (t.tool.use_samples) {
    for (std::size_t n = t.sample_begin[d]; n < t.sample_begin[d + 1]; ++n)
      voxels.push_back(voxelOf(p, &t.samples[3 * n], v));
    return voxels;
  }
  const Index3 at = voxelOf(p, nullptr, v);
  for (std::size_t n = t.column_begin[d]; n < t.column_begin[d + 1]; ++n) {
    for (int bit = 0; bit < 64; ++bit) {
      if ((t.columns[n].bits >> bit & 1) == 0) continue;
      voxels.push_back({at[0] + t.columns[n].dx, at[1] + t.columns[n].dy, at[2] + t.columns[n].dz + bit});
    }
  }
  return voxels;
}

bool anyIn(const std::vector<Index3>& voxels, const std::set<Index3>& set) {
  for (const Index3& voxel : voxels) {
    if (set.contains(voxel)) return true;
  }
  return false;
}

/// @param far  distance of the scene from the origin, in voxels
void check(std::uint64_t seed, bool use_samples, double v, double far) {
  Random random(seed);
  const Tables tables(random, v, use_samples);
  const LeafFootprint footprint(tables.tool, tables.approach, v);
  std::size_t hits = 0, misses = 0;
  for (int n = 0; n < 300; ++n) {
    Eigen::Vector3f p = random.point(8 * v);
    for (int a = 0; a < 3; ++a) {
      if (far != 0) p[a] = static_cast<float>((a == 1 ? -far : far) * v) + p[a];
      // Half of the points at the very edge between two leaves, where rounding decides.
      if (n % 2 == 0 && random.below(2) == 0) {
        const double voxel = std::floor(static_cast<double>(p[a]) / v / 8) * 8;
        p[a] = static_cast<float>((voxel - 0.5 + random.uniform(-1e-3, 1e-3)) * v);
      }
    }
    const Index3 at = voxelOf(p, nullptr, v);
    const Flips flips(random, at, n % 3 == 0 ? 1500 : 12, n % 3 == 0 ? 25 : 14);
    const AffectedDirections affected = footprint.affected(parentOf(at), flips.set);
    for (int d = 0; d < kDirections; ++d) {
      const std::vector<Index3> tool = toolVoxels(tables, p, static_cast<std::size_t>(d), v);
      std::vector<Index3> arm;
      for (std::size_t s = 0; s < 4; ++s)
        arm.push_back(voxelOf(p, &tables.offsets[3 * (static_cast<std::size_t>(d) * 4 + s)], v));
      const bool better = anyIn(tool, flips.collides_off) || anyIn(arm, flips.arm_on);
      const bool worse = anyIn(tool, flips.collides_on) || anyIn(arm, flips.arm_off);
      ASSERT_EQ(footprint.readsBetter(p, d, flips.set), better) << "direction " << d;
      ASSERT_EQ(footprint.readsWorse(p, d, flips.set), worse) << "direction " << d;
      ASSERT_LE(better, affected.better.test(d)) << "direction " << d << " from " << p.transpose();
      ASSERT_LE(worse, affected.worse.test(d)) << "direction " << d << " from " << p.transpose();
      hits += (better ? 1u : 0u) + (worse ? 1u : 0u);
      misses += (affected.better.test(d) ? 0u : 1u);
    }
  }
  EXPECT_GT(hits, 300u);
  EXPECT_GT(misses, 30u);  // else the leaf filter would filter nothing
}

TEST(LeafFootprint, NeverMissesAFlip) {
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    check(seed, seed % 2 == 0, seed <= 3 ? 0.05 : 0.0625, 0);
    if (HasFatalFailure()) return;
  }
}

/// A kilometre away at 1 cm: float32 positions are coarse, and voxels are still found by the same rounding.
TEST(LeafFootprint, NeverMissesAFlipFarFromTheOrigin) {
  for (std::uint64_t seed = 21; seed <= 24; ++seed) {
    check(seed, seed % 2 == 0, 0.01, 100000);
    if (HasFatalFailure()) return;
  }
}

TEST(FlipSet, JoinsAndForgets) {
  FlipSet set;
  EXPECT_TRUE(set.empty());
  EXPECT_EQ(set.find({0, 0, 0}), nullptr);
  Random random(3);
  for (int round = 0; round < 3; ++round) {
    std::map<Index3, LeafChange> expected;
    for (int n = 0; n < 400; ++n) {
      LeafChange change;
      change.origin_ijk = {8 * random.between(-6, 6), 8 * random.between(-6, 6), 8 * random.between(-6, 6)};
      for (std::size_t w = 0; w < 8; ++w) {
        change.collides_on[w] = random.bits() & random.bits() & random.bits();
        change.collides_off[w] = random.bits() & random.bits() & random.bits();
        change.arm_free_on[w] = random.bits() & random.bits() & random.bits();
        change.arm_free_off[w] = random.bits() & random.bits() & random.bits();
      }
      set.add({&change, 1});
      LeafChange& all = expected[parentOf(change.origin_ijk)];
      for (std::size_t w = 0; w < 8; ++w) {
        all.collides_on[w] |= change.collides_on[w];
        all.collides_off[w] |= change.collides_off[w];
        all.arm_free_on[w] |= change.arm_free_on[w];
        all.arm_free_off[w] |= change.arm_free_off[w];
      }
    }
    for (int x = -8; x <= 8; ++x)
      for (int y = -8; y <= 8; ++y)
        for (int z = -8; z <= 8; ++z) {
          const auto found = expected.find({x, y, z});
          const LeafChange* change = set.find({x, y, z});
          ASSERT_EQ(change != nullptr, found != expected.end());
          if (change == nullptr) continue;
          ASSERT_EQ(change->collides_on, found->second.collides_on);
          ASSERT_EQ(change->collides_off, found->second.collides_off);
          ASSERT_EQ(change->arm_free_on, found->second.arm_free_on);
          ASSERT_EQ(change->arm_free_off, found->second.arm_free_off);
        }
    set.clear();
    EXPECT_TRUE(set.empty());
    EXPECT_EQ(set.find({0, 0, 0}), nullptr);
  }
}

}  // namespace
}  // namespace accessvdb::internal

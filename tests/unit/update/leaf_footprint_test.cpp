// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The filters in front of re-testing never miss: a direction that reads a flipped voxel is always found. The
/// voxel-exact ones find nothing else.
#include "update/leaf_footprint.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <iomanip>
#include <map>
#include <set>
#include <string>
#include <utility>

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

  Flips() = default;
  Flips(Random& random, const Index3& around, int count, std::int32_t extent) {
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
  std::vector<float> samples, xy = directionTable(kDirections).xy, axes, offsets;
  kernels::ToolKernelView tool;
  kernels::ApproachView approach;

  /// @param tilted  directions of any kind, one behind the other up and down
  Tables(Random& random, double v, bool use_samples, bool tilted = false) {
    for (int d = 0; d < kDirections; ++d) {
      for (int n = random.below(6); n >= 0; --n) {
        const auto at = [&](int low, int high) { return static_cast<std::int16_t>(random.between(low, high)); };
        const std::uint64_t bits = random.below(4) == 0 ? ~std::uint64_t{0} : random.bits() >> random.below(64) | 1;
        columns.push_back({at(-20, 20), at(-20, 20), at(-40, 20), 0, bits});
        for (int a = 0; a < 3; ++a) {  // every second one about a whole number of leaves away
          const bool leaves = random.below(2) == 0;
          const double offset =
              leaves ? 8 * random.between(-2, 2) + random.uniform(-0.01, 0.01) : random.uniform(-20, 20);
          samples.push_back(static_cast<float>(offset * v));
        }
      }
      column_begin.push_back(static_cast<std::uint32_t>(columns.size()));
      sample_begin.push_back(static_cast<std::uint32_t>(samples.size() / 3));
      for (const double s : {2.4, 5.0, 9.0, 13.0}) {
        const double yaw = 2 * 3.141592653589793 * d / kDirections, pitch = tilted ? 1.4 * std::sin(5.0 * d) : 0;
        offsets.push_back(static_cast<float>(s * v * std::cos(yaw) * std::cos(pitch)));
        offsets.push_back(static_cast<float>(s * v * std::sin(yaw) * std::cos(pitch)));
        offsets.push_back(static_cast<float>(s * v * std::sin(pitch)));
      }
      axes.insert(axes.end(), {1, 0, 0});  // only whether there are any is read
    }
    tool.columns = columns.data();
    tool.column_begin = column_begin.data();
    tool.samples = samples.data();
    tool.sample_begin = sample_begin.data();
    tool.use_samples = use_samples;
    if (tilted) {
      approach.axes_xyz = axes.data();
    } else {
      approach.direction_xy = xy.data();
    }
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

/// The first leaf of a point's group.
Index3 groupLeaf(const Index3& voxel, int group_log2) {
  Index3 leaf = parentOf(voxel);
  for (std::int32_t& axis : leaf) axis -= ((axis % (1 << group_log2)) + (1 << group_log2)) % (1 << group_log2);
  return leaf;
}

/// A point near the leaf at `far` voxels from the origin; every second one at the very edge between two leaves, where
/// rounding decides.
Eigen::Vector3f pointNear(Random& random, double v, double far, bool at_edge) {
  Eigen::Vector3f p;
  for (int a = 0; a < 3; ++a) {
    const double at = (a == 1 ? -far : far) + random.uniform(-8, 8);
    const bool edge = at_edge && random.below(2) == 0;
    const double rounding = 1e-3 + far * 1e-7;
    p[a] = static_cast<float>((edge ? std::floor(at / 8) * 8 - 0.5 + random.uniform(-rounding, rounding) : at) * v);
  }
  return p;
}

AffectedDirections affectedBy(const LeafFootprint& footprint, const Index3& leaf, const FlipSet& flips) {
  FlipColumns columns;
  Index3 low = leaf, high = leaf;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    low[axis] += footprint.low()[axis];
    high[axis] += footprint.high()[axis];
  }
  const bool any_near = columns.fill(flips, low, high);
  const AffectedDirections affected = footprint.affected(leaf, columns);
  if (!any_near) {
    EXPECT_FALSE(any(affected.better_tool | affected.worse_tool | affected.better_arm | affected.worse_arm));
  }
  return affected;
}

/// @param far  distance of the scene from the origin, in voxels
void check(std::uint64_t seed, bool use_samples, double v, double far, int group_log2, bool tilted = false) {
  SCOPED_TRACE("group of 2^" + std::to_string(group_log2) + " leaves");
  Random random(seed);
  const Tables tables(random, v, use_samples, tilted);
  const LeafFootprint footprint(tables.tool, tables.approach, v, group_log2);
  std::size_t hits = 0, misses = 0;
  for (int n = 0; n < 200; ++n) {
    const Eigen::Vector3f p = pointNear(random, v, far, n % 2 == 0);
    const Index3 at = voxelOf(p, nullptr, v);
    const Flips flips(random, at, n % 3 == 0 ? 1500 : 12, n % 3 == 0 ? 25 : 14);
    const Index3 leaf = groupLeaf(at, group_log2);
    const AffectedDirections affected = affectedBy(footprint, leaf, flips.set);
    for (int d = 0; d < kDirections; ++d) {
      const std::vector<Index3> tool = toolVoxels(tables, p, static_cast<std::size_t>(d), v);
      std::vector<Index3> arm;
      for (std::size_t s = 0; s < 4; ++s)
        arm.push_back(voxelOf(p, &tables.offsets[3 * (static_cast<std::size_t>(d) * 4 + s)], v));
      const auto expectFound = [&](bool reads, const DirectionMask& filter) {
        ASSERT_LE(reads, filter.test(d)) << "direction " << d << " from " << p.transpose();
        hits += reads ? 1 : 0;
        misses += filter.test(d) ? 0 : 1;
      };
      expectFound(anyIn(tool, flips.collides_off), affected.better_tool);
      expectFound(anyIn(tool, flips.collides_on), affected.worse_tool);
      expectFound(anyIn(arm, flips.arm_on), affected.better_arm);
      expectFound(anyIn(arm, flips.arm_off), affected.worse_arm);
      if (testing::Test::HasFatalFailure()) return;
    }
  }
  EXPECT_GT(hits, 50u);
  EXPECT_GT(misses, 30u);  // otherwise the leaf filter would filter nothing
}

/// One flip at a time, on a voxel that a direction certainly reads.
void checkSingleFlips(std::uint64_t seed, bool use_samples, double v, double far, int group_log2, bool tilted = false) {
  SCOPED_TRACE("group of 2^" + std::to_string(group_log2) + " leaves");
  Random random(seed);
  const Tables tables(random, v, use_samples, tilted);
  const LeafFootprint footprint(tables.tool, tables.approach, v, group_log2);
  for (int n = 0; n < 4000; ++n) {
    const Eigen::Vector3f p = pointNear(random, v, far, true);
    const auto d = static_cast<std::size_t>(random.below(kDirections));
    const bool of_arm = random.below(2) == 0;
    std::vector<Index3> read = toolVoxels(tables, p, d, v);
    if (of_arm) read = {voxelOf(p, &tables.offsets[3 * (d * 4 + static_cast<std::size_t>(random.below(4)))], v)};
    if (read.empty()) continue;
    const Index3 voxel = read[static_cast<std::size_t>(random.below(static_cast<std::int32_t>(read.size())))];
    LeafChange change;
    change.origin_ijk = {voxel[0] & ~7, voxel[1] & ~7, voxel[2] & ~7};
    LeafBits& bits = of_arm ? change.arm_free_on : change.collides_off;
    bits[static_cast<std::size_t>(voxel[0] & 7)] |= std::uint64_t{1} << ((voxel[1] & 7) * 8 + (voxel[2] & 7));
    FlipSet flips;
    flips.add({&change, 1});
    const auto direction = static_cast<int>(d);
    const Index3 leaf = groupLeaf(voxelOf(p, nullptr, v), group_log2);
    const AffectedDirections affected = affectedBy(footprint, leaf, flips);
    ASSERT_FALSE(any(affected.worse_arm) || any(affected.worse_tool));
    ASSERT_FALSE(any(of_arm ? affected.better_tool : affected.better_arm));
    ASSERT_TRUE((of_arm ? affected.better_arm : affected.better_tool).test(direction))
        << (of_arm ? "arm" : "tool") << " of direction " << d << " from " << std::setprecision(9) << p.transpose();
  }
}

TEST(LeafFootprint, NeverMissesAFlip) {
  for (std::uint64_t seed = 1; seed <= 6 && !HasFatalFailure(); ++seed) {
    for (const int group_log2 : {0, 1, 2, 3}) {
      check(seed, seed % 2 == 0, seed <= 3 ? 0.05 : 0.0625, 0, group_log2);
      checkSingleFlips(seed, seed % 2 == 0, seed <= 3 ? 0.05 : 0.0625, 0, group_log2);
    }
  }
}

/// Float32 positions are coarse far from the origin (9 km at 1 cm: a tenth of a voxel), and voxels are found by that
/// same rounding.
TEST(LeafFootprint, NeverMissesAFlipFarFromTheOrigin) {
  for (std::uint64_t seed = 21; seed <= 24 && !HasFatalFailure(); ++seed) {
    for (const int group_log2 : {0, 1, 2}) {
      check(seed, seed % 2 == 0, 0.01, 900000, group_log2);
      checkSingleFlips(seed, seed % 2 == 0, 0.01, 900000, group_log2);
    }
  }
}

TEST(LeafFootprint, OfAnyDirectionsNeverMissesAFlip) {
  for (std::uint64_t seed = 31; seed <= 34 && !HasFatalFailure(); ++seed) {
    for (const int group_log2 : {0, 1, 2}) {
      const double far = seed % 4 < 2 ? 0 : 900000;
      check(seed, seed % 2 == 0, 0.05, far, group_log2, true);
      checkSingleFlips(seed, seed % 2 == 0, 0.05, far, group_log2, true);
    }
  }
}

/// With directions of any kind, each leaf has its own set, and all leaves above each other are there.
TEST(LeafFootprint, OfAnyDirectionsHasASetForEachLeaf) {
  Random random(8);
  const Tables tables(random, 0.05, false, true);
  for (const int group_log2 : {0, 1}) {
    std::map<Index3, DirectionMask> expected;
    for (std::size_t d = 0; d < kDirections; ++d) {
      for (std::size_t n = tables.column_begin[d]; n < tables.column_begin[d + 1]; ++n) {
        const kernels::VoxelColumn& c = tables.columns[n];
        const std::int32_t last = (8 << group_log2) - 1, top = c.dz + 63 - std::countl_zero(c.bits);
        std::set<Index3> leaves;
        for (const std::int32_t x : {0, last / 2, last}) {
          for (const std::int32_t y : {0, last / 2, last}) {
            for (std::int32_t z = c.dz; z <= top + last; ++z) leaves.insert(parentOf({x + c.dx, y + c.dy, z}));
          }
        }
        if (group_log2 == 0) {
          for (const Index3& leaf : leaves)
            expected.try_emplace(leaf, DirectionMask{}).first->second.set(static_cast<int>(d));
        }
      }
    }
    const LeafFootprint footprint(tables.tool, tables.approach, 0.05, group_log2);
    std::size_t in_stacks = 0;
    for (const LeafFootprint::Stack& stack : footprint.toolStacks()) {
      ASSERT_LT(stack.begin, stack.end);
      for (std::uint32_t n = stack.begin; n < stack.end; ++n, ++in_stacks) {
        const kernels::FootprintColumn& column = footprint.toolColumns()[n];
        const kernels::FootprintColumn& lowest = footprint.toolColumns()[stack.begin];
        ASSERT_EQ(column.z_low, column.z_high);
        ASSERT_EQ(column.z_low, lowest.z_low + static_cast<std::int32_t>(n - stack.begin));
        ASSERT_TRUE(column.dx == lowest.dx && column.dy == lowest.dy);
        if (group_log2 > 0) continue;
        const auto found = expected.find({column.dx, column.dy, column.z_low});
        ASSERT_TRUE(column.directions == (found == expected.end() ? DirectionMask{} : found->second));
        if (found != expected.end()) expected.erase(found);
      }
    }
    ASSERT_EQ(in_stacks, footprint.toolColumns().size());
    ASSERT_TRUE(expected.empty());
  }
}

/// A column of a group, only from the tables: every voxel from every place of the group, and nothing else.
TEST(LeafFootprint, ColumnsOfAGroupAreThoseOfItsPlaces) {
  Random random(7);
  const Tables tables(random, 0.05, false);
  for (const int group_log2 : {0, 1, 2}) {
    std::map<std::pair<std::int32_t, std::int32_t>, kernels::FootprintColumn> expected;
    for (std::size_t d = 0; d < kDirections; ++d) {
      for (std::size_t n = tables.column_begin[d]; n < tables.column_begin[d + 1]; ++n) {
        const kernels::VoxelColumn& c = tables.columns[n];
        const std::int32_t last = (8 << group_log2) - 1, top = c.dz + 63 - std::countl_zero(c.bits);
        for (std::int32_t x = 0; x <= last; ++x) {
          for (std::int32_t y = 0; y <= last; ++y) {
            const Index3 low = parentOf({x + c.dx, y + c.dy, c.dz}), high = parentOf({0, 0, last + top});
            auto& column =
                expected.try_emplace({low[0], low[1]}, kernels::FootprintColumn{low[0], low[1], low[2], high[2], {}})
                    .first->second;
            column.z_low = std::min(column.z_low, low[2]);
            column.z_high = std::max(column.z_high, high[2]);
            column.directions.set(static_cast<int>(d));
          }
        }
      }
    }
    const LeafFootprint footprint(tables.tool, tables.approach, 0.05, group_log2);
    ASSERT_EQ(footprint.toolColumns().size(), expected.size());
    for (const kernels::FootprintColumn& column : footprint.toolColumns()) {
      const auto found = expected.find({column.dx, column.dy});
      ASSERT_NE(found, expected.end());
      ASSERT_EQ(column.z_low, found->second.z_low);
      ASSERT_EQ(column.z_high, found->second.z_high);
      ASSERT_TRUE(column.directions == found->second.directions);
    }
  }
}

/// The bits of a change by kind.
constexpr std::array<LeafBits LeafChange::*, kFlipKinds> kBits = {&LeafChange::collides_on, &LeafChange::collides_off,
                                                                  &LeafChange::arm_free_on, &LeafChange::arm_free_off};

TEST(FlipSet, JoinsAndForgets) {
  FlipSet set;
  EXPECT_TRUE(set.empty());
  EXPECT_EQ(set.kindsIn({0, 0, 0}), 0);
  EXPECT_EQ(set.find({0, 0, 0}, FlipKind::CollidesOn), nullptr);
  Random random(3);
  for (int round = 0; round < 3; ++round) {
    std::map<Index3, LeafChange> expected;
    for (int n = 0; n < 400; ++n) {
      LeafChange change;
      change.origin_ijk = {8 * random.between(-6, 6), 8 * random.between(-6, 6), 8 * random.between(-6, 6)};
      LeafChange& all = expected[parentOf(change.origin_ijk)];
      for (const auto bits : kBits) {
        if (random.below(3) != 0) continue;  // most leaves have some kinds only
        for (std::size_t w = 0; w < 8; ++w) {
          (change.*bits)[w] = random.bits() & random.bits() & random.bits();
          (all.*bits)[w] |= (change.*bits)[w];
        }
      }
      set.add({&change, 1});
    }
    EXPECT_FALSE(set.empty());
    for (int x = -8; x <= 8; ++x)
      for (int y = -8; y <= 8; ++y)
        for (int z = -8; z <= 8; ++z) {
          const auto found = expected.find({x, y, z});
          for (int kind = 0; kind < kFlipKinds; ++kind) {
            const LeafBits* is = set.find({x, y, z}, static_cast<FlipKind>(kind));
            LeafBits should = {};
            if (found != expected.end()) should = found->second.*kBits[static_cast<std::size_t>(kind)];
            const bool some = should != LeafBits{};
            ASSERT_EQ((set.kindsIn({x, y, z}) >> kind & 1) != 0, some);
            ASSERT_EQ(is != nullptr, some);
            if (some) {
              ASSERT_EQ(*is, should);
            }
          }
        }
    set.clear();
    EXPECT_TRUE(set.empty());
    EXPECT_EQ(set.kindsIn({0, 0, 0}), 0);
    EXPECT_EQ(set.find({0, 0, 0}, FlipKind::CollidesOn), nullptr);
  }
}

}  // namespace
}  // namespace accessvdb::internal

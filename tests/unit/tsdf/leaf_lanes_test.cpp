// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The body of the leaf kernels in the lanes of a warp, here one after the other, gives the bits of the plain kernels:
/// random leaves, through all that a scan does to them.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <random>
#include <vector>

#include "tsdf/leaf_kernels.h"
#include "unit/tsdf/random_return.h"

#define ACCESSVDB_KERNEL inline
#define ACCESSVDB_KERNEL_INLINE inline

namespace accessvdb::internal {
namespace {

namespace emulated {

#include "unit/tsdf/lanes_emulated.h"
// Uses what is defined above.
#include "hostdev/leaf_kernels_body.h"

}  // namespace emulated

LeafBits leafBits(const emulated::Bits& bits) {
  LeafBits of_leaf = {};
  for (std::size_t n = 0; n < 512; ++n) of_leaf[n >> 6] |= std::uint64_t{bits[n % 32] >> (n / 32) & 1} << (n & 63);
  return of_leaf;
}

emulated::Bits laneBits(const LeafBits& of_leaf) {
  emulated::Bits bits;
  for (std::size_t n = 0; n < 512; ++n) {
    bits[n % 32] |= static_cast<std::uint32_t>(of_leaf[n >> 6] >> (n & 63) & 1) << (n / 32);
  }
  return bits;
}

/// A strip of a warp is two pairs of rows.
std::uint32_t strips(std::uint32_t pairs) {
  std::uint32_t strips = 0;
  for (unsigned n = 0; n < 16; ++n) strips |= (pairs >> (2 * n) & 3) != 0 ? 1u << n : 0;
  return strips;
}

KernelConstants someConstants() {
  KernelConstants constants = {};
  constants.tau = 10;
  constants.cone_cos = 0.95f;
  constants.cone_cos_squared = 0.9025f;
  constants.clamp_low = -2;
  constants.clamp_high = 10;
  constants.sample_scale = static_cast<float>(kSampleSteps) / 12;
  constants.band_begin = 5;
  constants.band_end = 22.5f;
  constants.band_radius_squared = 6.25f;
  constants.max_weight = 40;
  constants.collision_mean = kMeanSteps / 5;
  constants.collision_sample = (constants.collision_mean + 15) / 16;
  constants.zero_mean = kMeanSteps / 6;
  return constants;
}

LeafBits randomBits(std::mt19937& random) {
  LeafBits bits;
  for (std::uint64_t& word : bits) {
    word = (std::uint64_t{random()} << 32 | random()) & (std::uint64_t{random()} << 32 | random());
  }
  return bits;
}

/// Fuses a few scans into a leaf with votes, with both.
TEST(LeafLanes, AWarpGivesTheBitsOfThePlainKernels) {
  const KernelList<LeafKernels> list = runnableLeafKernels();
  const LeafKernels& plain = *list.kernels[static_cast<std::size_t>(list.count - 1)];
  const KernelConstants constants = someConstants();
  std::uint64_t flips = 0, updates = 0, passes = 0, contra_voxels = 0, changed_votes = 0;
  for (unsigned seed = 1; seed <= 200; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937 random(seed);
    std::vector<std::uint32_t> packed(512);
    for (auto& voxel : packed) {
      voxel = random() % 3 == 0 ? 0 : packVoxel(random() % (kMeanSteps + 1), 1 + random() % 40);
    }
    LeafBits cleared = randomBits(random);
    VoxelVotes votes;
    for (LeafBits& plane : votes.bit) plane = randomBits(random);
    std::vector<std::uint32_t> packed_of_warp = packed;
    emulated::Bits cleared_of_warp = laneBits(cleared);
    emulated::Votes votes_of_warp;
    for (std::size_t n = 0; n < 3; ++n) votes_of_warp.bit[n] = laneBits(votes.bit[n]);
    for (unsigned scan = 0; scan < 3; ++scan) {
      const bool has_votes = (seed + scan) % 4 != 0, has_values = (seed + scan) % 5 != 0;
      const std::size_t returns = has_values ? random() % 8 : 0;
      LeafSums sums, sums_of_warp;
      LeafBits passed = {}, contra = {};
      emulated::Bits passed_of_warp, contra_of_warp;
      std::uint32_t touched = 0;
      for (std::size_t n = 0; n < 8; ++n) {
        const ReturnInLeaf ray = randomReturn(random);
        const std::uint32_t count = plain.mark_band(ray, constants, passed);
        ASSERT_EQ(emulated::markBand(ray, constants, passed_of_warp), count);
        passes += count;
        if (n >= returns) continue;
        std::uint32_t pairs, of_warp;
        if (n % 3 == 0) {
          pairs = plain.add_double_cone(ray, constants, sums);
          of_warp = emulated::addDoubleCone(ray, constants, sums_of_warp);
        } else if (n % 3 == 1) {
          pairs = plain.add_news(ray, constants, sums, contra);
          of_warp = emulated::addNews(ray, constants, sums_of_warp, contra_of_warp);
        } else {
          pairs = plain.add_full_cube(ray, constants, sums);
          of_warp = emulated::addFullCube(ray, constants, sums_of_warp);
        }
        ASSERT_EQ(of_warp, strips(pairs));
        touched |= pairs;
      }
      ASSERT_TRUE(std::equal(std::begin(sums.packed), std::end(sums.packed), std::begin(sums_of_warp.packed)));
      ASSERT_EQ(leafBits(passed_of_warp), passed);
      ASSERT_EQ(leafBits(contra_of_warp), contra);
      ASSERT_EQ(emulated::gainedStrips(passed_of_warp, cleared_of_warp), strips(plain.gained_pairs(passed, cleared)));

      LeafBits free = {}, colliding = {};
      emulated::Bits free_of_warp, colliding_of_warp;
      plain.mark_measured_free(sums, constants, touched, free);
      emulated::markMeasuredFree(sums_of_warp, constants, strips(touched), free_of_warp);
      plain.mark_colliding(packed.data(), constants, ~0u, colliding);
      emulated::markColliding(packed_of_warp.data(), constants, 0xffffu, colliding_of_warp);
      ASSERT_EQ(leafBits(free_of_warp), free);
      ASSERT_EQ(leafBits(colliding_of_warp), colliding);

      const VoxelVotes old_votes = votes;
      LeafChange change;
      emulated::Flips change_of_warp;
      FoldCounts counts, counts_of_warp;
      const bool flipped =
          plain.fold({has_values ? packed.data() : nullptr, cleared.data(), has_votes ? &votes : nullptr, &contra},
                     constants, touched, sums, passed, change, counts);
      ASSERT_EQ(
          emulated::fold({has_values ? packed_of_warp.data() : nullptr, cleared_of_warp.of_lane,
                          has_votes ? &votes_of_warp : nullptr, &contra_of_warp},
                         constants, strips(touched), sums_of_warp, passed_of_warp, change_of_warp, counts_of_warp),
          flipped);
      ASSERT_EQ(packed_of_warp, packed);
      ASSERT_EQ(leafBits(cleared_of_warp), cleared);
      for (std::size_t n = 0; n < 3; ++n) ASSERT_EQ(leafBits(votes_of_warp.bit[n]), votes.bit[n]);
      ASSERT_EQ(leafBits(change_of_warp.collides_on), change.collides_on);
      ASSERT_EQ(leafBits(change_of_warp.collides_off), change.collides_off);
      ASSERT_EQ(leafBits(change_of_warp.arm_free_on), change.arm_free_on);
      ASSERT_EQ(leafBits(change_of_warp.arm_free_off), change.arm_free_off);
      ASSERT_EQ(counts_of_warp.distance_updates, counts.distance_updates);
      ASSERT_EQ(counts_of_warp.newly_observed, counts.newly_observed);
      ASSERT_EQ(counts_of_warp.flipped_voxels, counts.flipped_voxels);
      ASSERT_EQ(emulated::flipArm({cleared_of_warp, free_of_warp, colliding_of_warp}, cleared_of_warp.of_lane,
                                  change_of_warp),
                plain.flip_arm({cleared, free, colliding}, cleared.data(), change));
      ASSERT_EQ(leafBits(cleared_of_warp), cleared);
      ASSERT_EQ(leafBits(change_of_warp.arm_free_on), change.arm_free_on);
      flips += counts.flipped_voxels;
      updates += counts.distance_updates;
      for (const std::uint64_t word : contra) contra_voxels += static_cast<std::uint64_t>(std::popcount(word));
      changed_votes += votes == old_votes ? 0 : 1;
    }
  }
  EXPECT_GT(flips, 10000u);
  EXPECT_GT(updates, 100000u);
  EXPECT_GT(passes, 10000u);
  EXPECT_GT(contra_voxels, 1000u);
  EXPECT_GT(changed_votes, 100u);
}

}  // namespace
}  // namespace accessvdb::internal

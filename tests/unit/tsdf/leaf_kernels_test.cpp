// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Every instruction set gives the same bits.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "tsdf/leaf_kernels.h"
#include "tsdf/packed_voxel.h"

namespace accessvdb::internal {
namespace {

struct Bits {
  std::vector<std::uint32_t> touched, passes;
  std::vector<std::uint32_t> sums, gained, packed;
  LeafBits passed = {}, cleared = {}, measured_free = {}, colliding = {};
  LeafChange change;
  bool flipped = false;
  FoldCounts counts;
};

Bits run(const LeafKernels& kernels, bool cone, unsigned seed) {
  std::mt19937 random(seed);
  const auto uniform = [&random](float low, float high) {
    return low + (high - low) * static_cast<float>(random() % 65536) / 65536.0f;
  };
  KernelConstants constants = {};
  constants.tau = 10;
  constants.cone_cos = 0.95f;
  constants.cone_cos_squared = 0.9025f;
  constants.clamp_high = 10;
  constants.sample_scale = static_cast<float>(kSampleSteps) / 10;
  constants.band_begin = 5;
  constants.band_end = 22.5f;
  constants.band_radius_squared = 6.25f;
  constants.max_weight = 40;
  constants.collision_mean = kMeanSteps / 20;
  LeafSums sums;
  Bits bits;
  std::uint32_t touched = 0;
  for (std::uint32_t n = 0; n < LeafSums::kMostSamples; ++n) {
    ReturnInLeaf ray;
    float norm = 0;
    for (std::size_t a = 0; a < 3; ++a) {
      ray.leaf[a] = std::floor(uniform(-14, 7));
      ray.offset[a] = uniform(-0.5f, 0.5f);
      ray.to_sensor[a] = uniform(-1, 1);
      norm += ray.to_sensor[a] * ray.to_sensor[a];
    }
    for (float& u : ray.to_sensor) u /= std::sqrt(norm);
    ray.range = uniform(3, 900);
    ray.box_x = {-30, 30};
    const std::uint32_t pairs = (cone ? kernels.add_double_cone : kernels.add_full_cube)(ray, constants, sums);
    bits.touched.push_back(pairs);
    touched |= pairs;
    bits.passes.push_back(kernels.mark_band(ray, constants, bits.passed));
  }
  bits.sums.assign(std::begin(sums.packed), std::end(sums.packed));
  std::vector<std::uint32_t> packed(512);
  for (auto& voxel : packed) voxel = random() % 3 == 0 ? 0 : packVoxel(random() % (kMeanSteps + 1), 1 + random() % 40);
  for (auto& word : bits.cleared) word = random() & random();
  LeafBits few = bits.passed;
  for (auto& word : few) word &= random() % 3 == 0 ? 0 : std::uint64_t{0xffff} << (16 * (random() % 4));
  bits.gained.push_back(kernels.gained_pairs(few, bits.cleared));
  kernels.mark_measured_free(sums, constants, touched, bits.measured_free);
  kernels.mark_colliding(packed.data(), constants, touched, bits.colliding);
  for (std::size_t n = 0; n < 512; ++n) {  // in wider numbers
    const std::uint64_t count = LeafSums::samplesOf(sums.packed[n]), sum = LeafSums::distanceOf(sums.packed[n]);
    const auto limit = static_cast<std::uint64_t>(constants.collision_mean);
    const bool looked_at = (touched >> (n / 16) & 1) != 0;
    EXPECT_EQ(bits.measured_free[n >> 6] >> (n & 63) & 1, count > 0 && 16 * sum >= limit * count ? 1u : 0u);
    EXPECT_EQ(bits.colliding[n >> 6] >> (n & 63) & 1,
              looked_at && weightOf(packed[n]) > 0 && meanOf(packed[n]) < limit ? 1u : 0u);
  }
  bits.flipped = kernels.fold({packed.data(), bits.cleared.data()}, constants, touched, sums, bits.passed, bits.change,
                              bits.counts);
  bits.packed = packed;
  for (std::size_t n = 0; n < 512; ++n) EXPECT_EQ(sums.packed[n], 0u);
  return bits;
}

TEST(LeafKernels, EveryInstructionSetGivesTheSameBits) {
  const KernelList<LeafKernels> list = runnableLeafKernels();
  const LeafKernels& plain = *list.kernels[static_cast<std::size_t>(list.count - 1)];
  EXPECT_STREQ(plain.name, "plain");
  if (list.count == 1) GTEST_SKIP() << "this machine runs the plain kernels only";
  std::uint64_t updates = 0, passes = 0;
  for (int n = 0; n + 1 < list.count; ++n) {
    SCOPED_TRACE(list.kernels[static_cast<std::size_t>(n)]->name);
    for (unsigned seed = 1; seed <= 20; ++seed) {
      const Bits expected = run(plain, seed % 2 == 0, seed);
      const Bits bits = run(*list.kernels[static_cast<std::size_t>(n)], seed % 2 == 0, seed);
      ASSERT_EQ(bits.touched, expected.touched);
      ASSERT_EQ(bits.passes, expected.passes);
      ASSERT_EQ(bits.sums, expected.sums);
      ASSERT_EQ(bits.gained, expected.gained);
      ASSERT_EQ(bits.packed, expected.packed);
      ASSERT_EQ(bits.passed, expected.passed);
      ASSERT_EQ(bits.cleared, expected.cleared);
      ASSERT_EQ(bits.measured_free, expected.measured_free);
      ASSERT_EQ(bits.colliding, expected.colliding);
      ASSERT_EQ(bits.flipped, expected.flipped);
      ASSERT_EQ(bits.change.collides_on, expected.change.collides_on);
      ASSERT_EQ(bits.change.collides_off, expected.change.collides_off);
      ASSERT_EQ(bits.change.arm_free_on, expected.change.arm_free_on);
      ASSERT_EQ(bits.change.arm_free_off, expected.change.arm_free_off);
      ASSERT_EQ(bits.counts.distance_updates, expected.counts.distance_updates);
      ASSERT_EQ(bits.counts.newly_observed, expected.counts.newly_observed);
      ASSERT_EQ(bits.counts.flipped_voxels, expected.counts.flipped_voxels);
      updates += bits.counts.distance_updates;
      for (const std::uint32_t count : bits.passes) passes += count;
    }
  }
  EXPECT_GT(updates, 10000u);
  EXPECT_GT(passes, 10000u);
}

/// A voxel counts once, whether one of its facts flipped or both.
TEST(LeafKernels, FlippedVoxelsAreThoseOfTheChange) {
  const KernelList<LeafKernels> list = runnableLeafKernels();
  std::uint64_t all = 0;
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const Bits bits = run(*list.kernels[seed % static_cast<unsigned>(list.count)], true, seed);
    const LeafChange& c = bits.change;
    std::uint64_t flipped = 0;
    for (std::size_t n = 0; n < 512; ++n) {
      const auto has = [n](const LeafBits& of) { return (of[n >> 6] >> (n & 63) & 1u) != 0; };
      if (has(c.collides_on) || has(c.collides_off) || has(c.arm_free_on) || has(c.arm_free_off)) ++flipped;
    }
    EXPECT_EQ(bits.counts.flipped_voxels, flipped);
    EXPECT_EQ(bits.flipped, flipped > 0);
    all += flipped;
  }
  EXPECT_GT(all, 1000u);
}

/// The mean after a fold is (mean * weight + 16 * sum) / total to the nearest step, halves up; in integers.
TEST(LeafKernels, FoldedMeansAreRoundedExactly) {
  const KernelList<LeafKernels> list = runnableLeafKernels();
  for (int n = 0; n < list.count; ++n) {
    const LeafKernels& kernels = *list.kernels[static_cast<std::size_t>(n)];
    SCOPED_TRACE(kernels.name);
    KernelConstants constants = {};
    constants.max_weight = kWeightMask;
    std::mt19937 random(7);
    std::uint64_t halves = 0, wrong = 0;
    for (int round = 0; round < 2000; ++round) {
      // Small totals have the most halves; the largest ones come nearest to a half without being one.
      const std::uint32_t most_samples = round % 4 == 0 ? LeafSums::kMostSamples : round % 4 == 1 ? 60u : 8u;
      const std::uint32_t most_weight = round % 3 == 0 ? kWeightMask : 9u;
      std::vector<std::uint32_t> packed(512), expected(512);
      LeafSums sums;
      for (std::size_t i = 0; i < 512; ++i) {
        const std::uint32_t mean = random() % 8 == 0 ? kMeanSteps - random() % 2 : random() % (kMeanSteps + 1);
        const std::uint32_t weight = random() % (most_weight + 1), samples = 1 + random() % most_samples;
        const std::uint64_t total = std::uint64_t{weight} + samples;
        std::uint64_t sum = random() % (std::uint64_t{samples} * kSampleSteps + 1);
        if (random() % 8 == 0) sum = std::uint64_t{samples} * kSampleSteps;
        packed[i] = weight == 0 ? 0 : packVoxel(mean, weight);
        sums.packed[i] = LeafSums::pack(static_cast<std::uint32_t>(sum), samples);
        const std::uint64_t numerator = std::uint64_t{meanOf(packed[i])} * weight + 16 * sum;
        halves += 2 * (numerator % total) == total ? 1 : 0;
        expected[i] = packVoxel(static_cast<std::uint32_t>((2 * numerator + total) / (2 * total)),
                                static_cast<std::uint32_t>(std::min<std::uint64_t>(total, kWeightMask)));
      }
      LeafBits cleared = {};
      LeafChange change;
      FoldCounts counts;
      kernels.fold({packed.data(), cleared.data()}, constants, 0xffffffffu, sums, LeafBits{}, change, counts);
      for (std::size_t i = 0; i < 512; ++i) wrong += packed[i] != expected[i] ? 1 : 0;
    }
    EXPECT_EQ(wrong, 0u);
    EXPECT_GT(halves, 1000u);
  }
}

/// Wide sums are folded like narrow ones: which of them a leaf has may depend on who sums it.
TEST(LeafKernels, WideSumsAreRoundedExactly) {
  std::mt19937_64 random(11);
  std::uint64_t halves = 0, wrong = 0;
  for (int round = 0; round < 1000000; ++round) {
    const std::uint64_t most = round % 3 == 0 ? 8 : round % 3 == 1 ? LeafSums::kMostSamples : 5000000;
    const std::uint64_t samples = 1 + random() % most;
    const auto weight = static_cast<std::uint32_t>(random() % (round % 2 == 0 ? 9 : kWeightMask + 1));
    const auto mean = static_cast<std::uint32_t>(random() % (kMeanSteps + 1));
    const std::uint32_t old = weight == 0 ? 0 : packVoxel(mean, weight);
    const std::uint64_t sum = random() % (samples * kSampleSteps + 1), total = weight + samples;
    const std::uint64_t numerator = std::uint64_t{meanOf(old)} * weight + 16 * sum;
    halves += 2 * (numerator % total) == total ? 1 : 0;
    const std::uint32_t expected = packVoxel(static_cast<std::uint32_t>((2 * numerator + total) / (2 * total)),
                                             static_cast<std::uint32_t>(std::min<std::uint64_t>(total, 2000)));
    wrong += kernels::foldedWide(old, sum, samples, 2000) != expected ? 1 : 0;
  }
  EXPECT_EQ(wrong, 0u);
  EXPECT_GT(halves, 1000u);
}

}  // namespace
}  // namespace accessvdb::internal

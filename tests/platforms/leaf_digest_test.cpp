// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Every instruction set on every machine fuses random leaves into the same bits: their digest is written down here.
///
/// The plain kernels of x86-64 gave it (GCC 12). Within one machine, leaf_kernels_test compares sets result by result.
#include <gtest/gtest.h>

#include <bit>
#include <cstdint>
#include <iostream>
#include <random>

#include "tsdf/leaf_kernels.h"
#include "unit/tsdf/random_return.h"

namespace accessvdb::internal {
namespace {

/// FNV-1a over words, turned so that high bits reach low ones: any bit counts, and so does the order.
class Digest {
 public:
  void add(std::uint64_t word) { state_ = std::rotl(state_ ^ word, 29) * 0x100000001b3u; }
  void add(const LeafBits& bits) {
    for (const std::uint64_t word : bits) add(word);
  }
  [[nodiscard]] std::uint64_t value() const { return state_; }

 private:
  std::uint64_t state_ = 0xcbf29ce484222325u;
};

/// One number per statement: the order within an expression is the compiler's.
class RandomLeaf {
 public:
  explicit RandomLeaf(std::uint32_t seed) : random_(seed) {}

  std::uint32_t below(std::uint32_t end) { return random_() % end; }
  float uniform(float low, float high) { return internal::uniform(random_, low, high); }
  LeafBits bits() {
    LeafBits some;
    for (std::uint64_t& word : some) {
      word = std::uint64_t{random_()} << 32;
      word |= random_();
      word &= std::uint64_t{random_()} * 0x100000001u;
    }
    return some;
  }
  KernelConstants constants() {
    KernelConstants c = {};
    c.tau = uniform(2, 12);
    c.cone_cos = uniform(0.8f, 0.999f);
    c.cone_cos_squared = c.cone_cos * c.cone_cos;
    c.clamp_low = uniform(-3, 0);
    c.clamp_high = c.tau;
    c.sample_scale = static_cast<float>(kSampleSteps) / (c.clamp_high - c.clamp_low);
    c.band_begin = uniform(1, 8);
    c.band_end = c.band_begin + uniform(0, 20);
    c.band_radius_squared = uniform(1, 9);
    c.max_weight = static_cast<std::int32_t>(1 + below(60));
    c.collision_mean = static_cast<std::int32_t>(kMeanSteps / (2 + below(10)));
    c.collision_sample = (c.collision_mean + 15) / 16;
    c.zero_mean = static_cast<std::int32_t>(kMeanSteps / (2 + below(10)));
    return c;
  }
  ReturnInLeaf ray() { return randomReturn(random_); }

 private:
  std::mt19937 random_;
};

/// One scan of a leaf from its returns to its facts, and what it leaves behind.
void addLeaf(const LeafKernels& kernels, std::uint32_t seed, Digest& digest, std::uint64_t& updates) {
  RandomLeaf leaf(seed);
  const KernelConstants constants = leaf.constants();
  std::uint32_t packed[512];
  for (std::uint32_t& voxel : packed) {
    const std::uint32_t mean = leaf.below(kMeanSteps + 1), weight = 1 + leaf.below(60);
    voxel = leaf.below(3) == 0 ? 0 : packVoxel(mean, weight);
  }
  LeafBits cleared = leaf.bits(), passed = {}, contra = {}, measured_free = {}, colliding = {};
  VoxelVotes votes;
  for (LeafBits& plane : votes.bit) plane = leaf.bits();
  LeafSums sums;
  std::uint32_t touched = 0;
  const std::uint32_t returns = 1 + leaf.below(4);
  for (std::uint32_t n = 0; n < returns; ++n) {
    const ReturnInLeaf ray = leaf.ray();
    const std::uint32_t pairs = n % 3 == 0   ? kernels.add_double_cone(ray, constants, sums)
                                : n % 3 == 1 ? kernels.add_news(ray, constants, sums, contra)
                                             : kernels.add_full_cube(ray, constants, sums);
    digest.add(pairs);
    digest.add(kernels.mark_band(ray, constants, passed));
    touched |= pairs;
  }
  digest.add(kernels.gained_pairs(passed, cleared));
  kernels.mark_measured_free(sums, constants, touched, measured_free);
  kernels.mark_colliding(packed, constants, touched, colliding);
  digest.add(measured_free);
  digest.add(colliding);
  LeafChange change;
  FoldCounts counts;
  const bool has_votes = leaf.below(2) == 0;
  digest.add(kernels.fold({packed, cleared.data(), has_votes ? &votes : nullptr, &contra}, constants, touched, sums,
                          passed, change, counts)
                 ? 1
                 : 0);
  for (const std::uint32_t voxel : packed) digest.add(voxel);
  digest.add(cleared);
  for (const LeafBits& plane : votes.bit) digest.add(plane);
  digest.add(change.collides_on);
  digest.add(change.collides_off);
  digest.add(change.arm_free_on);
  digest.add(change.arm_free_off);
  digest.add(counts.flipped_voxels);
  digest.add(counts.newly_observed);
  updates += counts.distance_updates;
  digest.add(kernels.flip_arm({cleared, measured_free, colliding}, cleared.data(), change));
  digest.add(cleared);
  digest.add(change.arm_free_on);
}

void expectDigest(std::uint32_t leaves, std::uint64_t expected) {
  const KernelList<LeafKernels> list = runnableLeafKernels();
  for (int n = 0; n < list.count; ++n) {
    const LeafKernels& kernels = *list.kernels[static_cast<std::size_t>(n)];
    Digest digest;
    std::uint64_t updates = 0;
    for (std::uint32_t seed = 1; seed <= leaves; ++seed) addLeaf(kernels, seed, digest, updates);
    EXPECT_EQ(digest.value(), expected) << kernels.name;
    EXPECT_GT(updates, 10u * leaves) << kernels.name;  // leaves without samples would show nothing
    std::cout << kernels.name << ": " << leaves << " leaves, " << updates << " samples\n";
  }
}

TEST(LeafDigest, TenThousandLeaves) { expectDigest(10'000, 4919441795519992704u); }
TEST(LeafDigest, AMillionLeaves) { expectDigest(1'000'000, 15195361418699730711u); }

}  // namespace
}  // namespace accessvdb::internal

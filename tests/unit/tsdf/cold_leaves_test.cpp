// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Compact leaves say what plain ones say, whenever they become so and however a map changes meanwhile.
#include "tsdf/cold_leaves.h"

#include <gtest/gtest.h>
#include <malloc.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <map>
#include <memory>
#include <new>
#include <numeric>
#include <ostream>
#include <random>
#include <thread>
#include <vector>

#include "tsdf/leaf_facts.h"
#include "tsdf/removed_voxels.h"
#include "tsdf/scan_integrator.h"
#include "unit/tsdf/loop_tsdf.h"

namespace accessvdb::internal {
namespace {

using Values = std::array<std::uint32_t, PackedLeaf::SIZE>;

/// @param weight  (random) -> of an observed voxel
template <typename Weight>
Values randomValues(std::mt19937& random, std::size_t observed, const Weight& weight) {
  Values values = {};
  std::array<std::size_t, PackedLeaf::SIZE> order = {};
  std::iota(order.begin(), order.end(), 0U);
  std::shuffle(order.begin(), order.end(), random);
  for (std::size_t n = 0; n < observed; ++n) values[order[n]] = packVoxel(random() % (kMeanSteps + 1), weight(random));
  return values;
}

void expectSame(const CompactLeaf& block, const Values& values) {
  Values all;
  block.writeTo(all.data());
  ASSERT_EQ(all, values);
  for (std::size_t n = 0; n < values.size(); ++n) ASSERT_EQ(block[n], values[n]) << n;
}

TEST(CompactLeaf, SaysWhatThePlainOneSays) {
  std::mt19937 random(1);
  std::size_t narrow = 0, wide = 0;
  for (std::size_t observed = 0; observed <= PackedLeaf::SIZE; observed += observed < 8 ? 1 : 7) {
    for (const std::uint32_t least : {1U, 2U, 100U, kWeightMask - 16}) {
      for (const std::uint32_t range : {1U, 15U, 16U, 17U}) {
        const Values values = randomValues(random, observed, [&](auto& r) { return least + r() % range; });
        const CompactLeaf* block = makeCompact(values.data());
        if (block == nullptr) {
          EXPECT_GT(observed, 300U);
          continue;
        }
        (block->voxel_bytes == 3 ? narrow : wide) += 1;
        expectSame(*block, values);
        CompactLeaf::free(block);
      }
    }
  }
  EXPECT_GT(narrow, 500U);
  EXPECT_GT(wide, 50U);
}

TEST(CompactLeaf, ACellOfEveryWeightAndMean) {
  for (const std::uint32_t mean : {0U, 1U, kMeanSteps - 1, kMeanSteps}) {
    for (std::uint32_t weight = 1; weight <= kWeightMask; ++weight) {
      Values values = {};
      values[511] = packVoxel(mean, weight);
      values[64] = packVoxel(kMeanSteps - mean, weight > 15 ? weight - 15 : weight);
      const CompactLeaf* block = makeCompact(values.data());
      ASSERT_NE(block, nullptr);
      EXPECT_EQ(block->voxel_bytes, 3U);
      expectSame(*block, values);
      CompactLeaf::free(block);
    }
  }
}

TEST(CompactLeaf, CostsWhatItIsSaidToCost) {
  std::mt19937 random(2);
  for (std::size_t observed = 0; observed <= PackedLeaf::SIZE; observed += 13) {
    const Values values = randomValues(random, observed, [](auto&) { return 7U; });
    const CompactLeaf* block = makeCompact(values.data());
    ASSERT_NE(block, nullptr) << "even a full one is smaller, where its weights are close";
    EXPECT_LT(block->bytes, 96U + 3 * observed + 32);
#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    // malloc may give a block of the next size.
    EXPECT_GE(malloc_usable_size(const_cast<CompactLeaf*>(block)) + sizeof(void*), block->bytes);
    EXPECT_LE(malloc_usable_size(const_cast<CompactLeaf*>(block)) + sizeof(void*), block->bytes + 16);
#endif
    CompactLeaf::free(block);
  }
}

TEST(CompactLeaf, IsInItsLeafUntilItIsWrittenTo) {
  std::mt19937 random(3);
  const Values values = randomValues(random, 200, [](auto& r) { return 1 + r() % 9; });
  auto leaf = std::make_unique<PackedLeaf>(openvdb::PartialCreate(), openvdb::Coord(0));
  allocateZeroed(*leaf);
  std::copy(values.begin(), values.end(), plainValues(*leaf));
  void* plain = putCompact(*leaf, makeCompact(values.data()));
  ASSERT_NE(plain, nullptr);
  PackedVoxel::recycle({&plain, 1});
  const LeafValues compact(*leaf);
  ASSERT_NE(compact.compact(), nullptr);
  LeafValues::Room room;
  EXPECT_TRUE(std::equal(values.begin(), values.end(), compact.all(room)));
  const std::uint32_t bytes = compact.compact()->bytes;
  EXPECT_EQ(makePlain(*leaf), bytes);
  EXPECT_EQ(LeafValues(*leaf).compact(), nullptr);
  EXPECT_TRUE(std::equal(values.begin(), values.end(), plainValues(*leaf)));
}

TsdfParams centimetres(UpdateRegion region) {
  TsdfParams params;
  params.voxel_size_m = 0.01;
  params.truncation_distance_m = 0.04;
  params.region = region;
  return params;
}

struct Contents {
  Values values;
  LeafBits confirmed, blocked;
  bool has_values;
  bool operator==(const Contents&) const = default;
};

std::map<openvdb::Coord, Contents> contentsOf(const PackedMap& map) {
  std::map<openvdb::Coord, Contents> all;
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
    Contents& contents = all[leaf->origin()];
    const LeafValues values(*leaf);
    contents = {{}, map.confirmedIn(*leaf), map.blockedIn(*leaf), static_cast<bool>(values)};
    for (std::size_t n = 0; values && n < PackedLeaf::SIZE; ++n) contents.values[n] = values[n];
  }
  return all;
}

/// Compact leaves and their bytes by looking at each.
void expectCounted(PackedMap& map) {
  std::uint64_t leaves = 0, bytes = 0, with_values = 0;
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
    const LeafValues values(*leaf);
    with_values += values ? 1U : 0U;
    if (values.compact() == nullptr) continue;
    ++leaves;
    bytes += values.compact()->bytes;
  }
  EXPECT_EQ(map.cold().leaves(), leaves);
  EXPECT_EQ(map.cold().bytes(), bytes);
  EXPECT_EQ(map.allocated_leaf_count, with_values);
}

std::vector<LeafChange> sorted(const IntegrationResult& result) {
  std::vector<LeafChange> all;
  for (const auto& part : result.changes) all.insert(all.end(), part.begin(), part.end());
  std::sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.origin_ijk < b.origin_ijk; });
  return all;
}

bool same(const LeafChange& a, const LeafChange& b) {
  return a.origin_ijk == b.origin_ijk && a.collides_on == b.collides_on && a.collides_off == b.collides_off &&
         a.arm_free_on == b.arm_free_on && a.arm_free_off == b.arm_free_off;
}

/// What a map is asked to do besides taking scans.
struct Kind {
  const char* name;
  UpdateRegion region;
  bool votes, ages;
  friend std::ostream& operator<<(std::ostream& out, const Kind& kind) { return out << kind.name; }
};

class TwoMaps : public testing::TestWithParam<Kind> {
 protected:
  /// @param cool  (map) after each scan
  template <typename Cool>
  void compare(const Cool& cool) {
    PackedMap plain(centimetres(GetParam().region)), cold(centimetres(GetParam().region));
    for (PackedMap* map : {&plain, &cold}) {
      map->setCollisionDistance(0.005f);
      if (GetParam().votes) map->blockNewThings(0.02f);
      if (GetParam().ages) map->ageFreeSpace(5);
    }
    ScanIntegrator into_plain(plain), into_cold(cold);
    std::uint64_t most = 0;
    for (int scan = 0; scan < 40; ++scan) {
      // To and fro, so that cold leaves are written to again.
      const float along = 0.15f * static_cast<float>(std::abs(scan % 16 - 8));
      std::vector<Eigen::Vector3f> points = test::wavySheet(400, 0.02 + 0.01 * (scan % 3), static_cast<unsigned>(scan));
      for (Eigen::Vector3f& p : points) p.x() += along;
      const Eigen::Vector3f q(along + 0.1f, 0.2f, 2.0f);
      if (GetParam().ages) {
        static_cast<void>(plain.generations()->pass(plain, 0.5));
        static_cast<void>(cold.generations()->pass(cold, 0.5));
      }
      const std::vector<LeafChange> expected = sorted(into_plain.integrate(points, {&q, 1}));
      for (auto leaf = plain.tree().beginLeaf(); leaf; ++leaf) static_cast<void>(plain.openValues(*leaf));
      const std::vector<LeafChange> found = sorted(into_cold.integrate(points, {&q, 1}));
      ASSERT_TRUE(std::equal(expected.begin(), expected.end(), found.begin(), found.end(), same)) << "scan " << scan;
      if (scan % 10 == 9) remove(plain, cold, static_cast<unsigned>(scan));
      cool(cold);
      most = std::max(most, cold.cold().leaves());
      ASSERT_EQ(contentsOf(cold), contentsOf(plain)) << "scan " << scan;
      expectCounted(cold);
    }
    EXPECT_GT(most, 100U);
    EXPECT_EQ(plain.cold().leaves(), 0U) << "the other map must be plain for this to say anything";
    for (auto leaf = plain.tree().cbeginLeaf(); leaf; ++leaf) {
      const LeafChange a = factsOf(plain, *leaf), b = factsOf(cold, *cold.tree().probeConstLeaf(leaf->origin()));
      ASSERT_TRUE(same(a, b));
    }
  }

 private:
  static void remove(PackedMap& plain, PackedMap& cold, unsigned seed) {
    std::mt19937 random(seed);
    VoxelSet voxels;
    for (auto leaf = plain.tree().cbeginLeaf(); leaf; ++leaf) {
      if (random() % 8 != 0 || !LeafValues(*leaf)) continue;
      LeafBits bits;
      for (std::uint64_t& word : bits) word = random();
      voxels.push_back({leaf->origin(), bits});
    }
    std::sort(voxels.begin(), voxels.end(), [](const auto& a, const auto& b) { return a.origin_ijk < b.origin_ijk; });
    const auto remove = seed % 20 == 9 ? removeAsFree : removeAsUnknown;
    const std::vector<LeafChange> expected = remove(plain, voxels), found = remove(cold, voxels);
    ASSERT_TRUE(std::equal(expected.begin(), expected.end(), found.begin(), found.end(), same));
  }
};

TEST_P(TwoMaps, AreTheSameWhereEverythingIsColdAtOnce) {
  compare([](PackedMap& map) { map.cold().makeAllCompact(); });
}

TEST_P(TwoMaps, AreTheSameWhereLeavesBecomeColdOneByOne) {
  compare([](PackedMap& map) {
    for (std::size_t n = 0; n < ColdLeaves::kPatience / 4; ++n) map.cold().rest();
  });
}

INSTANTIATE_TEST_SUITE_P(OfEveryKind, TwoMaps,
                         testing::Values(Kind{"cone", UpdateRegion::DoubleCone, false, false},
                                         Kind{"cube", UpdateRegion::FullCube, false, false},
                                         Kind{"votes", UpdateRegion::DoubleCone, true, false},
                                         Kind{"ages", UpdateRegion::DoubleCone, true, true}),
                         [](const auto& kind) { return kind.param.name; });

TEST(ColdLeaves, TakeLessMemoryAndBecomePlainOnlyWhereAScanComesNear) {
  PackedMap map(centimetres(UpdateRegion::DoubleCone));
  map.setCollisionDistance(0.005f);
  ScanIntegrator integrator(map);
  const Eigen::Vector3f here(0.1f, 0.2f, 2.0f), there(20.1f, 0.2f, 2.0f);
  const std::vector<Eigen::Vector3f> near = test::wavySheet(3000, 0.02, 1);
  std::vector<Eigen::Vector3f> far = near;
  for (Eigen::Vector3f& p : far) p.x() += 20;
  integrator.integrate(near, {&here, 1});
  const std::uint64_t leaves = map.allocated_leaf_count, bytes = map.memoryBytes();
  for (std::size_t scan = 1; scan < ColdLeaves::kPatience; ++scan) {
    EXPECT_EQ(map.cold().leaves(), 0U) << "too early, at scan " << scan;
    integrator.integrate(far, {&there, 1});
  }
  EXPECT_GT(map.cold().leaves(), leaves / 2);
  map.cold().makeAllCompact();
  EXPECT_EQ(map.cold().leaves(), map.allocated_leaf_count);
  EXPECT_LT(map.memoryBytes(), bytes + bytes / 2) << "both sheets take less than one and a half plain ones";
  integrator.integrate(near, {&here, 1});
  EXPECT_GE(map.cold().leaves(), map.allocated_leaf_count - leaves) << "the far sheet stays as it is";
  EXPECT_LT(map.cold().leaves(), map.allocated_leaf_count - leaves / 2);
}

/// What tiles take decides which of them leave, and what is left out.
TEST(ColdLeaves, AreTheSameOnABusyMachine) {
  const auto memoryAfterEachScan = [] {
    PackedMap map(centimetres(UpdateRegion::DoubleCone));
    map.setCollisionDistance(0.005f);
    ScanIntegrator integrator(map);
    const std::vector<Eigen::Vector3f> sheet = test::wavySheet(2500, 0.02, 1);
    std::vector<std::uint64_t> bytes;
    for (std::uint64_t scan = 0; scan < 3 * ColdLeaves::kPatience; ++scan) {
      const float x = 1.5f * static_cast<float>(scan);
      std::vector<Eigen::Vector3f> points = sheet;
      for (Eigen::Vector3f& p : points) p.x() += x;
      const Eigen::Vector3f q(x, 0.2f, 2.0f);
      integrator.integrate(points, {&q, 1});
      bytes.push_back(map.memoryBytes());
    }
    EXPECT_GT(map.cold().leaves(), 400U);
    return bytes;
  };
  const std::vector<std::uint64_t> alone = memoryAfterEachScan();
  std::atomic<bool> done = false;
  std::vector<std::thread> others;
  for (int n = 0; n < 8; ++n) {
    others.emplace_back([&] {
      while (!done) {
      }
    });
  }
  const std::vector<std::uint64_t> busy = memoryAfterEachScan();
  done = true;
  for (std::thread& other : others) other.join();
  EXPECT_EQ(alone, busy);
}

TEST(ColdLeaves, AreThoseThatNoScanAddedToBetweenTwoLooks) {
  PackedMap map(centimetres(UpdateRegion::DoubleCone));
  map.setCollisionDistance(0.005f);
  ScanIntegrator integrator(map);
  const std::vector<Eigen::Vector3f> points = test::wavySheet(3000, 0.02, 1);
  const Eigen::Vector3f q(0.1f, 0.2f, 2.0f);
  for (std::size_t after = 0; after < ColdLeaves::kPatience; ++after) {
    SCOPED_TRACE("a second scan after so many elsewhere: " + std::to_string(after));
    integrator.integrate(points, {&q, 1});
    const bool once = after == 0;
    for (std::size_t n = 1; n < after; ++n) map.cold().rest();
    if (!once) integrator.integrate(points, {&q, 1});
    std::size_t looks = once ? 1 : after + 1;  // of which each scan is one
    for (; map.cold().leaves() != map.allocated_leaf_count && looks < 3 * ColdLeaves::kPatience; ++looks) {
      EXPECT_EQ(map.cold().leaves(), 0U);
      const bool any = map.cold().rest();
      EXPECT_EQ(any, map.cold().leaves() != 0);
    }
    EXPECT_EQ(looks, once ? ColdLeaves::kPatience : 2 * ColdLeaves::kPatience);
    EXPECT_FALSE(map.cold().rest());
  }
}

/// Its new leaves are gone with it.
TEST(ColdLeaves, AreForgottenWhereAScanFails) {
  PackedMap map(centimetres(UpdateRegion::DoubleCone));
  map.setCollisionDistance(0.005f);
  ScanIntegrator integrator(map);
  std::vector<Eigen::Vector3f> points = test::wavySheet(3000, 0.02, 1);
  const Eigen::Vector3f here(0.1f, 0.2f, 2.0f), there(20.1f, 0.2f, 2.0f);
  integrator.integrate(points, {&here, 1});
  std::atomic<bool> fails = true;
  integrator.visitChanges([&](std::size_t, const LeafChange&) {
    if (fails.exchange(false)) throw std::bad_alloc();
  });
  for (Eigen::Vector3f& p : points) p.x() += 20;
  EXPECT_THROW(integrator.integrate(points, {&there, 1}), std::bad_alloc);
  EXPECT_FALSE(map.cold().rest()) << "nothing is listed";
  for (std::size_t scan = 0; scan < 2 * ColdLeaves::kPatience; ++scan) integrator.integrate(points, {&there, 1});
  for (std::size_t scan = 0; scan < 2 * ColdLeaves::kPatience; ++scan) map.cold().rest();
  EXPECT_GT(map.cold().leaves(), 100U);
}

/// A ray that passes a compact leaf clears voxels there; its values stay as they are.
TEST(ColdLeaves, StayWhereRaysOnlyPass) {
  PackedMap cold(centimetres(UpdateRegion::DoubleCone)), plain(centimetres(UpdateRegion::DoubleCone));
  const std::vector<Eigen::Vector3f> points = test::wavySheet(3000, 0.02, 1);
  std::vector<Eigen::Vector3f> below = points;
  for (Eigen::Vector3f& p : below) p.z() -= 0.15f;
  const Eigen::Vector3f q(0.1f, 0.2f, 2.0f);
  std::vector<LeafChange> changes[2];
  std::uint64_t leaves = 0;
  for (PackedMap* map : {&cold, &plain}) {
    map->setCollisionDistance(0.005f);
    ScanIntegrator integrator(*map);
    integrator.integrate(points, {&q, 1});
    if (map == &cold) map->cold().makeAllCompact();
    leaves = cold.cold().leaves();
    changes[map == &cold ? 0 : 1] = sorted(integrator.integrate(below, {&q, 1}));
  }
  EXPECT_GT(leaves, 100U);
  EXPECT_EQ(cold.cold().leaves(), leaves);
  EXPECT_EQ(contentsOf(cold), contentsOf(plain));
  ASSERT_EQ(changes[0].size(), changes[1].size());
  std::size_t of_cold = 0;
  for (std::size_t n = 0; n < changes[0].size(); ++n) {
    EXPECT_TRUE(same(changes[0][n], changes[1][n]));
    const auto& [x, y, z] = changes[0][n].origin_ijk;
    of_cold += LeafValues(*cold.tree().probeConstLeaf({x, y, z})).compact() != nullptr ? 1 : 0;
  }
  EXPECT_GT(of_cold, 10U) << "no ray cleared anything in a compact leaf";
}

}  // namespace
}  // namespace accessvdb::internal

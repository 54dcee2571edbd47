// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Nodes that a device adds to the mirror by itself and the host adopts, against a mirror to which all was applied.
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <map>
#include <set>
#include <vector>

#include "accessvdb/error.h"
#include "cpu/host_arena.h"
#include "mirror/nanovdb_mirror.h"
#include "parity/mirror_checks.h"
#include "parity/staged_arena.h"

namespace accessvdb::testing {
namespace {

using internal::NanoVdbMirror;
using kernels::GridGrowth;
using kernels::GridSpace;
using kernels::GrowthCounts;
using kernels::HostArena;
using kernels::OccupancyLeaf;
using kernels::OccupancyLower;
using kernels::OccupancyUpper;
using Origin = GridGrowth::Origin;

nanovdb::Coord at(const Origin& ijk) { return {ijk[0], ijk[1], ijk[2]}; }
Origin alignedTo(const Origin& ijk, std::int32_t size) { return {ijk[0] & -size, ijk[1] & -size, ijk[2] & -size}; }
bool bringsBits(const LeafChange& change) {
  for (std::size_t w = 0; w < 8; ++w) {
    if ((change.collides_on[w] & ~change.collides_off[w]) != 0) return true;
    if ((change.arm_free_on[w] & ~change.arm_free_off[w]) != 0) return true;
  }
  return false;
}

/// What one step of the device added.
struct DeviceGrowth {
  std::vector<Origin> uppers, lowers, leaves;
  [[nodiscard]] GridGrowth view() const { return {uppers, lowers, leaves}; }
};

/// Knows nothing but the grid and the space; writes nodes by NanoVDB's own functions, and bits voxel by voxel.
class WritingDevice {
 public:
  explicit WritingDevice(const NanoVdbMirror& mirror) : grid_(const_cast<kernels::OccupancyGrid*>(mirror.grid())) {}

  /// The nodes that `changes` lack, with the leaves in this order; nothing is written.
  [[nodiscard]] DeviceGrowth lacking(const std::vector<LeafChange>& changes) const {
    DeviceGrowth growth;
    std::set<Origin> uppers, lowers, leaves;
    for (const LeafChange& change : changes) {
      const Origin& leaf = change.origin_ijk;
      const Origin lower = alignedTo(leaf, 128), upper = alignedTo(leaf, 4096);
      if (!bringsBits(change) || leafAt(leaf) != nullptr) continue;
      if (leaves.insert(leaf).second) growth.leaves.push_back(leaf);
      if (lowerAt(lower) == nullptr && lowers.insert(lower).second) growth.lowers.push_back(lower);
      if (upperAt(upper) == nullptr && uppers.insert(upper).second) growth.uppers.push_back(upper);
    }
    return growth;
  }

  void write(const DeviceGrowth& growth, const GridSpace& space) {
    const GrowthCounts added = growth.view().counts();
    auto* tree = &grid_->tree();
    auto* root = tree->root().data();
    for (std::uint32_t n = 0; n < added.uppers; ++n) {
      auto* upper = place<OccupancyUpper>(kernels::newUpperOffset(space, n));
      upper->data()->setOrigin(at(growth.uppers[n]));
      root->mTableSize = space.uppers + n + 1;
      root->tile(space.uppers + n)->setChild(at(growth.uppers[n]), upper, root);
    }
    for (std::uint32_t n = 0; n < added.lowers; ++n) {
      auto* lower = place<OccupancyLower>(kernels::newLowerOffset(space, added, n));
      lower->data()->setOrigin(at(growth.lowers[n]));
      link(*upperAt(growth.lowers[n])->data(), OccupancyUpper::CoordToOffset(at(growth.lowers[n])), lower);
    }
    for (std::uint32_t n = 0; n < added.leaves; ++n) {
      auto* leaf = place<OccupancyLeaf>(kernels::newLeafOffset(space, added, space.leaves + n));
      leaf->data()->mBBoxMin = at(growth.leaves[n]);
      link(*lowerAt(growth.leaves[n])->data(), OccupancyLower::CoordToOffset(at(growth.leaves[n])), leaf);
    }
    const std::uint32_t counts[3] = {space.leaves + added.leaves, space.lowers + added.lowers,
                                     space.uppers + added.uppers};
    std::copy_n(counts, 3, tree->data()->mNodeCount);
  }

  void switchBits(const std::vector<LeafChange>& changes) {
    for (const LeafChange& change : changes) {
      OccupancyLeaf* const leaf = leafAt(change.origin_ijk);
      if (leaf == nullptr) continue;
      std::array<std::uint8_t, 8> cells = {};
      for (std::uint32_t n = 0; n < 512; ++n) {
        const auto has = [n](const LeafBits& bits) { return (bits[n / 64] >> (n % 64) & 1) != 0; };
        if (has(change.collides_on)) leaf->data()->mValues.setOn(n);
        if (has(change.collides_off)) leaf->data()->mValues.setOff(n);
        if (has(change.arm_free_on)) leaf->data()->mValueMask.setOn(n);
        if (has(change.arm_free_off)) leaf->data()->mValueMask.setOff(n);
        if (leaf->getValue(n)) ++cells[(n >> 8 & 1) << 2 | (n >> 5 & 1) << 1 | (n >> 2 & 1)];
      }
      std::memcpy(&leaf->data()->mPadding, cells.data(), cells.size());
    }
  }

 private:
  template <class Node>
  Node* place(std::uint64_t offset) {
    return reinterpret_cast<Node*>(reinterpret_cast<std::byte*>(grid_) + offset);
  }
  template <class Parent>
  static void link(Parent& parent, std::uint32_t entry, const void* child) {
    parent.mChildMask.setOn(entry);
    parent.setChild(entry, child);
  }
  [[nodiscard]] OccupancyUpper* upperAt(const Origin& ijk) const {
    auto* root = grid_->tree().root().data();
    for (std::uint32_t n = 0; n < root->mTableSize; ++n) {
      if (root->tile(n)->origin() == at(alignedTo(ijk, 4096))) return root->getChild(root->tile(n));
    }
    return nullptr;
  }
  [[nodiscard]] OccupancyLower* lowerAt(const Origin& ijk) const {
    OccupancyUpper* const upper = upperAt(ijk);
    const std::uint32_t entry = OccupancyUpper::CoordToOffset(at(ijk));
    return upper == nullptr || !upper->data()->mChildMask.isOn(entry) ? nullptr : upper->data()->getChild(entry);
  }
  [[nodiscard]] OccupancyLeaf* leafAt(const Origin& ijk) const {
    return const_cast<OccupancyLeaf*>(grid_->tree().root().probeLeaf(at(ijk)));
  }

  kernels::OccupancyGrid* grid_;
};

/// A mirror whose nodes are added by either side, and its reference.
struct SharedMirror {
  explicit SharedMirror(std::unique_ptr<kernels::MirrorArena> arena = std::make_unique<HostArena>())
      : mirror(std::move(arena), 0.01) {}

  void byHost(const std::vector<LeafChange>& changes) {
    mirror.apply(changes);
    reference.apply(changes);
  }
  /// In `steps` growths, none of which the host adopts before the last is written.
  void byDevice(const std::vector<LeafChange>& changes, std::size_t steps = 1) {
    GridSpace space = mirror.space();
    const std::uint64_t leaves = mirror.leafCount();
    // More than needed: every change in nodes of its own, in each step.
    const auto most = static_cast<std::uint32_t>(device.lacking(changes).leaves.size());
    const GrowthCounts all = device.lacking(changes).view().counts();
    mirror.reserve(steps * kernels::growthBytes(space, {all.uppers, all.lowers, most}));
    ASSERT_EQ(mirror.space(), space);
    std::vector<DeviceGrowth> growths;
    for (std::size_t step = 0; step < steps; ++step) {
      const std::size_t begin = changes.size() * step / steps, end = changes.size() * (step + 1) / steps;
      const std::vector<LeafChange> part(changes.begin() + static_cast<std::ptrdiff_t>(begin),
                                         changes.begin() + static_cast<std::ptrdiff_t>(end));
      growths.push_back(device.lacking(part));
      device.write(growths.back(), space);
      device.switchBits(part);
      space = kernels::grown(space, growths.back().view().counts());
    }
    for (const DeviceGrowth& growth : growths) {
      mirror.adopt(growth.view());
      ASSERT_EQ(mirror.lastTraffic().leaves_added, growth.leaves.size());
      ASSERT_EQ(mirror.lastTraffic().leaves_patched + mirror.lastTraffic().bytes_written, 0u);
    }
    ASSERT_EQ(mirror.space(), space);
    ASSERT_EQ(mirror.leafCount(), leaves + most);
    reference.apply(changes);
  }

  /// Every voxel of every leaf, and the counts.
  [[nodiscard]] ::testing::AssertionResult agree() const {
    const TreeCensus found = walkTree(*mirror.grid()), wanted = walkTree(*reference.grid());
    if (!found.problem.empty()) return ::testing::AssertionFailure() << found.problem;
    const auto numbers = [](const TreeCensus& census) {
      return std::array{census.leaves, census.lowers, census.uppers, census.true_voxels, census.active_voxels};
    };
    if (numbers(found) != numbers(wanted)) return ::testing::AssertionFailure() << "other numbers of nodes or voxels";
    const auto& tree = mirror.grid()->tree();
    if (tree.nodeCount(0) != found.leaves || tree.nodeCount(1) != found.lowers || tree.nodeCount(2) != found.uppers ||
        mirror.leafCount() != found.leaves || mirror.rootTileCount() != found.uppers) {
      return ::testing::AssertionFailure() << "miscounted nodes";
    }
    if (mirror.usedBytes() > mirror.committedBytes() || mirror.grid()->gridSize() != mirror.committedBytes()) {
      return ::testing::AssertionFailure() << "the size of the grid is not what is backed";
    }
    auto voxels = mirror.grid()->getAccessor();
    auto& root = reference.grid()->tree().root();
    for (std::uint32_t t = 0; t < root.tileCount(); ++t) {
      auto& upper = const_cast<OccupancyUpper&>(*root.data()->getChild(root.data()->tile(t)));
      for (auto lower = upper.beginChild(); lower; ++lower) {
        for (auto leaf = lower->beginChild(); leaf; ++leaf) {
          for (std::uint32_t n = 0; n < 512; ++n) {
            const nanovdb::Coord ijk = leaf->offsetToGlobalCoord(n);
            if (voxels.getValue(ijk) != leaf->getValue(n) || voxels.isActive(ijk) != leaf->isActive(n)) {
              return ::testing::AssertionFailure() << "differs at " << ijk[0] << ' ' << ijk[1] << ' ' << ijk[2];
            }
          }
        }
      }
    }
    return ::testing::AssertionSuccess();
  }

  NanoVdbMirror mirror, reference{std::make_unique<HostArena>(), 0.01};
  WritingDevice device{mirror};
};

/// `count` leaves in a row from the first-th on, 16 in a lower node.
std::vector<LeafChange> row(ChangeMaker& maker, int first, int count) {
  std::vector<LeafChange> changes;
  for (int n = first; n < first + count; ++n) {
    changes.push_back(maker.change({8 * n - 4096, -8, 0}));
    changes.back().collides_on[0] |= 1;
    changes.back().collides_off[0] &= ~std::uint64_t{1};
  }
  return changes;
}

TEST(MirrorAdoption, TurnsOfHostAndDeviceInRandomStreams) {
  for (std::uint64_t seed = 20; seed < 23; ++seed) {
    ChangeMaker maker(seed);
    SharedMirror shared;
    for (int round = 0; round < 12; ++round) {
      SCOPED_TRACE("seed " + std::to_string(seed) + ", round " + std::to_string(round));
      auto changes = maker.batch(1 + maker.below(400));
      const auto kind = maker.below(6);
      if (kind == 0) changes.insert(changes.end(), changes.begin(), changes.begin() + changes.size() / 2);
      if (kind < 3) shared.byHost(changes);
      if (kind >= 3) shared.byDevice(changes, kind - 2);
      ASSERT_FALSE(HasFatalFailure());
      ASSERT_TRUE(shared.agree());
    }
    EXPECT_GT(shared.mirror.leafCount(), 1000u);
    EXPECT_GT(shared.mirror.rootTileCount(), 30u);
  }
}

/// Enough leaves and lower nodes for several threads, over several upper nodes, in no order.
TEST(MirrorAdoption, ManyNodesAtOnce) {
  ChangeMaker maker(24);
  SharedMirror shared;
  std::vector<LeafChange> changes;
  for (int x = 0; x < 80; ++x) {
    for (int y = 0; y < 80; ++y) changes.push_back(maker.change({56 * x - 2000, 64 * y - 2000, 8 * (x % 7)}));
  }
  std::shuffle(changes.begin(), changes.end(), maker.random());
  const std::uint64_t host_bytes = shared.mirror.hostBytes();
  shared.byDevice(changes);
  EXPECT_GT(shared.mirror.space().lowers, 1000u);
  EXPECT_GT(shared.mirror.hostBytes(), host_bytes + std::uint64_t{1000} * sizeof(std::uint32_t) * 4096);
  ASSERT_TRUE(shared.agree());
  shared.byHost(changes);  // in leaves that the device added
  EXPECT_EQ(shared.mirror.lastTraffic().leaves_added, 0u);
  ASSERT_TRUE(shared.agree());
}

TEST(MirrorAdoption, ChunksFillUpFromBothSides) {
  for (const int before : {0, 1, 511, 512, 513}) {
    for (const int by_device : {1, 511, 512, 513, 1025}) {
      SCOPED_TRACE(std::to_string(before) + " + " + std::to_string(by_device));
      ChangeMaker maker(25);
      SharedMirror shared;
      // Every leaf twice: what the host thought to need must not stay behind as empty chunks.
      auto changes = row(maker, 0, before);
      changes.insert(changes.end(), changes.begin(), changes.end());
      shared.byHost(changes);
      shared.byDevice(row(maker, before, by_device));
      shared.byHost(row(maker, before + by_device, 2));
      ASSERT_FALSE(HasFatalFailure());
      ASSERT_TRUE(shared.agree());
      const std::uint64_t leaves = static_cast<std::uint64_t>(before + by_device + 2);
      ASSERT_EQ(shared.mirror.leafCount(), leaves);
      const GridSpace space = shared.mirror.space();
      EXPECT_EQ(space.top_bytes, 672u + 64 + 64 + 32 * 4096 + space.uppers * 270400 + space.lowers * 33856 +
                                     (leaves + 511) / 512 * 512 * 160);
    }
  }
}

TEST(MirrorAdoption, PlacesByHand) {
  GridSpace space;
  space.top_bytes = 1'000'000;
  space.last_chunk_offset = 32'000;
  space.leaves = 511;
  const GrowthCounts added = {2, 3, 514};
  EXPECT_EQ(kernels::newUpperOffset(space, 1), 1'270'400u);
  EXPECT_EQ(kernels::newLowerOffset(space, added, 2), 1'000'000u + 540'800 + 67'712);
  EXPECT_EQ(kernels::newLeafOffset(space, added, 511), 32'000u + 511 * 160);
  EXPECT_EQ(kernels::newLeafOffset(space, added, 512), 1'642'368u);
  EXPECT_EQ(kernels::newLeafOffset(space, added, 1024), 1'642'368u + 512 * 160);
  EXPECT_EQ(kernels::growthBytes(space, added), 642'368u + 2 * 81'920);
  const std::uint32_t chunks[][3] = {{0, 0, 0},     {0, 1, 1},     {0, 512, 1},    {0, 513, 2}, {511, 0, 0},
                                     {511, 1, 0},   {511, 2, 1},   {512, 0, 0},    {512, 1, 1}, {512, 512, 1},
                                     {513, 511, 0}, {513, 512, 1}, {~0u - 2, 2, 0}};
  for (const auto& [leaves, more, wanted] : chunks) {
    space.leaves = leaves;
    EXPECT_EQ(kernels::newChunks(space, more), wanted) << leaves << " + " << more;
  }
}

TEST(MirrorAdoption, NothingAddedIsNothingChanged) {
  ChangeMaker maker(26);
  SharedMirror shared;
  shared.mirror.adopt({});
  shared.byHost(maker.batch(20));
  const GridSpace space = shared.mirror.space();
  shared.mirror.adopt({});
  EXPECT_EQ(shared.mirror.space(), space);
  EXPECT_EQ(shared.mirror.lastTraffic().leaves_added, 0u);
  EXPECT_TRUE(shared.agree());
}

TEST(MirrorAdoption, WithoutRoomToReserveNothingChanges) {
  ChangeMaker maker(27);
  SharedMirror shared(std::make_unique<HostArena>(std::uint64_t{64} << 20));
  shared.byHost(maker.batch(20));
  const GridSpace space = shared.mirror.space();
  EXPECT_THROW(shared.mirror.reserve(std::uint64_t{64} << 20), ResourceLimit);
  EXPECT_EQ(shared.mirror.space(), space);
  EXPECT_TRUE(shared.agree());
  shared.byDevice(maker.batch(20));
  EXPECT_TRUE(shared.agree());
}

/// A call of the host that ran out of space leaves nodes behind that the grid does not show.
TEST(MirrorAdoption, NodesOfAFailedCallAreThereForTheDevice) {
  for (const bool reserves : {true, false}) {
    ChangeMaker maker(28);
    auto owned = std::make_unique<StagedArena>();
    StagedArena& arena = *owned;
    SharedMirror shared(std::move(owned));
    shared.byHost(row(maker, 0, 10));
    std::vector<LeafChange> far;  // a lower node each
    for (int n = 1; n < 3000; ++n) far.push_back(maker.change({128 * n, 4096, 0}));
    arena.before_commit = [] { throw ResourceLimit("memory.device", "cuda", "none left", "Free some"); };
    EXPECT_THROW(shared.mirror.apply(far), ResourceLimit);
    arena.before_commit = nullptr;
    const GridSpace space = shared.mirror.space();
    EXPECT_GT(space.lowers, shared.mirror.grid()->tree().nodeCount(1));
    if (reserves) {
      shared.mirror.reserve(0);
      EXPECT_EQ(shared.mirror.grid()->tree().nodeCount(1), space.lowers);
      EXPECT_EQ(shared.mirror.space(), space);
      far.resize(space.lowers);
      shared.byDevice(far);
      EXPECT_EQ(walkTree(*shared.mirror.grid()).problem, "");
      EXPECT_EQ(walkTree(*shared.mirror.grid()).true_voxels, walkTree(*shared.reference.grid()).true_voxels);
    } else {
      const Origin leaf = {-4096, -8, 8};
      EXPECT_THROW(shared.mirror.adopt({{}, {}, {&leaf, 1}}), InternalError);
    }
  }
}

TEST(MirrorAdoption, WhatContradictsTheTopologyIsRefused) {
  using Origins = std::vector<Origin>;
  constexpr std::int32_t kFar = 1 << 20;
  const Origin upper = {kFar, 0, 0}, lower = {-4096, 4096 - 128, 0}, leaf = {-4096, -8, 8};
  struct Case {
    const char* what;
    Origins uppers, lowers, leaves;
    bool taken = false;
  };
  std::vector<Case> cases = {
      {"nothing wrong", {upper}, {upper, {-128, -128, 0}}, {upper, leaf}, true},
      {"a leaf that is there", {}, {}, {{-4096, -8, 0}}},
      {"a lower node that is there", {}, {{-4096, -128, 0}}, {}},
      {"an upper node that is there", {{-4096, -4096, 0}}, {}, {}},
      {"a leaf twice", {}, {}, {leaf, {-4096, -8, 16}, leaf}},
      {"a lower node twice", {upper}, {upper, upper}, {}},
      {"an upper node twice", {upper, upper}, {}, {}},
      {"a leaf without a lower node", {upper}, {}, {upper}},
      {"a lower node without an upper node", {}, {lower}, {}},
      {"a leaf that is not aligned", {}, {}, {{-4096, -8, 12}}},
      {"a lower node that is not aligned", {upper}, {{kFar, 64, 0}}, {}},
      {"an upper node that is not aligned", {{kFar, 128, 0}}, {}, {}},
  };
  cases.push_back({"more than was reserved", {}, {}, {}});
  for (int n = 0; n < 32 * 31 * 3; ++n) {
    cases.back().lowers.push_back({128 * (n % 32) - 4096, 128 * (n / 32 % 31) - 4096, 128 * (n / 32 / 31)});
  }
  cases.push_back({"more root tiles than there is room for", {}, {}, {}});
  for (int n = 0; n < 8; ++n) cases.back().uppers.push_back({kFar, 4096 * n, 0});
  for (const Case& refused : cases) {
    SCOPED_TRACE(refused.what);
    ChangeMaker maker(29);
    NanoVdbMirror mirror(std::make_unique<HostArena>(), 0.01, 8);
    mirror.apply(row(maker, 0, 16));
    mirror.reserve(std::uint64_t{4} << 20);
    const GridGrowth growth = {refused.uppers, refused.lowers, refused.leaves};
    const auto idOf = [](const std::function<void()>& call) -> std::string {
      try {
        call();
      } catch (const InternalError& error) {
        return error.id();
      }
      return "";
    };
    EXPECT_EQ(idOf([&] { mirror.adopt(growth); }), refused.taken ? "" : "mirror.adopted");
    const std::string later = refused.taken ? "" : "mirror.half_written";
    EXPECT_EQ(idOf([&] { mirror.apply({}); }), later);
    EXPECT_EQ(idOf([&] { (void)mirror.space(); }), later);
    EXPECT_EQ(idOf([&] { mirror.reserve(0); }), later);
    EXPECT_EQ(idOf([&] { mirror.adopt({}); }), later);
  }
}

}  // namespace
}  // namespace accessvdb::testing

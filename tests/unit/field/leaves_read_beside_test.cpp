// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Leaves that are read while another thread takes scans into the map that do not reach them.
#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <map>
#include <random>
#include <semaphore>
#include <thread>
#include <vector>

#include "tsdf/packed_map.h"
#include "tsdf/scan_integrator.h"

namespace accessvdb::internal {
namespace {

using Origin = std::array<std::int32_t, 3>;
using Values = std::array<std::uint32_t, 512>;

TsdfParams readParams() {
  TsdfParams params;
  params.voxel_size_m = 0.02;
  params.truncation_distance_m = 0.08;
  return params;
}

struct ReadMap {
  ReadMap() { map.setCollisionDistance(0.01f); }
  PackedMap map{readParams()};
  ScanIntegrator integrator{map};
};

struct ReadScan {
  std::vector<Eigen::Vector3f> p_L, q_L;
};

/// Of a rough surface at a height, from above. The map's nodes are 2.56 m high.
ReadScan scanAt(float height_m, unsigned seed) {
  std::mt19937 random(seed);
  const auto uniform = [&](float low, float high) {
    return low + (high - low) * static_cast<float>(random() % 65536) / 65536.0f;
  };
  ReadScan scan;
  scan.q_L.emplace_back(0.1f, 0.1f, height_m + 1.8f);
  for (int n = 0; n < 200; ++n) {
    scan.p_L.emplace_back(uniform(-0.6f, 0.6f), uniform(-0.6f, 0.6f), height_m + uniform(-0.08f, 0.08f));
  }
  return scan;
}
constexpr float kRead = 1.3f, kLower = 0.5f;
/// Whether no scan at the lower height reaches a leaf.
bool isUpper(const Origin& origin) { return origin[2] >= 48; }

std::vector<Origin> leavesOf(const PackedMap& map) {
  std::vector<Origin> origins;
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
    origins.push_back({leaf->origin().x(), leaf->origin().y(), leaf->origin().z()});
  }
  return origins;
}

/// What the leaf holds; zeros where there are no values.
Values valuesOf(const PackedLeaf* leaf) {
  Values values = {};
  if (leaf == nullptr) return values;
  LeafValues::Room room;
  if (const std::uint32_t* all = LeafValues(*leaf).all(room)) std::copy_n(all, values.size(), values.begin());
  return values;
}

std::map<Origin, Values> valuesOf(const PackedMap& map, const std::vector<Origin>& origins) {
  std::map<Origin, Values> values;
  for (const Origin& origin : origins) {
    values[origin] = valuesOf(map.tree().probeConstLeaf({origin[0], origin[1], origin[2]}));
  }
  return values;
}

/// Of two scans one after the other at the same nodes, most leaves that the first reached are not reached by the
/// second.
TEST(LeavesReadBeside, WaitForNoScan) {
  ReadMap of;
  const ReadScan first = scanAt(kRead, 1), second = scanAt(kLower, 2);
  of.integrator.integrate(first.p_L, first.q_L);
  const std::map<Origin, Values> before = valuesOf(of.map, leavesOf(of.map));
  std::binary_semaphore inside{0}, go{0};
  std::atomic<bool> stops = true;
  of.integrator.visitChanges([&](std::size_t, const LeafChange&) {
    if (!stops.exchange(false)) return;
    inside.release();
    go.acquire();
  });
  std::thread fuses([&] { tbb::task_arena(1).execute([&] { of.integrator.integrate(second.p_L, second.q_L); }); });
  inside.acquire();
  std::vector<Origin> elsewhere;  // than where the second scan reaches
  for (const auto& [origin, values] : before) {
    if (isUpper(origin)) elsewhere.push_back(origin);
  }
  ASSERT_GT(elsewhere.size(), before.size() / 4);
  std::vector<Values> read(elsewhere.size());
  of.integrator.readLeaves(elsewhere, [&](std::size_t n, const PackedLeaf* leaf) { read[n] = valuesOf(leaf); });
  go.release();
  fuses.join();
  const std::map<Origin, Values> after = valuesOf(of.map, leavesOf(of.map));
  EXPECT_GT(after.size(), before.size());
  for (std::size_t n = 0; n < read.size(); ++n) {
    EXPECT_EQ(read[n], before.at(elsewhere[n])) << n;
    EXPECT_EQ(read[n], after.at(elsewhere[n])) << n << ": the second scan reaches it";
  }
}

/// Scans at two heights that share nodes, even words of their masks, in turn, so that leaves of the upper one become
/// compact while the other gets scans and new leaves; the upper ones are read. Oracle: a map that takes one scan after
/// the other.
TEST(LeavesReadBeside, AreAsTheLatestScanLeftThem) {
  ReadMap of, stepwise;
  unsigned seed = 0;
  std::uint64_t most_compact = 0;
  std::size_t reads = 0;
  for (int round = 0; round < 6; ++round) {
    for (int n = 0; n < 3; ++n) {
      const ReadScan scan = scanAt(kRead, ++seed);
      for (ReadMap* each : {&of, &stepwise}) each->integrator.integrate(scan.p_L, scan.q_L);
    }
    std::vector<ReadScan> others;
    for (int n = 0; n < 25; ++n) others.push_back(scanAt(kLower - 0.05f * static_cast<float>(n % 5), ++seed));
    for (const ReadScan& scan : others) stepwise.integrator.integrate(scan.p_L, scan.q_L);
    std::vector<Origin> origins;
    for (const Origin& origin : leavesOf(stepwise.map)) {
      if (isUpper(origin)) origins.push_back(origin);
    }
    const std::map<Origin, Values> wanted = valuesOf(stepwise.map, origins);
    std::atomic<bool> ends = false;
    std::thread fuses([&] {
      for (const ReadScan& scan : others) {
        of.integrator.integrate(scan.p_L, scan.q_L);
        most_compact = std::max(most_compact, of.map.cold().leaves());
      }
      ends = true;
    });
    std::vector<Values> read(origins.size());
    for (bool last = false; !last; ++reads) {
      last = ends;
      of.integrator.readLeaves(origins, [&](std::size_t n, const PackedLeaf* leaf) { read[n] = valuesOf(leaf); });
      for (std::size_t n = 0; n < origins.size(); ++n) ASSERT_EQ(read[n], wanted.at(origins[n])) << n;
    }
    fuses.join();
  }
  EXPECT_GT(most_compact, 0U) << "no buffer changed hands";
  EXPECT_GT(reads, 6U);
}

}  // namespace
}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Leaves that are read while another thread takes scans into the map: each is that of whole scans, and only those that
/// share a bucket with what is being fused are waited for.
#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <map>
#include <random>
#include <semaphore>
#include <set>
#include <thread>
#include <vector>

#include "field/point_weights.h"
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

ReadScan scanAt(float x, unsigned seed) {
  std::mt19937 random(seed);
  const auto uniform = [&](float low, float high) {
    return low + (high - low) * static_cast<float>(random() % 65536) / 65536.0f;
  };
  ReadScan scan;
  scan.q_L.emplace_back(x, 0.1f, 1.8f);
  for (int n = 0; n < 200; ++n) {
    scan.p_L.emplace_back(x + uniform(-0.6f, 0.6f), uniform(-0.6f, 0.6f), uniform(-0.08f, 0.08f));
  }
  return scan;
}

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

std::size_t bucketOf(const Origin& origin) {
  return ReturnBins::bucketOf(leafKeyOf(origin[0] >> 3, origin[1] >> 3, origin[2] >> 3));
}

TEST(LeavesReadBeside, WaitOnlyForTheirBucket) {
  ReadMap of;
  const ReadScan first = scanAt(0, 1), second = scanAt(0, 2);
  of.integrator.integrate(first.p_L, first.q_L);
  const std::vector<Origin> origins = leavesOf(of.map);
  std::map<Origin, Values> before, after;
  for (const Origin& origin : origins) {
    before[origin] = valuesOf(of.map.tree().probeConstLeaf({origin[0], origin[1], origin[2]}));
  }
  std::binary_semaphore inside{0}, go{0};
  std::atomic<bool> stops = true;
  Origin held = {};
  of.integrator.visitChanges([&](std::size_t, const LeafChange& change) {
    if (!stops.exchange(false)) return;
    held = change.origin_ijk;
    inside.release();
    go.acquire();
  });
  std::thread fuses([&] { tbb::task_arena(1).execute([&] { of.integrator.integrate(second.p_L, second.q_L); }); });
  inside.acquire();
  std::vector<Origin> elsewhere;
  std::ranges::copy_if(origins, std::back_inserter(elsewhere),
                       [&](const Origin& origin) { return bucketOf(origin) != bucketOf(held); });
  ASSERT_GT(elsewhere.size(), origins.size() / 4);
  std::vector<Values> read(elsewhere.size());
  of.integrator.readLeaves(elsewhere, [&](std::size_t n, const PackedLeaf* leaf) { read[n] = valuesOf(leaf); });
  std::atomic<bool> is_read = false;
  Values of_held = {};
  std::thread waits([&] {
    of.integrator.readLeaves(std::span(&held, 1),
                             [&](std::size_t, const PackedLeaf* leaf) { of_held = valuesOf(leaf); });
    is_read = true;
  });
  std::this_thread::sleep_for(std::chrono::milliseconds(50));  // a wrong call is seen most of the time
  EXPECT_FALSE(is_read);
  go.release();
  waits.join();
  fuses.join();
  for (const Origin& origin : origins) {
    after[origin] = valuesOf(of.map.tree().probeConstLeaf({origin[0], origin[1], origin[2]}));
  }
  for (std::size_t n = 0; n < read.size(); ++n) {
    EXPECT_TRUE(read[n] == before[elsewhere[n]] || read[n] == after[elsewhere[n]]) << n;
  }
  EXPECT_EQ(of_held, after[held]);
  EXPECT_NE(of_held, before[held]);
}

/// Scans at two places in turn, so that leaves of one become compact while the other gets scans. Oracle: a map that
/// takes one scan after the other.
TEST(LeavesReadBeside, AreThoseOfWholeScansInOrder) {
  std::vector<ReadScan> scans;
  for (unsigned n = 0; n < 120; ++n) scans.push_back(scanAt(n / 30 % 2 == 0 ? 0.0f : 9.0f, n));
  ReadMap stepwise;
  std::vector<Origin> origins;
  std::map<Origin, std::vector<Values>> histories;
  {
    ReadMap whole;
    for (const ReadScan& scan : scans) whole.integrator.integrate(scan.p_L, scan.q_L);
    for (const Origin& origin : leavesOf(whole.map)) {
      if (origins.size() < 400 && (origin[0] + origin[1] + origin[2]) % 3 == 0) origins.push_back(origin);
    }
  }
  const auto note = [&] {
    for (const Origin& origin : origins) {
      const Values now = valuesOf(stepwise.map.tree().probeConstLeaf({origin[0], origin[1], origin[2]}));
      std::vector<Values>& history = histories[origin];
      if (history.empty() || history.back() != now) history.push_back(now);
    }
  };
  note();
  for (const ReadScan& scan : scans) {
    stepwise.integrator.integrate(scan.p_L, scan.q_L);
    note();
  }
  ReadMap of;
  std::atomic<bool> ends = false;
  std::uint64_t most_compact = 0;
  std::thread fuses([&] {
    for (const ReadScan& scan : scans) {
      of.integrator.integrate(scan.p_L, scan.q_L);
      most_compact = std::max(most_compact, of.map.cold().leaves());
    }
    ends = true;
  });
  std::vector<std::size_t> at(origins.size());  // in the history
  std::vector<Values> read(origins.size());
  std::set<std::size_t> seen;
  for (bool last = false; !last;) {
    last = ends;
    of.integrator.readLeaves(origins, [&](std::size_t n, const PackedLeaf* leaf) { read[n] = valuesOf(leaf); });
    for (std::size_t n = 0; n < origins.size(); ++n) {
      const std::vector<Values>& history = histories[origins[n]];
      const auto found = std::find(history.begin() + static_cast<std::ptrdiff_t>(at[n]), history.end(), read[n]);
      ASSERT_NE(found, history.end()) << "leaf " << n << ", after state " << at[n];
      at[n] = static_cast<std::size_t>(found - history.begin());
    }
    seen.insert(at[0]);
  }
  fuses.join();
  for (std::size_t n = 0; n < origins.size(); ++n) EXPECT_EQ(at[n] + 1, histories[origins[n]].size());
  EXPECT_GT(most_compact, 0U) << "no buffer changed hands";
}

/// Oracle: the voxels around each one by one.
TEST(LeavesReadBeside, WeightsAroundVoxelsAreTheLargest) {
  ReadMap of;
  for (unsigned n = 0; n < 5; ++n) {
    const ReadScan scan = scanAt(0, n);
    of.integrator.integrate(scan.p_L, scan.q_L);
  }
  std::mt19937 random(3);
  std::vector<Index3> voxels(3000);
  for (Index3& voxel : voxels) {
    for (std::size_t axis = 0; axis < 3; ++axis)
      voxel[axis] = static_cast<std::int32_t>(random() % (axis < 2 ? 60 : 16)) - (axis < 2 ? 30 : 8);
  }
  std::size_t some = 0, none = 0;
  for (const int reach : {0, 1, 3}) {
    std::vector<std::uint16_t> weights(voxels.size(), 7);
    readWeightsBeside(of.integrator, reach, voxels, weights);
    for (std::size_t n = 0; n < voxels.size(); ++n) {
      std::uint32_t most = 0;
      for (int x = -reach; x <= reach; ++x)
        for (int y = -reach; y <= reach; ++y)
          for (int z = -reach; z <= reach; ++z)
            most = std::max(most, of.map.at({voxels[n][0] + x, voxels[n][1] + y, voxels[n][2] + z}).weight);
      ASSERT_EQ(weights[n], most) << n << ", " << reach;
      ++(most > 0 ? some : none);
    }
  }
  EXPECT_GT(some, 1000U);
  EXPECT_GT(none, 100U);
}

}  // namespace
}  // namespace accessvdb::internal

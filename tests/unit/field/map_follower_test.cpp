// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How scans get into a map that follows: in order, at most four behind, and not after an error.
#include "field/map_follower.h"
#include "field/returning_values.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <new>
#include <optional>
#include <random>
#include <semaphore>
#include <set>
#include <stdexcept>
#include <thread>
#include <vector>

#include "support/map_hash.h"
#include "tsdf/packed_map.h"
#include "tsdf/scan_integrator.h"

namespace accessvdb::internal {
namespace {

using Scan = MapFollower::Scan;
using std::chrono::milliseconds;

/// A scan that says its number; its hash is the number, too.
Scan numbered(int number) {
  Scan scan;
  scan.p_L.emplace_back(static_cast<float>(number), 0.0f, 0.0f);
  scan.q_L.emplace_back(0.0f, 0.0f, 1.0f);
  return scan;
}
int numberOf(const Scan& scan) { return static_cast<int>(scan.p_L.at(0).x()); }

void give(MapFollower& follower, int number) {
  Scan scan = numbered(number);
  follower.take(scan, static_cast<std::uint64_t>(number));
}

/// Takes in a scan only when the test says so; scans begun are in `begun`, for the test once they are in the map.
class GatedMap {
 public:
  MapFollower::Fuse fuse() {
    return [this](const Scan& scan) {
      begun.push_back(numberOf(scan));
      ++count;
      gate_.acquire();
      return static_cast<std::uint64_t>(numberOf(scan));
    };
  }
  void let(int scans) { gate_.release(scans); }
  void waitUntilBegun(int scans) const {
    while (count < scans) std::this_thread::sleep_for(milliseconds(1));
  }

  std::vector<int> begun;
  std::atomic<int> count = 0;

 private:
  std::counting_semaphore<1000> gate_{0};
};

/// Runs a call on another thread, as the test waits for it or sees that it waits.
class Beside {
 public:
  explicit Beside(const std::function<void()>& call)
      : thread_([this, call] {
          call();
          done_ = true;
        }) {}
  ~Beside() { wait(); }
  void wait() {
    if (thread_.joinable()) thread_.join();
  }
  /// Right calls need not wait for the time, and wrong ones are seen most of the time.
  [[nodiscard]] bool waits() const {
    std::this_thread::sleep_for(milliseconds(20));
    return !done_;
  }

 private:
  std::atomic<bool> done_ = false;
  std::thread thread_;
};

std::exception_ptr errorOf(const std::function<void()>& call) {
  try {
    call();
  } catch (...) {
    return std::current_exception();
  }
  return nullptr;
}

TEST(MapFollower, TakesScansInOrderOnOneThread) {
  std::vector<int> taken;
  std::set<std::thread::id> threads;
  std::set<int> concurrency;
  MapFollower follower(
      [&](const Scan& scan) {
        taken.push_back(numberOf(scan));
        threads.insert(std::this_thread::get_id());
        concurrency.insert(tbb::this_task_arena::max_concurrency());
        return static_cast<std::uint64_t>(numberOf(scan));
      },
      1);
  follower.join();
  EXPECT_EQ(follower.taken(), 0u);
  std::vector<int> expected;
  for (int n = 0; n < 200; ++n) {
    give(follower, n);
    expected.push_back(n);
    if (n % 50 != 49) continue;
    follower.join();
    ASSERT_EQ(taken, expected);
    EXPECT_EQ(follower.taken(), expected.size());
    EXPECT_EQ(follower.behind(), 0u);
  }
  EXPECT_EQ(threads.size(), 1u);
  EXPECT_EQ(threads.count(std::this_thread::get_id()), 0u);
  EXPECT_EQ(concurrency, std::set<int>{1});
  EXPECT_FALSE(follower.diverged());
}

TEST(MapFollower, IsAtMostFourBehind) {
  GatedMap map;
  MapFollower follower(map.fuse(), 1);
  for (int n = 0; n < 4; ++n) give(follower, n);
  map.waitUntilBegun(1);
  EXPECT_EQ(follower.behind(), 4u);
  EXPECT_EQ(follower.taken(), 0u);
  for (int n = 4; n < 10; ++n) {
    Beside fifth([&] { give(follower, n); });
    EXPECT_TRUE(fifth.waits());
    EXPECT_EQ(follower.behind(), 4u);
    EXPECT_EQ(map.count, n - 3);
    map.let(1);
    fifth.wait();
    map.waitUntilBegun(n - 2);
    EXPECT_EQ(follower.taken(), static_cast<std::uint64_t>(n - 3));
  }
  map.let(4);
  follower.join();
  EXPECT_EQ(map.begun, (std::vector<int>{0, 1, 2, 3, 4, 5, 6, 7, 8, 9}));
  EXPECT_EQ(follower.mostBehind(), 4u);
}

TEST(MapFollower, GivesMemoryBack) {
  MapFollower follower([](const Scan& scan) { return static_cast<std::uint64_t>(numberOf(scan)); }, 1);
  std::set<const void*> blocks;
  Scan scan;
  for (int n = 0; n < 50; ++n) {
    scan.p_L.assign(1000, Eigen::Vector3f(static_cast<float>(n), 0, 0));
    scan.q_L.assign(1, Eigen::Vector3f(0, 0, 1));
    blocks.insert(scan.p_L.data());
    follower.take(scan, static_cast<std::uint64_t>(n));
    ASSERT_TRUE(scan.p_L.empty() && scan.q_L.empty());
  }
  EXPECT_EQ(blocks.size(), 5u);
}

/// Whichever scan fails: those before it are in the map, none of those that wait behind it is begun, and everybody
/// hears of it.
TEST(MapFollower, AFailedScanIsTheLast) {
  for (int bad = 0; bad < 7; ++bad) {
    for (const bool waits : {false, true}) {
      SCOPED_TRACE(testing::Message() << "scan " << bad << (waits ? ", joined after each" : ""));
      std::vector<int> begun;
      std::optional<MapFollower> follower;
      follower.emplace(
          [&](const Scan& scan) {
            begun.push_back(numberOf(scan));
            if (numberOf(scan) != bad) return static_cast<std::uint64_t>(numberOf(scan));
            while (!waits && follower->behind() < 4) std::this_thread::sleep_for(milliseconds(1));
            throw std::bad_alloc();
          },
          2);
      std::exception_ptr first;
      for (int n = 0; n < 12 && !first; ++n) {
        Scan scan = numbered(n);
        first = errorOf([&] { follower->take(scan, static_cast<std::uint64_t>(n)); });
        if (first) {
          ASSERT_EQ(scan.p_L.size(), 1u);
          ASSERT_EQ(numberOf(scan), n);
        }
        if (waits && !first) first = errorOf([&] { follower->join(); });
      }
      ASSERT_TRUE(first);
      EXPECT_THROW(std::rethrow_exception(first), std::bad_alloc);
      EXPECT_EQ(errorOf([&] { follower->join(); }), first);
      EXPECT_EQ(errorOf([&] { give(*follower, 99); }), first);
      EXPECT_EQ(errorOf([&] { follower->join(); }), first);
      EXPECT_EQ(follower->taken(), static_cast<std::uint64_t>(bad));
      follower.reset();
      std::vector<int> expected;
      for (int n = 0; n <= bad; ++n) expected.push_back(n);
      EXPECT_EQ(begun, expected);
    }
  }
}

TEST(MapFollower, RemembersTheFirstScanThatDiffers) {
  MapFollower follower([](const Scan& scan) { return static_cast<std::uint64_t>(numberOf(scan)); }, 1);
  for (int n = 0; n < 8; ++n) {
    Scan scan = numbered(n);
    follower.take(scan, static_cast<std::uint64_t>(n == 3 || n == 5 ? 100 : n));
    follower.join();
    EXPECT_EQ(follower.diverged(), n < 3 ? std::nullopt : std::optional<std::uint64_t>(3));
  }
  EXPECT_EQ(follower.taken(), 8u);
}

TEST(MapFollower, EndsWhileBusy) {
  for (const bool fails : {false, true}) {
    GatedMap map;
    std::atomic<int> ended = 0;
    std::thread later;
    {
      MapFollower follower(
          [&, fuse = map.fuse()](const Scan& scan) {
            const std::uint64_t hash = fuse(scan);
            ++ended;
            if (fails) throw std::bad_alloc();
            return hash;
          },
          2);
      for (int n = 0; n < 4; ++n) give(follower, n);
      map.waitUntilBegun(1);
      later = std::thread([&] {
        std::this_thread::sleep_for(milliseconds(20));
        map.let(4);
      });
    }
    EXPECT_EQ(ended, 1);
    EXPECT_EQ(map.begun, std::vector<int>{0});
    later.join();
  }
}

/// Returns around the origin, some of them seen from behind, so that facts flip both ways.
std::vector<Scan> randomScans() {
  std::mt19937 random(7);
  const auto uniform = [&](float low, float high) {
    return low + (high - low) * static_cast<float>(random() % 65536) / 65536.0f;
  };
  std::vector<Scan> scans(12);
  for (Scan& scan : scans) {
    const float side = random() % 4 == 0 ? -1.0f : 1.0f;
    scan.q_L.emplace_back(uniform(-0.5f, 0.5f), uniform(-0.5f, 0.5f), side * uniform(1.5f, 2.0f));
    for (int n = 0; n < 400; ++n) {
      scan.p_L.emplace_back(uniform(-0.4f, 0.4f), uniform(-0.4f, 0.4f), uniform(-0.08f, 0.08f));
    }
  }
  return scans;
}

TEST(MapFollower, MakesTheMapOfIntegratingAtOnce) {
  TsdfParams params;
  params.voxel_size_m = 0.02;
  params.truncation_distance_m = 0.08;
  PackedMap expected(params), map(params);
  ScanIntegrator at_once(expected), behind(map);
  for (PackedMap* each : {&expected, &map}) each->setCollisionDistance(0.01f);
  at_once.hashFlips(true);
  behind.hashFlips(true);
  MapFollower follower([&](const Scan& scan) { return behind.integrate(scan.p_L, scan.q_L, scan.frame).flips_hash; },
                       2);
  std::set<std::uint64_t> hashes;
  for (Scan& scan : randomScans()) {
    const std::uint64_t flips_hash = at_once.integrate(scan.p_L, scan.q_L, scan.frame).flips_hash;
    hashes.insert(flips_hash);
    follower.take(scan, flips_hash);
  }
  follower.join();
  EXPECT_FALSE(follower.diverged());
  EXPECT_EQ(follower.taken(), 12u);
  EXPECT_EQ(hashes.size(), 12u);
  EXPECT_EQ(hashes.count(0), 0u);
  EXPECT_GT(expected.leaf_count, 100u);
  EXPECT_EQ(map.leaf_count, expected.leaf_count);
  EXPECT_EQ(test::hashOf(map), test::hashOf(expected));
}

TEST(ReturningValues, AreTooManyOnlyInManyScansInARow) {
  ReturningValues values;
  const auto note = [&](std::uint64_t read, int scans) {
    for (int n = 0; n < scans; ++n) values.note(read, 100);
  };
  note(50, 100);
  EXPECT_FALSE(values.areTooMany());
  note(51, ReturningValues::kMostScans - 1);
  EXPECT_FALSE(values.areTooMany());
  values.note(10, 100);
  note(51, ReturningValues::kMostScans - 1);
  EXPECT_FALSE(values.areTooMany());
  values.note(51, 100);
  EXPECT_TRUE(values.areTooMany());
}

}  // namespace
}  // namespace accessvdb::internal

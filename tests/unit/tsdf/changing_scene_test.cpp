// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Things that appear before a wall that was watched for long, and go again: after how many scans they block, and after
/// how many the map is as before. What a sensor sees is computed here, ray by ray.
#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <map>
#include <random>
#include <vector>

#include "tsdf/scan_integrator.h"

namespace accessvdb::internal {
namespace {

/// Distances from the sensor, metres.
constexpr float kWall_m = 2.0f;

struct Setting {
  float voxel_m = 0.02f, tau_m = 0.1f, sigma_m = 0.005f;
  int returns = 1000;  ///< a scan, over a wall of 1 m2
  bool block = true;
  [[nodiscard]] float collides_m() const { return 0.5f * voxel_m; }
  [[nodiscard]] float far_m() const { return collides_m() + std::max(2 * voxel_m, 3 * sigma_m); }
};

/// Something before the wall.
struct Thing {
  float front_m = 0;  ///< its front face; 0: there is none
  float left_m = 0, right_m = 0;
};

/// A wall, and before it a bar of 2 voxels or a board, as tall as the wall.
class Scene {
 public:
  explicit Scene(const Setting& setting)
      : setting_(setting), map_(paramsOf(setting)), integrator_((prepare(map_, setting), map_)) {}

  /// @return the returns, local frame
  std::vector<Eigen::Vector3f> scan(const Thing& thing) {
    std::vector<Eigen::Vector3f> points;
    std::normal_distribution<float> noise(0, setting_.sigma_m);
    for (int n = 0; n < setting_.returns; ++n) {
      const float y = uniform() - 0.5f, z = uniform() - 0.5f;
      const Eigen::Vector3f direction = Eigen::Vector3f(kWall_m, y, z) / kWall_m;
      const float y_at_thing = direction.y() * thing.front_m;
      const bool hits = thing.front_m > 0 && y_at_thing >= thing.left_m && y_at_thing <= thing.right_m;
      const float depth_m = hits ? thing.front_m : kWall_m;
      points.push_back(direction * depth_m + direction.normalized() * noise(random_));
    }
    const Eigen::Vector3f sensor(0, 0, 0);
    integrator_.integrate(points, {&sensor, 1});
    return points;
  }
  void watch(int scans, const Thing& thing = {}) {
    for (int n = 0; n < scans; ++n) scan(thing);
  }

  [[nodiscard]] bool collides(const openvdb::Coord& ijk) const {
    const VoxelState state = map_.at(ijk);
    return state.weight > 0 && !(state.distance_m >= setting_.collides_m());
  }
  /// Blocked by the scan before, or by one that no other has denied.
  [[nodiscard]] bool isFullyBlocked(const openvdb::Coord& ijk) const {
    const PackedLeaf* leaf = map_.tree().probeConstLeaf(ijk);
    const VoxelVotes* votes = leaf == nullptr ? nullptr : map_.votesOf(*leaf);
    if (votes == nullptr) return false;
    const openvdb::Index n = PackedLeaf::coordToOffset(ijk);
    return std::all_of(votes->bit.begin(), votes->bit.end(),
                       [n](const LeafBits& bits) { return (bits[n >> 6] >> (n & 63) & 1) != 0; });
  }
  [[nodiscard]] std::uint64_t blockedVoxels() const {
    std::uint64_t count = 0;
    for (auto leaf = map_.tree().cbeginLeaf(); leaf; ++leaf) {
      for (const std::uint64_t word : map_.blockedIn(*leaf)) count += static_cast<std::uint64_t>(std::popcount(word));
    }
    return count;
  }
  [[nodiscard]] const PackedMap& map() const { return map_; }

 private:
  static TsdfParams paramsOf(const Setting& setting) {
    TsdfParams params;
    params.voxel_size_m = static_cast<double>(setting.voxel_m);
    params.truncation_distance_m = static_cast<double>(setting.tau_m);
    return params;
  }
  static void prepare(PackedMap& map, const Setting& setting) {
    map.setCollisionDistance(setting.collides_m());
    if (setting.block) map.blockNewThings(setting.far_m());
  }
  float uniform() { return static_cast<float>(random_() % 65536) / 65536.0f; }

  Setting setting_;
  PackedMap map_;
  ScanIntegrator integrator_;
  std::mt19937 random_{17};
};

double middleOf(std::vector<int> counts) {
  std::sort(counts.begin(), counts.end());
  return counts.empty() ? -1 : counts[counts.size() / 2];
}

/// Voxels of the front of a bar at y = 0 .. 1 voxels, and after how many scans that reach them they collide.
struct Reached {
  int scans = 0;
  int until = 0;  ///< 0: not yet
};
using Front = std::map<openvdb::Coord, Reached>;

Front frontOf(const Setting& setting, const Thing& bar) {
  Front front;
  const int x = static_cast<int>(std::lround(bar.front_m / setting.voxel_m));
  const int half = static_cast<int>(0.4f / setting.voxel_m);
  for (int z = -half; z <= half; ++z) {
    for (int y = 0; y <= 1; ++y) front[{x, y, z}] = {};
  }
  return front;
}

/// @return the scans that reach a voxel until it collides, voxel by voxel; 1000 where it never does
std::vector<int> scansUntilBlocked(Scene& scene, const Setting& setting, const Thing& bar, int scans) {
  Front front = frontOf(setting, bar);
  for (int n = 0; n < scans; ++n) {
    const auto points = scene.scan(bar);
    for (auto& [ijk, reached] : front) {
      const Eigen::Vector3f centre =
          Eigen::Vector3f(static_cast<float>(ijk.x()), static_cast<float>(ijk.y()), static_cast<float>(ijk.z())) *
          setting.voxel_m;
      const bool reaches = std::any_of(points.begin(), points.end(), [&](const Eigen::Vector3f& p) {
        return (p - centre).norm() <= setting.voxel_m;
      });
      reached.scans += reaches ? 1 : 0;
      if (reached.until == 0 && scene.collides(ijk)) reached.until = reached.scans;
    }
  }
  std::vector<int> until;
  for (const auto& [ijk, reached] : front) until.push_back(reached.until == 0 ? 1000 : reached.until);
  return until;
}

Thing barBefore(const Setting& setting, float gap_m) {
  return {kWall_m - gap_m, -0.5f * setting.voxel_m, 1.5f * setting.voxel_m};
}

/// Without votes the bar does not block within 60 scans: this is what the rule is for.
TEST(ChangingScene, ABarBeforeAWallBlocksAtOnce) {
  for (const bool block : {false, true}) {
    Setting setting;
    setting.block = block;
    Scene scene(setting);
    scene.watch(300);
    const Thing bar = barBefore(setting, 0.06f);
    for (const auto& [ijk, reached] : frontOf(setting, bar)) ASSERT_FALSE(scene.collides(ijk));
    const std::vector<int> until = scansUntilBlocked(scene, setting, bar, 60);
    const double median = middleOf(until);
    RecordProperty(block ? "median_scans_block" : "median_scans_off", std::to_string(median));
    if (!block) {
      EXPECT_EQ(median, 1000);
      continue;
    }
    EXPECT_LE(median, 3);
    EXPECT_GE(*std::min_element(until.begin(), until.end()), 3) << "one scan, or two, is no evidence";
    const auto late = std::count_if(until.begin(), until.end(), [](int n) { return n > 10; });
    EXPECT_LE(late, static_cast<std::ptrdiff_t>(until.size() / 20));
  }
}

/// Its front collides at once, but what lies behind is within tau of the wall: it blocks while the front is young, two
/// voxels behind it in about half of the voxels. Without that half of the rule, in none.
TEST(ChangingScene, WhatLiesBehindAFrontBeyondTauBlocksToo) {
  Setting setting;
  Scene scene(setting);
  scene.watch(300);
  const float v = setting.voxel_m;
  const Thing board = {kWall_m - 6 * v, -5.5f * v, 5.5f * v};
  scene.watch(10, board);
  int inside = 0, blocked = 0;
  const int x = static_cast<int>(std::lround(board.front_m / v));
  for (int y = -3; y <= 3; ++y) {
    for (int z = -10; z <= 10; ++z) {
      ++inside;
      blocked += scene.collides({x + 2, y, z}) ? 1 : 0;
    }
  }
  EXPECT_GE(blocked, inside * 35 / 100);
  RecordProperty("percent_blocked", std::to_string(100 * blocked / inside));
}

/// After it has gone, five scans that see through free it, not fewer; when it comes back, three block it again.
TEST(ChangingScene, WhatGoesIsFreeAgainAndBlocksAgainWhenItComesBack) {
  Setting setting;
  Scene scene(setting);
  scene.watch(300);
  const Thing bar = barBefore(setting, 0.06f);
  for (int time = 0; time < 2; ++time) {
    SCOPED_TRACE(time);
    const std::vector<int> until = scansUntilBlocked(scene, setting, bar, 30);
    EXPECT_LE(middleOf(until), 3);
    std::vector<openvdb::Coord> blocked;
    for (const auto& [ijk, reached] : frontOf(setting, bar)) {
      if (scene.isFullyBlocked(ijk)) blocked.push_back(ijk);
    }
    ASSERT_GT(blocked.size(), 30u);
    std::vector<int> free_after(blocked.size(), 1000);
    for (int n = 1; n <= 40; ++n) {
      scene.scan({});
      for (std::size_t k = 0; k < blocked.size(); ++k) {
        if (free_after[k] == 1000 && !scene.collides(blocked[k])) free_after[k] = n;
      }
    }
    EXPECT_GE(*std::min_element(free_after.begin(), free_after.end()), 5);
    EXPECT_LE(middleOf(free_after), 12);
    RecordProperty("median_scans_until_free", std::to_string(middleOf(free_after)));
  }
}

/// Range noise alone must not block anything: neither with returns as noisy as a voxel is long, nor twice that.
TEST(ChangingScene, NoiseBlocksNothing) {
  for (const float sigmas_a_voxel : {1.0f, 2.0f}) {
    Setting setting;
    setting.sigma_m = sigmas_a_voxel * setting.voxel_m;
    setting.tau_m = std::max(4 * setting.voxel_m, 5 * setting.sigma_m);
    Scene scene(setting);
    scene.watch(600);
    // Of 2 500 voxels a layer and at least 5 layers within tau before the wall: 0.1 % at sigma = v. A rule that takes
    // any return as news blocks most of them.
    EXPECT_LE(scene.blockedVoxels(), 12u) << sigmas_a_voxel;
    RecordProperty(sigmas_a_voxel > 1 ? "blocked_2v" : "blocked_1v", std::to_string(scene.blockedVoxels()));
  }
}

/// A branch seen first from below for long, then from above, is no change: shadows of known things are no news.
TEST(ChangingScene, TheOtherSideOfAKnownBranchIsNoNews) {
  TsdfParams params;
  params.voxel_size_m = 0.02;
  params.truncation_distance_m = 0.1;
  std::array<std::uint64_t, 2> colliding = {};
  for (std::size_t block = 0; block < 2; ++block) {
    PackedMap map(params);
    map.setCollisionDistance(0.01f);
    if (block != 0) map.blockNewThings(0.05f);
    ScanIntegrator integrator(map);
    std::mt19937 random(5);
    const auto uniform = [&random](float low, float high) {
      return low + (high - low) * static_cast<float>(random() % 65536) / 65536.0f;
    };
    for (int scan = 0; scan < 300; ++scan) {
      const Eigen::Vector3f sensor(uniform(-0.5f, 0.5f), uniform(-0.5f, 0.5f), scan < 150 ? -2.0f : 2.0f);
      std::vector<Eigen::Vector3f> points;
      for (int n = 0; n < 400; ++n) {
        // Branches along x, 0.15 m apart, with radii from half a voxel to two and a half.
        const int branch = static_cast<int>(random() % 5);
        const float radius = 0.01f * static_cast<float>(1 + branch), y = 0.15f * static_cast<float>(branch - 2);
        const Eigen::Vector3f axis(uniform(-0.4f, 0.4f), y, 0);
        // Any point of the half that faces the sensor.
        const Eigen::Vector3f towards = (sensor - axis).normalized(), along(1, 0, 0);
        const Eigen::Vector3f across = along.cross(towards).normalized(), facing = across.cross(along);
        const float turn = uniform(-1.4f, 1.4f);
        points.push_back(axis + radius * (std::cos(turn) * facing + std::sin(turn) * across));
      }
      integrator.integrate(points, {&sensor, 1});
    }
    for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
      for (openvdb::Index n = 0; n < PackedLeaf::SIZE; ++n) {
        const VoxelState state = map.at(leaf->offsetToGlobalCoord(n));
        colliding[block] += state.weight > 0 && state.distance_m < 0.01f ? 1 : 0;
      }
    }
  }
  EXPECT_GT(colliding[0], 500u);
  EXPECT_LE(colliding[1], colliding[0] * 101 / 100);
  RecordProperty("colliding_off", std::to_string(colliding[0]));
  RecordProperty("colliding_block", std::to_string(colliding[1]));
}

}  // namespace
}  // namespace accessvdb::internal

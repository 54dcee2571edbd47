// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The search of a wide set against trying every direction, by plain loops.
#include "hostdev/wide_search.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <optional>
#include <tuple>
#include <vector>

#include "unit/hostdev/occupancy_fixture.h"

namespace accessvdb::test {
namespace {

const std::vector<double> kWideArm_m = {2.4, 5.0, 9.0};

/// A random map, a tool in many directions, and a point.
struct WideScene {
  OccupancyFixture map;
  int directions;
  ApproachFixture approach;
  ToolFixture tool;
  std::vector<std::uint64_t> seen;
  float position[3] = {0, 0, 0}, normal[3] = {0, 0, 0};
  int limit = 1;

  WideScene(std::mt19937_64& random, int count) : directions(count), approach(count, kWideArm_m) {
    approach.scatter(random, kWideArm_m);
    constexpr int kObstacles[4] = {20, 1000, 9000, 30000}, kHoles[3] = {0, 300, 6000};  // from open to closed
    for (int n = kObstacles[below(random, 4)]; n > 0; --n) {
      map.collide({below(random, 40) - 20, below(random, 40) - 20, below(random, 24) - 12});
    }
    const auto near = [&] { return Voxel{below(random, 29) - 14, below(random, 29) - 14, below(random, 29) - 14}; };
    if (below(random, 3) == 0) {  // hardly a corridor
      for (int n = 1500; n > 0; --n) map.freeArm(near());
    } else {
      map.freeArm({-14, -14, -14}, {14, 14, 14});
      for (int n = kHoles[below(random, 3)]; n > 0; --n) map.blockArm(near());
    }
    for (int d = 0; d < directions; ++d) {
      for (int c = 1 + below(random, 6); c > 0; --c) {
        tool.columns.push_back(column(below(random, 30) - 15, below(random, 30) - 15, below(random, 20) - 10,
                                      random() >> below(random, 64) | 1));
      }
      tool.endDirection();
    }
    limit = 1 + below(random, 3);
  }
  void aim(std::mt19937_64& random) {
    seen.assign(static_cast<std::size_t>(directions + 63) / 64, 0);
    const int kind = below(random, 10);
    for (std::uint64_t& word : seen) word = kind == 0 ? 0 : kind < 4 ? random() & random() & random() : random();
    for (float& x : position) x = static_cast<float>(between(random, -2, 2));
    const double yaw = between(random, 0, 6.3), lean = between(random, -1.5, 1.5);
    normal[0] = static_cast<float>(std::cos(yaw) * std::cos(lean));
    normal[1] = static_cast<float>(std::sin(yaw) * std::cos(lean));
    normal[2] = static_cast<float>(std::sin(lean));
    if (below(random, 8) == 0) normal[0] = 0, normal[1] = 0, normal[2] = 1;  // where many cosines are alike
  }
  [[nodiscard]] bool isSeen(int d) const { return (seen[static_cast<std::size_t>(d / 64)] >> (d % 64) & 1) != 0; }
  kernels::ScoreResult search(const kernels::ScoreItem& item) {
    const kernels::OccupancyReader reader = map.reader();
    const kernels::ToolKernelView view = tool.view(limit);
    const kernels::MapTests tests = {reader, view, approach.view, position, map.inverseVoxelSize()};
    return kernels::searchWide(tests, approach.view, limit, normal, seen.data(), item);
  }
};

struct WideTried {
  int stage = 0, passed = 0, count = 0, d = 0;  ///< stage 0 unseen, 1 arm, 2 tool
  float dot = 0;
  PointReason reason = PointReason::Unseen;
  [[nodiscard]] auto rank() const { return std::make_tuple(-stage, -passed, count, -dot, d); }
};

std::vector<WideTried> tryAll(const WideScene& scene) {
  std::vector<WideTried> tried;
  for (int d = 0; d < scene.directions; ++d) {
    const float* axis = scene.approach.axes.data() + 3 * static_cast<std::ptrdiff_t>(d);
    WideTried t;
    t.d = d;
    const float x_part = axis[0] * scene.normal[0], y_part = axis[1] * scene.normal[1],
                z_part = axis[2] * scene.normal[2];
    t.dot = (x_part + y_part) + z_part;
    if (!(t.dot >= scene.approach.view.normal_cos_min)) continue;
    if (scene.isSeen(d)) {
      t.stage = 2;
      for (std::size_t n = 0; n < kWideArm_m.size() && t.stage == 2; ++n) {
        Voxel voxel;
        for (std::size_t a = 0; a < 3; ++a) {
          const float offset = scene.approach.offsets[static_cast<std::size_t>(d) * 9 + 3 * n + a];
          voxel[a] = static_cast<std::int32_t>(std::floor(scene.position[a] + offset + 0.5f));
        }
        if (scene.map.armFree(voxel)) {
          ++t.passed;
        } else {
          t.stage = 1;
          t.reason = scene.map.collides(voxel) ? PointReason::Arm : PointReason::Unknown;
        }
      }
    }
    if (t.stage == 2) {
      for (const Voxel& offset : scene.tool.voxels(d)) {
        Voxel voxel;
        for (std::size_t a = 0; a < 3; ++a) {
          voxel[a] = static_cast<std::int32_t>(std::floor(scene.position[a] + 0.5f)) + offset[a];
        }
        t.count += scene.map.collides(voxel) ? 1 : 0;
      }
      t.reason = t.count < scene.limit ? PointReason::None : PointReason::Tool;
    }
    tried.push_back(t);
  }
  return tried;
}

/// The first of all directions, or none if the cone is empty.
std::optional<WideTried> bestOf(const std::vector<WideTried>& tried) {
  if (tried.empty()) return std::nullopt;
  return *std::min_element(tried.begin(), tried.end(),
                           [](const WideTried& a, const WideTried& b) { return a.rank() < b.rank(); });
}

void expectIs(const kernels::ScoreResult& result, const std::optional<WideTried>& best) {
  ASSERT_EQ(result.scored, 1);
  ASSERT_STREQ(name(result.reason), name(best ? best->reason : PointReason::Normal));
  ASSERT_EQ(result.direction, best && best->stage > 0 ? best->d : kNoDirection);
  ASSERT_EQ(result.score, best && best->stage == 2 ? best->count : kNoScore);
}

TEST(SearchWide, IsTheFirstOfAllDirections) {
  std::mt19937_64 random(31);
  std::array<int, kNumPointReasons> reasons = {};
  int beyond_a_mask = 0, beyond_a_byte_of_words = 0;
  for (const int directions : {257, 300, 512, 1000, 2906, kernels::kMostWideDirections}) {
    for (int scene_number = 0; scene_number < 12; ++scene_number) {
      WideScene scene(random, directions);
      for (int n = 0; n < 8; ++n) {
        scene.aim(random);
        const std::optional<WideTried> best = bestOf(tryAll(scene));
        expectIs(scene.search({}), best);
        if (HasFatalFailure()) return;
        ++reasons[static_cast<std::size_t>(best ? best->reason : PointReason::Normal)];
        if (!best || best->stage == 0) continue;
        beyond_a_mask += best->d >= kernels::kMostMaskedDirections ? 1 : 0;
        beyond_a_byte_of_words += best->d >= 2048 ? 1 : 0;
      }
    }
  }
  for (const PointReason reason :
       {PointReason::None, PointReason::Unseen, PointReason::Unknown, PointReason::Arm, PointReason::Tool}) {
    EXPECT_GT(reasons[static_cast<std::size_t>(reason)], 10) << name(reason);
  }
  EXPECT_GT(beyond_a_mask, 100);
  EXPECT_GT(beyond_a_byte_of_words, 20);
}

/// The whole order, with directions all over the sphere, so close together that most share a bin, and with one cosine.
TEST(WideWalk, TakesSeenDirectionsByAngle) {
  std::mt19937_64 random(41);
  int large = 0, none_seen = 0, none_at_all = 0;
  for (int round = 0; round < 300; ++round) {
    const int directions = 257 + below(random, kernels::kMostWideDirections - 256);
    const int kind = below(random, 3);
    std::vector<float> axes;
    for (int d = 0; d < directions; ++d) {
      const double spread = kind == 0 ? 1 : 0.002;
      Eigen::Vector3d axis(between(random, -spread, spread), between(random, -spread, spread),
                           kind == 0   ? between(random, -1, 1)
                           : kind == 1 ? 1.0
                                       : 0.0);
      if (kind == 2) axis.head<2>() += Eigen::Vector2d(1, 0);  // level
      axis.normalize();
      for (int n = 0; n < 3; ++n) axes.push_back(static_cast<float>(axis[n]));
    }
    kernels::ApproachView approach;
    approach.num_directions = directions;
    approach.axes_xyz = axes.data();
    approach.normal_cos_min =
        static_cast<float>(std::array{0.0, 0.3, 0.9, 0.99999}[static_cast<std::size_t>(below(random, 4))]);
    const float up[3] = {0, 0, 1}, along[3] = {0.6f, 0, 0.8f};
    const float* normal = below(random, 2) == 0 ? up : along;
    std::vector<std::uint64_t> seen(static_cast<std::size_t>(directions + 63) / 64);
    const int share = below(random, 4);
    for (std::uint64_t& word : seen) word = share == 0 ? 0 : share == 1 ? random() & random() & random() : random();
    std::vector<int> in_cone, expected;
    for (int d = 0; d < directions; ++d) {
      if (!(kernels::cosToNormal(approach, d, normal) >= approach.normal_cos_min)) continue;
      in_cone.push_back(d);
      if ((seen[static_cast<std::size_t>(d / 64)] >> (d % 64) & 1) != 0) expected.push_back(d);
    }
    std::ranges::sort(expected, [&](int d, int e) { return kernels::ranksBefore(approach, normal, d, e); });
    kernels::WideWalk walk(approach, normal, seen.data());
    if (expected.empty()) {
      const int d = walk.next();
      ASSERT_EQ(d >= 0, !in_cone.empty());
      if (d >= 0) {
        ASSERT_TRUE(std::ranges::find(in_cone, d) != in_cone.end());
      }
      ++(d >= 0 ? none_seen : none_at_all);
    }
    for (const int d : expected) ASSERT_EQ(walk.next(), d);
    ASSERT_EQ(walk.next(), -1);
    large += kind != 0 && expected.size() > 1000 ? 1 : 0;
  }
  EXPECT_GT(large, 20);
  EXPECT_GT(none_seen, 20);
  EXPECT_GT(none_at_all, 5);
}

/// The only direction by itself; and a best one that may have become worse, whose count is confirmed or replaced.
TEST(SearchWide, ConfirmsOrReplacesADirection) {
  std::mt19937_64 random(37);
  int confirmed = 0, replaced = 0, alone = 0;
  for (int scene_number = 0; scene_number < 60; ++scene_number) {
    WideScene scene(random, 300 + below(random, 500));
    for (int n = 0; n < 20; ++n) {
      scene.aim(random);
      const std::vector<WideTried> tried = tryAll(scene);
      if (tried.empty()) continue;
      const std::optional<WideTried> best = bestOf(tried);
      kernels::ScoreItem item;
      const WideTried& some = tried[static_cast<std::size_t>(below(random, static_cast<int>(tried.size())))];
      item.only_direction = some.d;
      expectIs(scene.search(item), some);
      ++alone;
      item.or_all = 1;
      if (best->reason == PointReason::None && below(random, 2) == 0) {
        item.only_direction = best->d;
        item.known_score = static_cast<std::uint16_t>(best->count);
        const kernels::ScoreResult result = scene.search(item);
        expectIs(result, best);
        EXPECT_EQ(result.tests, 1);
        ++confirmed;
      } else if (some.reason != PointReason::None || some.count > 0) {
        item.known_score = static_cast<std::uint16_t>(some.reason != PointReason::None ? 3 : some.count - 1);
        expectIs(scene.search(item), best);
        ++replaced;
      }
      if (HasFatalFailure()) return;
    }
  }
  EXPECT_GT(confirmed, 50);
  EXPECT_GT(replaced, 200);
  EXPECT_GT(alone, 500);
}

}  // namespace
}  // namespace accessvdb::test

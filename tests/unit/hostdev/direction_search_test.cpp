// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The search against trying everything, and what it may skip if something is already known.
#include "hostdev/direction_search.h"

#include <gtest/gtest.h>

#include <tuple>

#include <algorithm>
#include <optional>

#include "unit/hostdev/occupancy_fixture.h"

namespace accessvdb::test {
namespace {

constexpr int kDirections = 36;

kernels::DirectionMask all() {
  kernels::DirectionMask mask = {};
  for (int d = 0; d < kDirections; ++d) mask.set(d);
  return mask;
}

/// A random place: map, tool, point.
struct Scene {
  OccupancyFixture map;
  ApproachFixture approach{kDirections, {2.4, 5.0, 9.0}};
  ToolFixture tool;
  std::uint64_t seen[1] = {0};
  float position[3] = {0, 0, 0}, normal[3] = {0, 0, 0};
  int limit = 1;

  /// @param scattered  directions of any kind instead of yaws
  explicit Scene(std::mt19937_64& random, bool scattered = false) {
    if (scattered) approach.scatter(random, {2.4, 5.0, 9.0});
    constexpr int kObstacles[4] = {0, 400, 3000, 9000}, kHoles[4] = {0, 300, 3000, 9000};  // from open to closed
    for (int n = kObstacles[below(random, 4)]; n > 0; --n) {
      map.collide({below(random, 40) - 20, below(random, 40) - 20, below(random, 24) - 12});
    }
    const int height = scattered ? 14 : 2;
    map.freeArm({-14, -14, -height}, {14, 14, height});
    for (int n = kHoles[below(random, 4)]; n > 0; --n)
      map.blockArm({below(random, 29) - 14, below(random, 29) - 14, below(random, 2 * height + 1) - height});
    for (int d = 0; d < kDirections; ++d) {
      const int columns = 1 + below(random, 20);
      for (int c = 0; c < columns; ++c) {
        tool.columns.push_back(column(below(random, 30) - 15, below(random, 30) - 15, below(random, 20) - 10,
                                      random() >> below(random, 64)));
      }
      tool.endDirection();
    }
    aim(random);
    limit = 1 + below(random, 12);
  }
  /// Chooses the point.
  void aim(std::mt19937_64& random) {
    seen[0] = below(random, 2) == 0 ? random() | random() : random() & random() & random();
    if (below(random, 10) == 0) seen[0] = 0;
    for (float& x : position) x = static_cast<float>(between(random, -2, 2));
    const double yaw = between(random, 0, 6.3), lean = between(random, -1.4, 1.4);
    normal[0] = static_cast<float>(std::cos(yaw) * std::cos(lean));
    normal[1] = static_cast<float>(std::sin(yaw) * std::cos(lean));
    normal[2] = static_cast<float>(std::sin(lean));
  }
  kernels::ScoreResult search(const kernels::ScoreItem& item) {
    return kernels::searchDirections(map.reader(), map.inverseVoxelSize(), tool.view(limit), approach.view, position,
                                     normal, seen, item);
  }
  kernels::ScoreResult search() {
    kernels::ScoreItem item;
    item.candidates = all();
    return search(item);
  }
};

/// The result of one direction, by plain loops.
struct Tried {
  int stage = 0, passed = 0, count = 0, d = 0;  ///< stage 0 unseen, 1 arm, 2 tool
  float dot = 0;
  PointReason reason = PointReason::Unseen;
  [[nodiscard]] auto rank() const { return std::make_tuple(-stage, -passed, count, -dot, d); }
};

float dotOf(const Scene& scene, std::size_t d) {
  const std::vector<float>&axes = scene.approach.axes, &xy = scene.approach.xy;
  const float x_part = (axes.empty() ? xy[2 * d] : axes[3 * d]) * scene.normal[0];
  const float y_part = (axes.empty() ? xy[2 * d + 1] : axes[3 * d + 1]) * scene.normal[1];
  const float z_part = axes.empty() ? 0.0f : axes[3 * d + 2] * scene.normal[2];
  const float sum = x_part + y_part;
  return sum + z_part;
}

std::vector<Tried> tryAll(const Scene& scene) {
  std::vector<Tried> tried;
  for (int d = 0; d < kDirections; ++d) {
    Tried t;
    t.d = d;
    t.dot = dotOf(scene, static_cast<std::size_t>(d));
    if (!(t.dot >= scene.approach.view.normal_cos_min)) continue;
    if ((scene.seen[0] >> d & 1) != 0) {
      t.stage = 2;
      for (std::size_t n = 0; n < 3 && t.stage == 2; ++n) {
        Voxel voxel;
        for (std::size_t a = 0; a < 3; ++a) {
          const float x = scene.position[a] + scene.approach.offsets[static_cast<std::size_t>(d) * 9 + 3 * n + a];
          voxel[a] = static_cast<std::int32_t>(std::floor(x + 0.5f));
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
      Voxel at;
      for (std::size_t a = 0; a < 3; ++a) at[a] = static_cast<std::int32_t>(std::floor(scene.position[a] + 0.5f));
      for (const Voxel& offset : scene.tool.voxels(d)) {
        t.count += scene.map.collides({at[0] + offset[0], at[1] + offset[1], at[2] + offset[2]}) ? 1 : 0;
      }
      t.reason = t.count < scene.limit ? PointReason::None : PointReason::Tool;
    }
    tried.push_back(t);
  }
  return tried;
}

/// @param points  of each scene  @param least  of each reason
void expectEqualsTryingEverything(bool scattered, int scenes, int points, int least) {
  std::mt19937_64 random(11);
  std::optional<Scene> made;
  std::array<int, kNumPointReasons> reasons = {};
  for (int n = 0; n < scenes * points; ++n) {
    if (n % points == 0) made.emplace(random, scattered);
    Scene& scene = *made;
    if (n % points != 0) scene.aim(random);
    const kernels::ScoreResult result = scene.search();
    const std::vector<Tried> tried = tryAll(scene);
    ASSERT_EQ(result.scored, 1);
    ++reasons[static_cast<std::size_t>(result.reason)];
    if (tried.empty()) {
      ASSERT_EQ(result.reason, PointReason::Normal);
      ASSERT_EQ(result.direction, kNoDirection);
      continue;
    }
    const Tried best = *std::min_element(tried.begin(), tried.end(),
                                         [](const Tried& a, const Tried& b) { return a.rank() < b.rank(); });
    ASSERT_EQ(name(result.reason), name(best.reason));
    ASSERT_EQ(result.direction, best.stage == 0 ? kNoDirection : best.d);
    ASSERT_EQ(result.score, best.stage == 2 ? best.count : kNoScore);
    // Directions reported blocked are blocked; a point without access has tried all of them.
    std::size_t blocked = 0, admissible = 0;
    for (const Tried& t : tried) {
      const bool of_arm = result.arm_blocked.test(t.d), of_tool = result.tool_blocked.test(t.d);
      blocked += of_arm || of_tool ? 1 : 0;
      admissible += t.stage > 0 ? 1 : 0;
      if (of_arm) {
        ASSERT_EQ(t.stage, 1) << t.d;
      }
      if (of_tool) {
        ASSERT_EQ(t.reason, PointReason::Tool) << t.d;
      }
    }
    if (result.reason != PointReason::None) {
      ASSERT_EQ(blocked, admissible);
      ASSERT_EQ(result.tests, admissible);
    }
  }
  for (const PointReason reason : {PointReason::None, PointReason::Normal, PointReason::Unseen, PointReason::Unknown,
                                   PointReason::Arm, PointReason::Tool}) {
    EXPECT_GT(reasons[static_cast<std::size_t>(reason)], least) << name(reason);
  }
}

TEST(SearchDirections, EqualsTryingEverything) { expectEqualsTryingEverything(false, 600, 1, 10); }
/// The normal cone of 70 degrees holds a third of the sphere: it is never empty.
TEST(SearchDirections, OfAnyKindEqualsTryingEverything) { expectEqualsTryingEverything(true, 500, 20, -1); }

/// Skipping directions that are truly blocked does not change the outcome of an accessible point, nor does knowing
/// the count of one direction.
TEST(SearchDirections, KnownDirectionsNeedNoTest) {
  std::mt19937_64 random(13);
  int accessible = 0, blocked = 0, fewer_tests = 0;
  for (int n = 0; n < 600; ++n) {
    Scene scene(random);
    const kernels::ScoreResult full = scene.search();
    kernels::ScoreItem item;
    item.candidates = all();
    std::vector<Tried> tool_stage;
    for (const Tried& t : tryAll(scene)) {
      if (t.stage > 0 && t.reason != PointReason::None && below(random, 3) != 0) item.skip.set(t.d);
      if (t.stage == 2 && t.reason == PointReason::None) tool_stage.push_back(t);
    }
    if (!tool_stage.empty() && below(random, 2) == 0) {
      const Tried& known = tool_stage[static_cast<std::size_t>(below(random, static_cast<int>(tool_stage.size())))];
      item.known_direction = static_cast<std::uint16_t>(known.d);
      item.known_score = static_cast<std::uint16_t>(known.count);
    }
    const kernels::ScoreResult partial = scene.search(item);
    ASSERT_EQ(partial.reason == PointReason::None, full.reason == PointReason::None);
    ASSERT_LE(partial.tests, full.tests);
    fewer_tests += partial.tests < full.tests ? 1 : 0;
    if (full.reason == PointReason::None) {
      ASSERT_EQ(partial.score, full.score);
      ASSERT_EQ(partial.direction, full.direction);
      ++accessible;
    } else if (full.reason == PointReason::Normal || full.reason == PointReason::Unseen) {
      ASSERT_EQ(partial.reason, full.reason);
    } else {
      bool any_skipped = false;
      for (int d = 0; d < kDirections; ++d) {
        if (!item.skip.test(d)) continue;
        any_skipped = any_skipped || full.arm_blocked.test(d) || full.tool_blocked.test(d);
        ASSERT_FALSE(partial.arm_blocked.test(d) || partial.tool_blocked.test(d))
            << "not tested, so nothing new was found";
      }
      ASSERT_EQ(partial.skipped != 0, any_skipped);
      ++blocked;
    }
  }
  EXPECT_GT(accessible, 150);  // worlds differ by compiler
  EXPECT_GT(blocked, 150);
  EXPECT_GT(fewer_tests, 150);
}

TEST(SearchDirections, CandidatesLimitWhatIsTried) {
  std::mt19937_64 random(17);
  for (int n = 0; n < 300; ++n) {
    Scene scene(random);
    kernels::ScoreItem item;
    item.candidates.word[0] = random() & random() & all().word[0];
    const kernels::ScoreResult limited = scene.search(item);
    scene.seen[0] &= item.candidates.word[0];
    const kernels::ScoreResult same = scene.search();
    ASSERT_EQ(limited.reason, same.reason);
    ASSERT_EQ(limited.direction, same.direction);
    ASSERT_EQ(limited.score, same.score);
  }
}

TEST(SearchDirections, NoNormalIsNotScored) {
  std::mt19937_64 random(19);
  Scene scene(random);
  for (float& x : scene.normal) x = 0;
  const kernels::ScoreResult result = scene.search();
  EXPECT_EQ(result.scored, 0);
  EXPECT_EQ(result.reason, PointReason::Normal);
  EXPECT_EQ(result.tests, 0);
}

/// More collisions than a score can hold: still the tool's fault, with the largest score.
TEST(SearchDirections, HugeCountsAreClamped) {
  OccupancyFixture map;
  const ApproachFixture approach(4, {2.0});
  map.freeArm({2, 0, 0});
  for (int x = 10; x < 42; ++x)
    for (int y = 0; y < 32; ++y)
      for (int z = 0; z < 64; ++z) map.collide({x, y, z});
  ToolFixture tool;
  for (int x = 10; x < 42; ++x)
    for (int y = 0; y < 32; ++y) tool.columns.push_back(column(x, y, 0, ~std::uint64_t{0}));
  for (int d = 0; d < 4; ++d) tool.endDirection();
  tool.begin = {0, 1024, 1024, 1024, 1024};
  const float position[3] = {0, 0, 0}, normal[3] = {1, 0, 0};
  const std::uint64_t seen[1] = {1};
  kernels::ScoreItem item;
  item.candidates = all();
  const auto result =
      kernels::searchDirections(map.reader(), 1.0f, tool.view(100), approach.view, position, normal, seen, item);
  EXPECT_STREQ(name(result.reason), "tool");
  EXPECT_EQ(result.score, kNoScore - 1);
  EXPECT_EQ(result.direction, 0);
}

}  // namespace
}  // namespace accessvdb::test

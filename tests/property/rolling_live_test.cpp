// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A live session over tiles against one over a single field: the same scans, the same losses, the same labels, and
/// whoever only hears what changed knows those around the sensor.
#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <map>
#include <random>
#include <tuple>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/live_session.h"
#include "rolling_walks.h"

namespace accessvdb::test {
namespace {

constexpr std::int64_t kFirst_ns = 1'700'000'000'000'000'000, kStep_ns = 100'000'000;

std::int64_t stampOf(std::size_t n) { return kFirst_ns + static_cast<std::int64_t>(n) * kStep_ns; }

void addPose(LiveSession& session, const Step& step, std::size_t n) {
  session.addPose({stampOf(n), step.sensors_W.front(), Eigen::Quaterniond::Identity(), "odom"});
}
void addScan(LiveSession& session, const Step& step, std::size_t n) {
  LiveScan scan;
  scan.stamp_ns = stampOf(n);
  scan.points_double = step.points_W;
  scan.frame = "odom";
  session.addScan(std::move(scan));
}
void add(LiveSession& session, const Step& step, std::size_t n) {
  addPose(session, step, n);
  addScan(session, step, n);
}

LiveOptions rollingIn(const std::filesystem::path& folder, std::uint64_t limit_bytes) {
  LiveOptions options;
  options.rolling = RollingOptions{.folder = folder, .tile_voxels = kTile_voxels};
  options.memory_limit_bytes = limit_bytes;
  return options;
}

/// All that a listener has to know.
using Told = std::tuple<PointLabel, PointReason, std::uint16_t, std::uint32_t>;
Told toldOf(const SurfacePoint& point) { return {point.label, point.reason, point.direction, point.tools}; }

class RollingLive : public ::testing::TestWithParam<Case> {};

TEST_P(RollingLive, EqualsASessionWithoutALimit) {
  const Case& test = GetParam();
  const std::vector<Step> steps = walk(test);
  const ScratchFolder scratch;
  LiveSession unlimited(toolsOf(test), paramsOf(test));
  LiveOptions options = rollingIn(
      scratch / "tiles", static_cast<std::uint64_t>(test.memory_share * static_cast<double>(bytesOfAll(test, steps))));
  options.update_every = static_cast<std::size_t>(test.update_every);
  LiveSession rolling(toolsOf(test), paramsOf(test), options);
  std::map<std::uint32_t, Told> heard;
  std::size_t returned = 0;  // points that were told again although nobody had seen them since
  for (std::size_t n = 0; n < steps.size(); ++n) {
    add(unlimited, steps[n], n);
    add(rolling, steps[n], n);
    const auto expected = unlimited.step(), step = rolling.step();
    ASSERT_EQ(expected.has_value(), step.has_value()) << n;
    ASSERT_TRUE(step);
    EXPECT_EQ(step->fused.surface_points, expected->fused.surface_points);
    std::uint32_t last = 0;
    for (const SurfacePoint& point : step->changed) {
      EXPECT_TRUE(last == 0 || point.id > last);
      last = point.id;
      const auto [there, is_new] = heard.try_emplace(point.id, toldOf(point));
      returned += !is_new && there->second == toldOf(point) ? 1 : 0;
      there->second = toldOf(point);
    }
    if (step->scored.update_ms == 0 && step->changed.empty()) continue;  // between updates
    ASSERT_EQ(differences(unlimited.field().snapshot(), rolling.rolling()->snapshot()), 0U) << "step " << n;
    for (const SurfacePoint& point : rolling.rolling()->snapshotInMemory().points)
      ASSERT_EQ(heard.at(point.id), toldOf(point)) << "step " << n << ", point " << point.id;
  }
  EXPECT_EQ(returned, 0U) << "what is as it was told is not told again";
  const LiveStatus status = rolling.status();
  ASSERT_TRUE(status.rolling);
  EXPECT_GT(status.rolling->loaded, 0U);
  EXPECT_TRUE(test.change == ChangeMode::Full || status.rolling->tiles_in_memory < status.rolling->tiles);
  EXPECT_FALSE(status.rolling->memory_short);
  EXPECT_EQ(status.surface_points, status.rolling->points);
  EXPECT_LE(status.memory_bytes, options.memory_limit_bytes);
  EXPECT_EQ(status.left_out_returns, 0U);
  expectVaried(rolling.rolling()->snapshot());
}

INSTANTIATE_TEST_SUITE_P(
    Walks, RollingLive,
    ::testing::Values(Case{.name = "off", .seed = 21}, Case{.name = "block", .seed = 22, .change = ChangeMode::Block},
                      Case{.name = "every_third", .seed = 23, .change = ChangeMode::Block, .update_every = 3},
                      Case{.name = "two_tools", .seed = 24, .tools = 2},
                      Case{.name = "full", .seed = 25, .change = ChangeMode::Full},
                      Case{.name = "full_forgets", .seed = 26, .change = ChangeMode::Full, .free_for_s = 1}),
    [](const auto& tested) { return tested.param.name; });

/// What there was no time for closes places on the disk, in memory, and ones that nobody has seen yet.
TEST(RollingLiveLosses, CloseEveryTileThatTheyMayLieIn) {
  const Case test = {.name = "lost", .seed = 31, .change = ChangeMode::Block};
  const std::vector<Step> steps = walk(test);
  const ScratchFolder scratch;
  const auto losing = [](LiveOptions options) {
    options.most_waiting_returns = 2 * 1500;
    return options;
  };
  LiveSession unlimited(toolsOf(test), paramsOf(test), losing({}));
  LiveSession rolling(toolsOf(test), paramsOf(test),
                      losing(rollingIn(scratch / "tiles", bytesOfAll(test, steps) * 7 / 10)));
  for (std::size_t n = 0; n < steps.size(); ++n) {
    for (LiveSession* session : {&unlimited, &rolling}) {
      add(*session, steps[n], n);
      const bool sleeps = n % 9 > 4;  // three of these scans are lost
      while (!sleeps && session->step()) {
      }
    }
    if (n % 9 > 4) continue;
    ASSERT_EQ(differences(unlimited.field().snapshot(), rolling.rolling()->snapshot()), 0U) << "step " << n;
  }
  const std::uint64_t lost = unlimited.status().dropped[static_cast<std::size_t>(ScanDrop::QueueFull)];
  EXPECT_GT(lost, 5U);
  EXPECT_EQ(rolling.status().dropped[static_cast<std::size_t>(ScanDrop::QueueFull)], lost);
  EXPECT_GT(rolling.status().rolling->loaded, 0U);
  const FieldSnapshot all = rolling.rolling()->snapshot();
  EXPECT_GT(all.count(PointLabel::Accessible), 50U);
  AccessibilityField whole(toolsOf(test), paramsOf(test));
  for (std::size_t n = 0; n < steps.size(); ++n) integrate(whole, steps[n], 0.1 * static_cast<double>(n));
  whole.update();
  EXPECT_LT(all.count(PointLabel::Accessible), whole.snapshot().count(PointLabel::Accessible));
}

TEST(RollingLosses, AreThoseOfOneFieldWhereverTilesAre) {
  std::mt19937_64 random(5);
  for (const double radius_m : {0.3, 1.2, 1e6}) {
    SCOPED_TRACE(radius_m);
    const Case test = {.name = "balls", .seed = 32, .change = ChangeMode::Block};
    const std::vector<Step> steps = walk(test);
    const ScratchFolder scratch;
    const RollingOptions options = tightOptions(test, steps, 0.7, scratch / "tiles");
    AccessibilityField unlimited(toolsOf(test), paramsOf(test));
    auto rolling = std::make_unique<RollingField>(toolsOf(test), paramsOf(test), options);
    for (std::size_t n = 0; n < steps.size(); ++n) {
      // Before the first scan, too, when there is no origin yet.
      const bool loses = radius_m < 1e5 ? n % 7 == 0 : n == 25;
      const std::vector<Eigen::Vector3d> centres_W = {
          {uniform(random, -22, 22), uniform(random, -3, 3), uniform(random, -1, 1)},
          {uniform(random, -22, 22), uniform(random, -3, 3), uniform(random, -1, 1)}};
      if (loses) {
        unlimited.leaveOut(centres_W, radius_m);
        rolling->leaveOut(centres_W, radius_m);
      }
      integrate(unlimited, steps[n], 0.1 * static_cast<double>(n));
      integrate(*rolling, steps[n], 0.1 * static_cast<double>(n));
      unlimited.update();
      rolling->update();
      ASSERT_EQ(differences(unlimited.snapshot(), rolling->snapshot()), 0U) << "step " << n;
      if (n % 13 != 12) continue;
      rolling->checkpoint();
      rolling.reset();
      rolling = std::make_unique<RollingField>(RollingField::resume(toolsOf(test), paramsOf(test), options));
    }
    const FieldSnapshot all = rolling->snapshot();
    EXPECT_EQ(all.count(PointLabel::Accessible) == 0, radius_m > 1e5);
    EXPECT_GT(all.count(PointLabel::Unscored), 0U);
  }
}

TEST(RollingLiveRun, GoesOnAfterItsLastCheckpoint) {
  const Case test = {.name = "resumed", .seed = 33, .change = ChangeMode::Block};
  const std::vector<Step> steps = walk(test);
  const ScratchFolder scratch;
  LiveOptions options = rollingIn(scratch / "tiles", bytesOfAll(test, steps) * 7 / 10);
  LiveSession unlimited(toolsOf(test), paramsOf(test));
  auto rolling = std::make_unique<LiveSession>(toolsOf(test), paramsOf(test), options);
  for (std::size_t n = 0; n < steps.size(); ++n) {
    if (n == 25) {
      rolling->rolling()->checkpoint("after 25");
      rolling.reset();
      options.resume = true;
      rolling = std::make_unique<LiveSession>(toolsOf(test), paramsOf(test), options);
      EXPECT_EQ(rolling->rolling()->note(), "after 25");
      EXPECT_EQ(rolling->status().surface_points, unlimited.status().surface_points);
    }
    for (LiveSession* session : {&unlimited, rolling.get()}) {
      add(*session, steps[n], n);
      ASSERT_TRUE(session->step());
    }
  }
  EXPECT_EQ(differences(unlimited.field().snapshot(), rolling->rolling()->snapshot()), 0U);
  EXPECT_EQ(rolling->origin_W(), unlimited.field().origin_W());
}

/// While tiles cannot be written, scans are dropped and block; later the flight goes on.
TEST(RollingLiveRun, OutlivesADiskThatFails) {
  const Case test = {.name = "disk", .seed = 34, .change = ChangeMode::Block};
  const std::vector<Step> steps = walk(test);
  const ScratchFolder scratch;
  LiveSession rolling(toolsOf(test), paramsOf(test), rollingIn(scratch / "tiles", bytesOfAll(test, steps) * 6 / 10));
  AccessibilityField unlimited(toolsOf(test), paramsOf(test));
  std::size_t failed = 0, after = 0;
  for (std::size_t n = 0; n < steps.size(); ++n) {
    if (n == 12) std::filesystem::rename(scratch / "tiles", scratch / "away");
    if (n == 30) std::filesystem::rename(scratch / "away", scratch / "tiles");
    integrate(unlimited, steps[n], 0.1 * static_cast<double>(n));
    unlimited.update();
    add(rolling, steps[n], n);
    try {
      ASSERT_TRUE(rolling.step()) << n;
      if (n >= 30) ++after;
    } catch (const OutputError&) {
      ++failed;
      ASSERT_TRUE(n >= 12 && n < 30) << n;
    }
    if (n % 5 != 4) continue;
    for (const SurfacePoint& point : rolling.rolling()->snapshotInMemory().accessible()) {
      const auto other = unlimited.pointAt(point.position_W);
      ASSERT_TRUE(other.has_value());
      ASSERT_EQ(other->label, PointLabel::Accessible) << "step " << n;
    }
  }
  EXPECT_GT(failed, 0U);
  EXPECT_EQ(after, steps.size() - 30);
  EXPECT_EQ(rolling.status().dropped[static_cast<std::size_t>(ScanDrop::Failed)], failed);
  EXPECT_EQ(rolling.status().taken, steps.size() - failed);
  // Only what the lost scans saw is closed.
  const std::size_t open = rolling.rolling()->snapshot().count(PointLabel::Accessible);
  EXPECT_GT(2 * open, unlimited.snapshot().count(PointLabel::Accessible) / 4);
  EXPECT_LT(open, unlimited.snapshot().count(PointLabel::Accessible));
}

TEST(RollingLiveRun, RefusesWhatOnlyOneFieldCan) {
  const Case test = {.name = "refused"};
  const ScratchFolder scratch;
  LiveSession rolling(toolsOf(test), paramsOf(test), rollingIn(scratch / "tiles", 0));
  const Step step = walk(test, 2).front();
  add(rolling, step, 0);
  ASSERT_TRUE(rolling.step());
  const auto idOf = [](const auto& call) {
    try {
      call();
    } catch (const InvalidArgument& error) {
      return error.id();
    }
    return std::string("done");
  };
  EXPECT_EQ(idOf([&] { rolling.reset(); }), "live.rolling");
  EXPECT_EQ(idOf([&] { static_cast<void>(rolling.field()); }), "live.rolling");
  EXPECT_EQ(idOf([&] { static_cast<void>(rolling.removeRegion(Region::box({0, 0, 0}, {1, 1, 1}))); }), "live.rolling");
  add(rolling, step, 1);
  EXPECT_TRUE(rolling.step()) << "nothing has changed";
  LiveSession one(toolsOf(test), paramsOf(test));
  EXPECT_EQ(one.rolling(), nullptr);
  EXPECT_FALSE(one.status().rolling);
  RollingField silent(toolsOf(test), paramsOf(test), {.folder = scratch / "silent"});
  EXPECT_EQ(idOf([&] { static_cast<void>(silent.takeChanged()); }), "rolling.changes");
}

}  // namespace
}  // namespace accessvdb::test

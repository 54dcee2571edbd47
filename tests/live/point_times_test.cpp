// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Live scans whose points have times, against a motion in closed form; and times that cannot be theirs.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "accessvdb/tsdf_volume.h"
#include "live/live_stream.h"
#include "unit/io/moving_scanner.h"

namespace accessvdb::live_test {
namespace {

using io::test::MovingScanner;

constexpr std::size_t kCount = 2000;
constexpr double kVoxel_m = 0.05;

/// A scanner that flies and turns, 0.1 s for each scan, and its odometry every 5 ms.
struct MovingStream {
  MovingScanner scanner = {.stamp_s = 1'000};

  static std::int64_t stampOf(std::size_t n) { return 1'000'000'000'000 + static_cast<std::int64_t>(n) * 100'000'000; }
  [[nodiscard]] LivePose poseAt(std::int64_t ms) const {
    const Eigen::Isometry3d T_W_S = scanner.at(scanner.stamp_s + 1e-3 * static_cast<double>(ms));
    return {stampOf(0) + ms * 1'000'000, T_W_S.translation(), Eigen::Quaterniond(T_W_S.linear()), "odom"};
  }
  /// @param unit_s  of its times
  [[nodiscard]] LiveScan scan(std::size_t n, double unit_s = 1e-9) const {
    LiveScan scan;
    scan.stamp_ns = stampOf(n);
    scan.frame = "lidar";
    for (std::size_t i = 0; i < kCount; ++i) {
      scan.points.push_back(scanner.measured(n, i, kCount));
      scan.times.push_back(scanner.timeOf(i, kCount) / unit_s);
    }
    return scan;
  }
  /// The same as points of the world, every one where it was measured.
  [[nodiscard]] LiveScan registered(std::size_t n) const {
    LiveScan scan = this->scan(n);
    scan.frame = "odom";
    for (std::size_t i = 0; i < kCount; ++i) scan.points[i] = scanner.pointOn(i).cast<float>();
    return scan;
  }
};

void sendPoses(LiveSession& session, const MovingStream& stream, std::int64_t from_ms, std::int64_t to_ms) {
  for (std::int64_t ms = from_ms; ms <= to_ms; ms += 5) session.addPose(stream.poseAt(ms));
}
FieldParams farParams() {
  FieldParams params = coarseParams();
  params.tsdf.max_range_m = 30;
  return params;
}

/// Of the distances that both know, the mean difference.
double offDistances_m(const AccessibilityField& a, const AccessibilityField& b) {
  const auto grid = a.volume().distance(), other = b.volume().distance();
  double sum_m = 0;
  std::size_t both = 0;
  for (auto value = grid->cbeginValueOn(); value; ++value) {
    if (!other->tree().isValueOn(value.getCoord())) continue;
    sum_m += std::abs(*value - other->tree().getValue(value.getCoord()));
    ++both;
  }
  EXPECT_GT(both, 10'000U);
  return sum_m / static_cast<double>(both);
}

/// How far the farthest point is from the wall.
double offWall_m(const LiveSession& session, const MovingScanner& scanner) {
  double off_m = 0;
  for (const SurfacePoint& point : session.field().snapshot().points)
    off_m = std::max(off_m, std::abs(point.position_W.x() - scanner.wall_m));
  return off_m;
}

TEST(LiveTimes, PlaceEachReturnByThePoseAtItsOwnTime) {
  const MovingStream stream;
  for (const double unit_s : {1.0, 1e-3, 1e-6, 1e-9}) {
    for (const bool told : {false, true}) {
      SCOPED_TRACE(unit_s);
      LiveSession session(test::armTool(), farParams());
      sendPoses(session, stream, 0, 505);
      for (std::size_t n = 0; n < 5; ++n) {
        LiveScan scan = stream.scan(n, unit_s);
        if (told) scan.time_unit_s = unit_s;
        session.addScan(std::move(scan));
      }
      EXPECT_EQ(stepAll(session), 5U);
      const LiveStatus status = session.status();
      EXPECT_EQ(status.by_times, 5U);
      EXPECT_EQ(status.unposed_returns, 0U);
      EXPECT_NE(status.motion.find("each point is placed by the pose at its own time"), std::string::npos);
      EXPECT_GT(session.field().snapshot().points.size(), 100U);
      // A point is in a voxel that returns lie in.
      EXPECT_LT(offWall_m(session, stream.scanner), kVoxel_m);
    }
  }
  LiveOptions options;
  options.deskew = io::Deskew::Off;
  LiveSession smeared(test::armTool(), farParams(), options);
  sendPoses(smeared, stream, 0, 505);
  for (std::size_t n = 0; n < 5; ++n) smeared.addScan(stream.scan(n));
  EXPECT_EQ(stepAll(smeared), 5U);
  EXPECT_EQ(smeared.status().by_times, 0U);
  EXPECT_GT(offWall_m(smeared, stream.scanner), 4 * kVoxel_m);
}

/// The rays of scans in the world, with the origins that a pose for each of them gives.
TEST(LiveTimes, BeginEachRegisteredRayWhereTheSensorWas) {
  const MovingStream stream;
  LiveSession session(test::armTool(), farParams());
  AccessibilityField expected(test::armTool(), farParams());
  sendPoses(session, stream, 0, 505);
  for (std::size_t n = 0; n < 5; ++n) {
    LiveScan scan = stream.registered(n);
    std::vector<Eigen::Vector3d> points_W, origins_W;
    for (std::size_t i = 0; i < kCount; ++i) {
      points_W.push_back(scan.points[i].cast<double>());
      const double t_s = stream.scanner.stamp_s + 0.1 * static_cast<double>(n) + stream.scanner.timeOf(i, kCount);
      origins_W.emplace_back(stream.scanner.at(t_s).translation());
    }
    session.addScan(std::move(scan));
    ASSERT_TRUE(session.step());
    expected.integrateRays(points_W, origins_W);
    expected.update();
  }
  EXPECT_EQ(session.status().by_times, 5U);
  // Origins differ by rounding, 1e-6 m at most, and so do distances.
  EXPECT_LT(offDistances_m(session.field(), expected), 1e-6);
  // One origin for all, as without times, is another map.
  LiveOptions options;
  options.deskew = io::Deskew::Off;
  LiveSession one(test::armTool(), farParams(), options);
  sendPoses(one, stream, 0, 505);
  for (std::size_t n = 0; n < 5; ++n) {
    one.addScan(stream.registered(n));
    ASSERT_TRUE(one.step());
  }
  EXPECT_EQ(one.status().by_times, 0U);
  EXPECT_GT(offDistances_m(one.field(), expected), 1e-4);
}

TEST(LiveTimes, WaitForPosesAroundAllOfAScan) {
  const MovingStream stream;
  LiveSession session(test::armTool(), farParams());
  session.addScan(stream.scan(0));
  sendPoses(session, stream, 0, 95);
  EXPECT_FALSE(session.waitForWork(std::chrono::milliseconds(0)));
  EXPECT_FALSE(session.step());
  sendPoses(session, stream, 100, 100);
  const auto step = session.step();
  ASSERT_TRUE(step);
  EXPECT_TRUE(step->by_times);
  // The odometry stops inside the next one, and it is used as it is; or without what has no pose.
  for (const bool insist : {false, true}) {
    LiveOptions options;
    options.deskew = insist ? io::Deskew::On : io::Deskew::Auto;
    LiveSession stopped(test::armTool(), farParams(), options);
    sendPoses(stopped, stream, 0, 150);
    stopped.addScan(stream.scan(0));
    stopped.addScan(stream.scan(1));
    EXPECT_EQ(stepAll(stopped), 1U);
    EXPECT_EQ(stopped.status().waiting, 1U);
    stopped.endOfPoses();
    EXPECT_EQ(stepAll(stopped), 1U);
    EXPECT_EQ(stopped.status().by_times, insist ? 2U : 1U);
    // The last pose is at 50 ms: the point there may have it or not.
    EXPECT_NEAR(static_cast<double>(stopped.status().unposed_returns), insist ? kCount / 2 - 0.5 : 0, 0.5);
    expectAllAccountedFor(stopped.status());
  }
  // On is for scans with times.
  LiveOptions options;
  options.deskew = io::Deskew::On;
  LiveSession timed(test::armTool(), farParams(), options);
  sendPoses(timed, stream, 0, 150);
  LiveScan scan = stream.scan(0);
  scan.times.clear();
  timed.addScan(std::move(scan));
  EXPECT_EQ(stepAll(timed), 0U);
  EXPECT_EQ(droppedFor(timed, ScanDrop::Unusable), 1U);
}

/// A scan whose times are not its own costs itself, and nothing else changes.
TEST(LiveTimes, OfAnotherUnitOrClockDropTheScan) {
  const MovingStream stream;
  const auto run = [&](const std::vector<double>* wrong, bool bad) {
    LiveSession session(test::armTool(), farParams());
    sendPoses(session, stream, 0, 905);
    for (std::size_t n = 0; n < 8; ++n) {
      LiveScan scan = stream.scan(n);
      if (n == 5) {
        if (!bad) continue;
        scan.times = *wrong;
      }
      session.addScan(std::move(scan));
      while (session.step()) {
      }
    }
    return session;
  };
  const LiveSession without = run(nullptr, false);
  EXPECT_EQ(without.status().by_times, 7U);
  std::vector<double> seconds, clock, uptime, endless(kCount, std::numeric_limits<double>::infinity()),
      none(kCount, std::numeric_limits<double>::quiet_NaN());
  for (std::size_t i = 0; i < kCount; ++i) {
    const double t_s = stream.scanner.timeOf(i, kCount);
    seconds.push_back(t_s * 1e12);         // a thousand times as long
    clock.push_back(1.7e18 + 1e9 * t_s);   // a date
    uptime.push_back(3600e9 + 1e9 * t_s);  // since an hour
  }
  for (const std::vector<double>& wrong : {seconds, clock, uptime, endless, none}) {
    const LiveSession with = run(&wrong, true);
    EXPECT_EQ(droppedFor(with, ScanDrop::Unusable), 1U);
    EXPECT_EQ(with.status().taken, 7U);
    expectAllAccountedFor(with.status());
    expectSameField(with.field(), without.field());
  }
  // The second of all: nobody knows yet which of the two is right, and it is not used as if it had no times.
  LiveSession early(test::armTool(), farParams());
  sendPoses(early, stream, 0, 905);
  for (std::size_t n = 0; n < 4; ++n) {
    LiveScan scan = stream.scan(n);
    if (n == 1) scan.times = clock;
    early.addScan(std::move(scan));
  }
  EXPECT_EQ(stepAll(early), 3U);
  EXPECT_EQ(early.status().by_times, 3U);
  EXPECT_EQ(droppedFor(early, ScanDrop::Unusable), 1U);
  // Fewer times than points, and a unit that is none.
  LiveSession session(test::armTool(), farParams());
  LiveScan few = stream.scan(0), odd = stream.scan(1);
  few.times.pop_back();
  odd.time_unit_s = 0.1;
  session.addScan(std::move(few));
  session.addScan(std::move(odd));
  EXPECT_EQ(droppedFor(session, ScanDrop::Unusable), 2U);
}

/// Odometry that runs backwards, stops or jumps: counted, and each scan that it does not cover is as in `map`.
TEST(LiveTimes, SurviveOdometryThatRunsBackwardsStopsOrJumps) {
  const MovingStream stream;
  const auto run = [&](const std::vector<LivePose>& poses) {
    LiveSession session(test::armTool(), farParams());
    for (const LivePose& pose : poses) session.addPose(pose);
    for (std::size_t n = 0; n < 8; ++n) session.addScan(stream.scan(n));
    session.endOfPoses();
    stepAll(session);
    expectAllAccountedFor(session.status());
    return session;
  };
  std::vector<LivePose> steady;
  for (std::int64_t ms = 0; ms <= 905; ms += 5) steady.push_back(stream.poseAt(ms));
  const LiveSession good = run(steady);
  EXPECT_EQ(good.status().by_times, 8U);

  std::vector<LivePose> backwards = steady;
  for (std::size_t n = 0; n + 1 < backwards.size(); n += 2) std::swap(backwards[n], backwards[n + 1]);
  const LiveSession same = run(backwards);
  EXPECT_GT(same.status().poses_backwards, 50U);
  expectSameField(same.field(), good.field());

  // Scans 2 to 4 have no pose at their stamp; the end of scan 1 has none, and it is used as it is.
  std::vector<LivePose> gap = steady;
  std::erase_if(gap, [&](const LivePose& pose) {
    const std::int64_t ms = (pose.stamp_ns - MovingStream::stampOf(0)) / 1'000'000;
    return ms > 150 && ms < 500;
  });
  const LiveSession stopped = run(gap);
  EXPECT_EQ(stopped.status().by_times, 4U);
  EXPECT_EQ(stopped.status().taken, 5U);
  EXPECT_EQ(droppedFor(stopped, ScanDrop::NoPose), 3U);

  // By 100 m within 5 ms, inside scan 3.
  std::vector<LivePose> jump = steady;
  for (LivePose& pose : jump)
    if (pose.stamp_ns > MovingStream::stampOf(3) + 50'000'000) pose.p_W.y() += 100;
  const LiveSession jumped = run(jump);
  EXPECT_EQ(jumped.status().taken, 8U);
  EXPECT_EQ(jumped.status().by_times, 7U);
}

/// A thin rod can touch a flat wall, until a panel before it is seen by a scan that there was no time for.
TEST(LiveTimes, AScanThatThereWasNoTimeForBlocksWhereverItMoved) {
  const ToolGeometry rod = test::boxTool({0, -0.03f, -0.03f}, {0.9f, 0.03f, 0.03f});
  const auto wall = [](std::size_t n, bool panel) {
    LiveScan scan;
    scan.stamp_ns = stampOf(n);
    for (int i = -30; i < 30; ++i)
      for (int k = -30; k < 30; ++k) {
        // The sensor moves aside by 4.9 m within a scan: by its pose at the stamp, the panel would be far from the
        // wall.
        scan.points.emplace_back(panel ? 1.2F : 2.0F, 0.02F * static_cast<float>(i) - (panel ? 4.9F : 0.0F),
                                 0.02F * static_cast<float>(k));
        scan.times.push_back(panel ? 0.1 : 0.0);
      }
    scan.points.push_back({2, panel ? -4.9F : 0.0F, 0});
    scan.times.push_back(panel ? 0.0 : 0.09);
    return scan;
  };
  const auto pose = [](std::size_t n, int ms, double y_m) {
    return LivePose{stampOf(n) + ms * 1'000'000, {0, y_m, 0}, Eigen::Quaterniond::Identity()};
  };
  for (const bool poses_first : {true, false}) {
    LiveOptions options;
    options.most_waiting_returns = 3 * 6002;
    LiveSession session(rod, coarseParams(), options);
    for (std::size_t n = 0; n < 10; ++n) {
      session.addPose(pose(n, 0, 0));
      session.addPose(pose(n, 99, 0));
      session.addScan(wall(n, false));
      ASSERT_TRUE(session.step());
    }
    session.addPose(pose(10, 0, 0));
    ASSERT_GT(session.field().snapshot().count(PointLabel::Accessible), 100U);
    const auto move = [&] {
      for (int ms = 1; ms <= 101; ms += 10) session.addPose(pose(10, ms, 0.049 * ms));
    };
    if (poses_first) move();
    session.addScan(wall(10, true));
    for (std::size_t n = 12; n < 15; ++n) session.addScan(wall(n, false));
    EXPECT_EQ(droppedFor(session, ScanDrop::QueueFull), 1U);
    if (!poses_first) move();
    while (session.step()) {
    }
    EXPECT_EQ(session.field().snapshot().count(PointLabel::Accessible), 0U);
  }
}

/// The scans after it are of another clock and are dropped, one by one: labels follow all the same.
TEST(LiveTimes, WhatThereWasNoTimeForBlocksAlsoIfTheNextScanIsDropped) {
  for (const double budget_ms : {0.0, 60000.0}) {
    SCOPED_TRACE(budget_ms);
    LiveOptions options;
    options.budget_ms = budget_ms;
    options.most_waiting_returns = 8000;
    LiveSession session(test::boxTool({0, -0.03f, -0.03f}, {0.9f, 0.03f, 0.03f}), coarseParams(), options);
    const auto send = [&](std::size_t n, float wall_m, double late) {
      LiveScan scan;
      scan.stamp_ns = stampOf(n);
      for (int i = -30; i < 30; ++i)
        for (int k = -30; k < 30; ++k) {
          scan.points.emplace_back(wall_m, 0.02F * static_cast<float>(i), 0.02F * static_cast<float>(k));
          scan.times.push_back(late + 0.001 * (i + 30));
        }
      for (const int ms : {0, 99}) session.addPose({stampOf(n) + ms * 1'000'000, {0, 0, 0}});
      session.addScan(std::move(scan));
    };
    for (std::size_t n = 0; n < 10; ++n) {
      send(n, 2, 0);
      ASSERT_TRUE(session.step());
    }
    ASSERT_GT(session.field().snapshot().count(PointLabel::Accessible), 100U);
    send(10, 1.2F, 0);
    send(11, 2, 3600);
    EXPECT_EQ(droppedFor(session, ScanDrop::QueueFull), 1U);
    session.endOfPoses();
    const auto step = session.step();
    ASSERT_TRUE(step) << "who only sees what changed hears of it";
    EXPECT_TRUE(step->only_backlog);
    EXPECT_EQ(step->stamp_ns, stampOf(9));
    EXPECT_GT(step->changed.size(), 100U);
    EXPECT_EQ(droppedFor(session, ScanDrop::Unusable), 1U) << session.status().motion;
    EXPECT_EQ(session.field().snapshot().count(PointLabel::Accessible), 0U);
    EXPECT_FALSE(session.step());
  }
}

}  // namespace
}  // namespace accessvdb::live_test

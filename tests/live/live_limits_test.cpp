// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a live session does with too much, too late, too little and nonsense: a count, and no label that is wrong.
#include <gtest/gtest.h>

#include <limits>
#include <set>
#include <tuple>

#include "accessvdb/error.h"
#include "accessvdb/tsdf_volume.h"
#include "live/live_stream.h"
#include "support/same_map.h"

namespace accessvdb::live_test {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

TEST(LiveLimits, IfTooManyWaitTheOldestAreOnlyFused) {
  const std::vector<Scan> scans = test::wallScans(3, 7, 200);
  LiveOptions options;
  options.queue_scans = 3;
  LiveSession session(test::armTool(), coarseParams(), options);
  for (std::size_t n = 0; n < scans.size(); ++n) {
    session.addPose(poseOf(scans[n], n));
    session.addScan(scanOf(scans[n], n));
  }
  EXPECT_EQ(session.status().waiting, 7U);
  std::vector<bool> late;
  while (const auto step = session.step()) {
    late.push_back(step->late);
    EXPECT_EQ(step->changed.empty(), step->late);
  }
  EXPECT_EQ(late, (std::vector<bool>{true, true, true, true, false, false, false}));
  EXPECT_EQ(session.status().late, 4U);
  EXPECT_EQ(session.status().taken, 7U);
  EXPECT_EQ(session.status().allDropped(), 0U);
  expectAllAccountedFor(session.status());
  test::expectSameMap(session.field().volume(), fedDirectly(scans, upTo(7)).volume());
}

/// A thin rod can touch a flat wall.
ToolGeometry rod() { return test::boxTool({0, -0.03f, -0.03f}, {0.9f, 0.03f, 0.03f}); }
/// A wall 2 m away, or with a panel 0.8 m before it.
Scan wallOrPanel(int n, bool panel) {
  Scan scan;
  scan.T_W_S.translation() = Eigen::Vector3d(0, 0.01 * (n % 5), 0);
  for (int i = -30; i < 30; ++i) {
    for (int k = -30; k < 30; ++k)
      scan.points_S.emplace_back(panel ? 1.2F : 2.0F,
                                 0.02F * static_cast<float>(i) + 0.004F * static_cast<float>(n % 5),
                                 0.02F * static_cast<float>(k));
  }
  return scan;
}
std::size_t accessible(const AccessibilityField& field) { return field.snapshot().count(PointLabel::Accessible); }

TEST(LiveLimits, WhatThereWasNoTimeForBlocks) {
  LiveOptions options;
  options.queue_scans = 2;
  options.most_waiting_returns = 4 * 3600;
  LiveSession session(rod(), coarseParams(), options);
  const auto send = [&](std::size_t n, bool panel) {
    const Scan scan = wallOrPanel(static_cast<int>(n), panel);
    session.addPose(poseOf(scan, n));
    session.addScan(scanOf(scan, n));
  };
  for (std::size_t n = 0; n < 10; ++n) {
    send(n, false);
    ASSERT_TRUE(session.step());
  }
  ASSERT_GT(accessible(session.field()), 100U);
  // Only the first of these sees the panel, and it has to go.
  send(10, true);
  for (std::size_t n = 11; n < 15; ++n) send(n, false);
  EXPECT_EQ(session.status().waiting, 4U);
  EXPECT_EQ(droppedFor(session, ScanDrop::QueueFull), 1U);
  EXPECT_EQ(session.takeDropped().at(0).number, 10U);
  EXPECT_EQ(session.status().left_out_returns, 3600U);
  while (session.step()) {
  }
  EXPECT_EQ(accessible(session.field()), 0U);
  expectAllAccountedFor(session.status());

  // It goes before its pose is there, and no scan follows that has one.
  LiveSession early(rod(), coarseParams(), options);
  for (std::size_t n = 0; n < 10; ++n) {
    const Scan scan = wallOrPanel(static_cast<int>(n), false);
    early.addPose(poseOf(scan, n));
    early.addScan(scanOf(scan, n));
    ASSERT_TRUE(early.step());
  }
  const std::size_t before = accessible(early.field());
  ASSERT_GT(before, 100U);
  for (std::size_t n = 10; n < 15; ++n) early.addScan(scanOf(wallOrPanel(static_cast<int>(n), n == 10), n));
  EXPECT_EQ(droppedFor(early, ScanDrop::QueueFull), 1U);
  EXPECT_EQ(early.status().left_out_returns, 3600U);
  early.addPose(poseOf(wallOrPanel(0, true), 10));
  early.endOfPoses();
  const auto withdrawn = early.step();
  ASSERT_TRUE(withdrawn) << "who only sees what changed hears of it";
  EXPECT_TRUE(withdrawn->only_backlog);
  EXPECT_GE(withdrawn->changed.size(), before);
  EXPECT_EQ(accessible(early.field()), 0U);
  EXPECT_FALSE(early.step());
  expectAllAccountedFor(early.status());

  // Without a pose nobody knows where it was: it is only counted.
  LiveSession lost(rod(), coarseParams(), options);
  lost.endOfPoses();
  for (std::size_t n = 0; n < 6; ++n) lost.addScan(scanOf(wallOrPanel(0, true), n));
  EXPECT_EQ(droppedFor(lost, ScanDrop::QueueFull), 2U);
  EXPECT_EQ(lost.status().left_out_returns, 0U);
}

/// Scans that are dropped after a reset, before there is a map again, are no step: it would have a stamp from before.
TEST(LiveLimits, AResetForgetsTheLatestStamp) {
  LiveOptions options;
  options.queue_scans = 2;
  options.most_waiting_returns = 4 * 3600;
  LiveSession session(rod(), coarseParams(), options);
  for (std::size_t n = 0; n < 3; ++n) {
    const Scan scan = wallOrPanel(0, false);
    session.addPose(poseOf(scan, n));
    session.addScan(scanOf(scan, n));
    ASSERT_TRUE(session.step());
  }
  session.reset();
  for (std::size_t n = 10; n < 15; ++n) session.addScan(scanOf(wallOrPanel(0, n == 10), n));
  EXPECT_EQ(droppedFor(session, ScanDrop::QueueFull), 1U);
  session.addPose(poseOf(wallOrPanel(0, true), 10));
  session.endOfPoses();
  EXPECT_FALSE(session.step());
}

/// Poses may be late by any time: what many scans saw before is remembered, and if it cannot be, everything is closed.
TEST(LiveLimits, WhatManyScansSawBeforeTheirPosesBlocks) {
  constexpr std::size_t kFirst = 10;
  for (const std::size_t lost : {100, 6000}) {
    LiveOptions options;
    options.most_waiting_returns = 4000;
    LiveSession session(rod(), coarseParams(), options);
    for (std::size_t n = 0; n < kFirst; ++n) {
      const Scan scan = wallOrPanel(static_cast<int>(n), false);
      session.addPose(poseOf(scan, n));
      session.addScan(scanOf(scan, n));
      ASSERT_TRUE(session.step());
    }
    ASSERT_GT(accessible(session.field()), 100U);
    // The first sees the panel; the others see what is far from here.
    session.addScan(scanOf(wallOrPanel(0, true), kFirst));
    for (std::size_t n = 1; n < lost + 40; ++n) session.addScan({stampOf(kFirst + n), {{-9, 0, 0}}});
    EXPECT_EQ(droppedFor(session, ScanDrop::QueueFull), lost);
    EXPECT_EQ(session.status().all_closed, lost > 4096);
    for (std::size_t n = 0; n < 3; ++n) session.addPose(poseOf(wallOrPanel(0, true), kFirst + n));
    const auto withdrawn = session.step();
    ASSERT_TRUE(withdrawn);
    EXPECT_TRUE(withdrawn->only_backlog);
    EXPECT_GT(withdrawn->changed.size(), 100U);
    EXPECT_EQ(accessible(session.field()), 0U);
    // For good: not even what is seen later opens.
    session.addPose(poseOf(wallOrPanel(0, false), kFirst + lost + 40));
    session.addScan(scanOf(wallOrPanel(0, false), kFirst + lost + 40));
    EXPECT_GE(stepAll(session), 1U);
    EXPECT_EQ(accessible(session.field()), 0U);
    expectAllAccountedFor(session.status());
    session.reset();
    EXPECT_FALSE(session.status().all_closed);
  }
}

TEST(LiveLimits, AnObstacleThatComesWithTheMemoryFullBlocks) {
  LiveOptions options;
  options.memory_limit_bytes = 1;
  LiveSession session(rod(), coarseParams(), options);
  const auto step = [&](std::size_t n, bool panel) {
    const Scan scan = wallOrPanel(static_cast<int>(n), panel);
    session.addPose(poseOf(scan, n));
    session.addScan(scanOf(scan, n));
    return session.step()->left_out_returns;
  };
  for (std::size_t n = 0; n < 10; ++n) step(n, false);
  EXPECT_TRUE(session.status().memory_full);
  ASSERT_GT(accessible(session.field()), 100U);
  for (std::size_t n = 10; n < 30; ++n) EXPECT_EQ(step(n, true), 3600U);
  EXPECT_EQ(accessible(session.field()), 0U);
}

/// They take memory as well, and there may be any number of them.
TEST(LiveLimits, EmptyScansDoNotWaitInAnyNumber) {
  LiveOptions options;
  options.most_waiting_returns = 5000;
  LiveSession session(rod(), coarseParams(), options);
  for (std::size_t n = 0; n < 1000; ++n) session.addScan({stampOf(n)});
  EXPECT_EQ(session.status().waiting, 50U);
  EXPECT_EQ(droppedFor(session, ScanDrop::QueueFull), 950U);
  EXPECT_EQ(session.takeDropped().size(), 950U);
  session.endOfPoses();
  EXPECT_FALSE(session.step());
  EXPECT_EQ(session.status().waiting, 0U);
  expectAllAccountedFor(session.status());
}

/// One that waits and is more than 10 s later than the next had a wrong clock. It goes, and order is kept all the same.
TEST(LiveLimits, AScanFromTheFutureKeepsNobodyOut) {
  const std::vector<Scan> scans = test::wallScans(3, 8, 100);
  LiveSession session(test::armTool(), coarseParams());
  std::vector<std::size_t> taken;
  const auto send = [&](std::size_t n, std::int64_t wrong_ns = 0) {
    session.addPose(poseOf(scans[n], n));
    LiveScan scan = scanOf(scans[n], n);
    scan.stamp_ns += wrong_ns;
    session.addScan(std::move(scan));
    while (const auto step = session.step()) taken.push_back(step->number);
  };
  send(0);
  send(1);
  send(2, 20'000'000'000);
  send(3, 86'400'000'000'000);
  EXPECT_EQ(session.status().waiting, 2U);
  send(4);
  EXPECT_EQ(droppedFor(session, ScanDrop::OutOfOrder), 2U);
  send(1);  // not later than one that was taken
  EXPECT_EQ(droppedFor(session, ScanDrop::OutOfOrder), 3U);
  send(5, 9'000'000'000);  // may be right: poses may be late, too
  send(6);
  EXPECT_EQ(droppedFor(session, ScanDrop::OutOfOrder), 4U);
  EXPECT_EQ(taken, (std::vector<std::size_t>{0, 1, 4}));
  session.endOfPoses();
  EXPECT_FALSE(session.step());
  expectAllAccountedFor(session.status());
  expectSameField(session.field(), fedDirectly(scans, taken));
}

/// Scans wait for poses that come a little later, as an odometry gives them. One of another clock is what is wrong
/// then.
TEST(LiveLimits, AStaleScanDropsNoneThatWaits) {
  const std::vector<Scan> scans = test::wallScans(3, 8, 100);
  LiveSession session(test::armTool(), coarseParams());
  std::vector<std::size_t> taken;
  const auto takeAll = [&] {
    while (const auto step = session.step()) taken.push_back(step->number);
  };
  LiveScan stale = scanOf(scans[0], 0);
  stale.stamp_ns = 7;
  for (std::size_t n = 0; n < 8; ++n) {
    session.addScan(scanOf(scans[n], n));
    session.addScan(stale);  // before any pose, and after some
    if (n > 0) session.addPose(poseOf(scans[n - 1], n - 1));
    takeAll();
  }
  session.addPose(poseOf(scans[7], 7));
  session.endOfPoses();
  takeAll();
  EXPECT_EQ(taken, (std::vector<std::size_t>{0, 2, 4, 6, 8, 10, 12, 14}));
  EXPECT_EQ(droppedFor(session, ScanDrop::OutOfOrder), 8U);
  expectAllAccountedFor(session.status());
}

TEST(LiveLimits, DropScansThatWillNeverHaveAPose) {
  const std::vector<Scan> scans = test::wallScans(3, 10, 200);
  LiveOptions options;
  options.queue_scans = 10;
  LiveSession session(test::armTool(), coarseParams(), options);
  for (std::size_t n = 0; n < scans.size(); ++n) session.addScan(scanOf(scans[n], n));
  EXPECT_FALSE(session.step());
  // Poses begin late (scan 2), have a gap (4, 5, 6), and end early (8).
  for (const std::size_t n : {2, 3}) session.addPose(poseOf(scans[n], n));
  session.addPose({stampOf(3) + 1'000'000, scans[3].T_W_S.translation(), Eigen::Quaterniond::Identity()});
  session.addPose({stampOf(7) - 1'000'000, scans[7].T_W_S.translation(), Eigen::Quaterniond::Identity()});
  for (const std::size_t n : {7, 8}) session.addPose(poseOf(scans[n], n));
  std::vector<std::size_t> taken;
  while (const auto step = session.step()) taken.push_back(step->number);
  EXPECT_EQ(taken, (std::vector<std::size_t>{2, 3, 7, 8}));
  EXPECT_EQ(droppedFor(session, ScanDrop::NoPose), 5U);
  EXPECT_EQ(session.status().waiting, 1U);
  EXPECT_FALSE(session.waitForWork(std::chrono::milliseconds(0)));
  session.endOfPoses();
  EXPECT_TRUE(session.waitForWork(std::chrono::milliseconds(0)));
  EXPECT_FALSE(session.step());
  EXPECT_EQ(droppedFor(session, ScanDrop::NoPose), 6U);
  expectAllAccountedFor(session.status());
  expectSameField(session.field(), fedDirectly(scans, taken));
}

TEST(LiveLimits, DoNotUsePosesThatJump) {
  const std::vector<Scan> scans = test::wallScans(3, 1, 100);
  LiveSession session(test::armTool(), coarseParams());
  session.addPose({stampOf(0) - 50'000'000, {0, 0, 1}, Eigen::Quaterniond::Identity()});
  session.addScan(scanOf(scans[0], 0));
  session.addPose({stampOf(0) + 50'000'000, {20, 0, 1}, Eigen::Quaterniond::Identity()});  // 200 m/s
  EXPECT_FALSE(session.step());
  EXPECT_EQ(droppedFor(session, ScanDrop::NoPose), 1U);
}

TEST(LiveLimits, CountBadScansAndPoses) {
  const std::vector<Scan> scans = test::wallScans(3, 3, 100);
  LiveOptions options;
  options.most_returns = 150;
  LiveSession session(test::armTool(), coarseParams(), options);
  LiveScan timeless = scanOf(scans[0], 0), far = scanOf(scans[0], 0), large = scanOf(scans[0], 0);
  timeless.stamp_ns = 0;
  far.stamp_ns = std::numeric_limits<std::int64_t>::max();
  large.points.resize(151);
  session.addScan(timeless);
  session.addScan(far);
  session.addScan(large);
  EXPECT_EQ(droppedFor(session, ScanDrop::Unusable), 3U);
  session.addScan(scanOf(scans[1], 1));
  session.addScan(scanOf(scans[1], 1));  // again
  session.addScan(scanOf(scans[0], 0));  // late
  EXPECT_EQ(droppedFor(session, ScanDrop::OutOfOrder), 2U);

  session.addPose({stampOf(1), {0, kNaN, 0}, Eigen::Quaterniond::Identity()});
  session.addPose({stampOf(1), {0, 0, 0}, Eigen::Quaterniond(2, 0, 0, 0)});
  session.addPose({stampOf(1), {0, 0, 0}, Eigen::Quaterniond(kNaN, 0, 0, 0)});
  session.addPose({std::numeric_limits<std::int64_t>::min(), {0, 0, 0}, Eigen::Quaterniond::Identity()});
  EXPECT_EQ(session.status().poses_invalid, 4U);
  EXPECT_FALSE(session.waitForWork(std::chrono::milliseconds(0)));
  LivePose pose = poseOf(scans[1], 1), other = pose;
  pose.frame = "odom";
  other.frame = "map";
  session.addPose(pose);
  session.addPose(other);
  session.addPose(pose);
  EXPECT_EQ(session.status().poses_other_frame, 1U);
  EXPECT_EQ(session.status().poses_repeated, 1U);
  pose.stamp_ns -= 1'000'000;
  session.addPose(pose);
  EXPECT_EQ(session.status().poses_backwards, 1U);
  EXPECT_TRUE(session.step());
  expectAllAccountedFor(session.status());
  expectSameField(session.field(), fedDirectly(scans, {1}));
}

TEST(LiveLimits, ReturnsThatAreNotFiniteAreCountedAndNeverUsed) {
  std::vector<Scan> scans = test::wallScans(3, 2, 200);
  LiveSession session(test::armTool(), coarseParams());
  for (std::size_t n = 0; n < scans.size(); ++n) {
    session.addPose(poseOf(scans[n], n));
    LiveScan scan = scanOf(scans[n], n);
    for (const Eigen::Vector3f& p : scan.points) scan.points_double.push_back(p.cast<double>());
    scan.points.clear();
    scan.points_double.emplace_back(1e300, 0, 0);
    scan.points_double.emplace_back(0, kNaN, 0);
    session.addScan(std::move(scan));
    const auto step = session.step();
    ASSERT_TRUE(step);
    EXPECT_EQ(step->fused.dropped[static_cast<std::size_t>(DropReason::NonFinite)], 2U);
  }
  expectSameField(session.field(), fedDirectly(scans, {0, 1}));
}

TEST(LiveLimits, EmptyScansAreTaken) {
  LiveSession session(test::armTool(), coarseParams());
  session.addPose({stampOf(0), {0, 0, 0}, Eigen::Quaterniond::Identity()});
  session.addScan({stampOf(0)});
  const auto step = session.step();
  ASSERT_TRUE(step);
  EXPECT_TRUE(step->changed.empty());
  EXPECT_EQ(session.status().taken, 1U);
}

TEST(LiveLimits, RefuseOptionsThatCannotBe) {
  const auto id = [](LiveOptions options, FieldParams params) -> std::string {
    try {
      const LiveSession session(test::armTool(), params, options);
    } catch (const Error& error) {
      return error.id();
    }
    return "";
  };
  LiveOptions no_queue, no_poses;
  no_queue.queue_scans = 0;
  no_poses.most_poses = 1;
  FieldParams tile = coarseParams();
  tile.origin_W = {0, 0, 0};
  tile.window.emplace();
  EXPECT_EQ(id(no_queue, coarseParams()), "live.queue");
  EXPECT_EQ(id(no_poses, coarseParams()), "live.poses");
  EXPECT_EQ(id({}, tile), "live.window");
}

/// Leaves of the map, or those that have a place for returns, by brute force over its grids.
std::set<std::tuple<int, int, int>> leavesOf(const AccessibilityField& field, bool with_values) {
  std::set<std::tuple<int, int, int>> leaves;
  const auto add = [&](const auto& grid) {
    for (auto leaf = grid->tree().cbeginLeaf(); leaf; ++leaf)
      leaves.insert({leaf->origin().x(), leaf->origin().y(), leaf->origin().z()});
  };
  add(field.volume().distance());
  if (!with_values) add(field.volume().cleared());
  return leaves;
}

/// A wall in front of the sensor, whose place along y is given.
Scan wallAt(double y_m, double x_m = 2) {
  Scan scan;
  scan.T_W_S.translation() = Eigen::Vector3d(0, y_m, 1);
  for (int i = -20; i <= 20; ++i)
    for (int k = -20; k <= 20; ++k)
      scan.points_S.emplace_back(static_cast<float>(x_m), 0.025F * static_cast<float>(i),
                                 0.025F * static_cast<float>(k));
  return scan;
}

TEST(LiveLimits, OverTheMemoryLimitNoNewSpaceIsTakenButWhatIsKnownIsUpdated) {
  LiveOptions options;
  options.memory_limit_bytes = 1;  // reached by the first scan
  LiveSession session(test::armTool(), coarseParams(), options);
  const auto take = [&](const Scan& scan, std::size_t n) {
    session.addPose(poseOf(scan, n));
    session.addScan(scanOf(scan, n));
    const auto step = session.step();
    EXPECT_TRUE(step);
    return *step;
  };
  EXPECT_EQ(take(wallAt(0), 0).left_out_returns, 0U);
  EXPECT_TRUE(session.status().memory_full);
  EXPECT_GT(session.status().memory_bytes, 1U);
  const auto known = leavesOf(session.field(), true), all = leavesOf(session.field(), false);
  const FieldSnapshot before = session.field().snapshot();

  // A wall 20 m away: nothing of it is known, and nothing is taken.
  const Scan far = wallAt(20);
  EXPECT_EQ(take(far, 1).left_out_returns, far.points_S.size());
  EXPECT_EQ(leavesOf(session.field(), false), all);
  // Half of it in known space: exactly the returns in leaves that have values.
  const Scan half = wallAt(0.5);
  std::uint64_t outside = 0;
  const Eigen::Vector3d origin_W = session.field().origin_W();
  for (const Eigen::Vector3f& p_S : half.points_S) {
    const Eigen::Vector3d p_L = half.T_W_S * p_S.cast<double>().eval() - origin_W;
    const auto leaf = [&](int axis) { return static_cast<int>(std::floor(std::round(p_L[axis] / 0.05) / 8)) * 8; };
    outside += known.contains({leaf(0), leaf(1), leaf(2)}) ? 0U : 1U;
  }
  EXPECT_GT(outside, 100U);
  EXPECT_LT(outside, half.points_S.size() - 100);
  EXPECT_EQ(take(half, 2).left_out_returns, outside);
  EXPECT_EQ(session.status().left_out_returns, outside + far.points_S.size());
  // What is known goes on to be updated: the wall gains weight.
  for (std::size_t n = 3; n < 6; ++n) take(wallAt(0), n);
  const FieldSnapshot after = session.field().snapshot();
  ASSERT_GE(after.points.size(), before.points.size());
  std::size_t heavier = 0;
  for (std::size_t n = 0; n < before.points.size(); ++n) heavier += after.points[n].weight > before.points[n].weight;
  EXPECT_EQ(heavier, before.points.size());
  // And the map grows no more, however long it goes on.
  for (std::size_t n = 6; n < 30; ++n) take(wallAt(0.05 * static_cast<double>(n)), n);
  EXPECT_EQ(leavesOf(session.field(), false), all);
  EXPECT_EQ(leavesOf(session.field(), true), known);
  expectAllAccountedFor(session.status());
}

}  // namespace
}  // namespace accessvdb::live_test

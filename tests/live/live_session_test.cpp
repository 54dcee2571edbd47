// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A live session gives the bits of a field that is fed with the same scans directly, and accounts for every scan.
#include "accessvdb/live_session.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <thread>

#include "accessvdb/error.h"
#include "live/live_stream.h"

namespace accessvdb::live_test {
namespace {

TEST(LiveSession, GivesTheBitsOfAFieldThatIsFedDirectly) {
  const std::vector<Scan> scans = test::wallScans(3, 9, 300);
  const AccessibilityField expected = fedDirectly(scans, upTo(scans.size()));
  test::expectVaried(expected.snapshot());
  for (int order = 0; order < 3; ++order) {
    SCOPED_TRACE(order);
    LiveSession session(test::armTool(), coarseParams());
    std::vector<SurfacePoint> shown;
    const auto show = [&](const std::vector<SurfacePoint>& changed) {
      for (const SurfacePoint& point : changed) {
        if (point.id >= shown.size()) shown.resize(point.id + 1);
        shown[point.id] = point;
      }
    };
    std::size_t steps = 0;
    for (std::size_t n = 0; n < scans.size(); ++n) {
      if (order == 0) session.addPose(poseOf(scans[n], n));  // before the scan
      session.addScan(scanOf(scans[n], n));
      if (order == 1) session.addPose(poseOf(scans[n], n));  // after it
      if (order == 2) {                                      // long after it
        if (n % 3 != 2) continue;
        EXPECT_FALSE(session.waitForWork(std::chrono::milliseconds(0)));
        for (std::size_t late = n - 2; late <= n; ++late) session.addPose(poseOf(scans[late], late));
      }
      EXPECT_TRUE(session.waitForWork(std::chrono::milliseconds(0)));
      while (const auto step = session.step()) {
        EXPECT_EQ(step->number, steps);
        EXPECT_EQ(step->stamp_ns, stampOf(steps++));
        show(step->changed);
      }
    }
    EXPECT_EQ(session.status().taken, scans.size());
    EXPECT_EQ(session.status().allDropped(), 0U);
    expectAllAccountedFor(session.status());
    expectSameField(session.field(), expected);
    // Who only ever saw what changed knows every label.
    const FieldSnapshot all = expected.snapshot();
    ASSERT_EQ(shown.size(), all.points.size());
    for (std::size_t n = 0; n < shown.size(); ++n) {
      ASSERT_EQ(shown[n].label, all.points[n].label) << n;
      ASSERT_EQ(shown[n].reason, all.points[n].reason) << n;
      ASSERT_EQ(shown[n].direction, all.points[n].direction) << n;
      ASSERT_EQ(shown[n].position_W, all.points[n].position_W) << n;
    }
  }
}

TEST(LiveSession, SaysOnlyWhatChanged) {
  const std::vector<Scan> scans = test::wallScans(4, 4, 200);
  LiveSession session(test::armTool(), coarseParams());
  std::vector<SurfacePoint> before;
  for (std::size_t n = 0; n < scans.size(); ++n) {
    session.addPose(poseOf(scans[n], n));
    session.addScan(scanOf(scans[n], n));
    const auto step = session.step();
    ASSERT_TRUE(step);
    const std::vector<SurfacePoint> now = session.field().snapshot().points;
    std::vector<std::uint32_t> expected, changed;
    for (std::size_t i = 0; i < now.size(); ++i) {
      if (i >= before.size() || now[i].label != before[i].label || now[i].reason != before[i].reason ||
          now[i].direction != before[i].direction)
        expected.push_back(now[i].id);
    }
    for (const SurfacePoint& point : step->changed) {
      changed.push_back(point.id);
      EXPECT_TRUE(test::sameVerdict(point, now[point.id]));
    }
    EXPECT_EQ(changed, expected);
    if (n > 0) {
      EXPECT_LT(changed.size(), now.size());
    }
    before = now;
  }
}

TEST(LiveSession, InterpolatesPosesOfOdometryThatIsFasterThanTheScanner) {
  const std::vector<Scan> scans = test::wallScans(3, 3, 200);
  LiveSession session(test::armTool(), coarseParams());
  AccessibilityField expected(test::armTool(), coarseParams());
  for (std::size_t n = 0; n < scans.size(); ++n) {
    const double x = static_cast<double>(n) / 8;
    // Exact halves, so that the pose in the middle is known to the bit.
    session.addPose({stampOf(n) - 10'000'000, {x, 0, 1}, Eigen::Quaterniond::Identity()});
    session.addScan(scanOf(scans[n], n));
    EXPECT_FALSE(session.step()) << "there is no pose after it yet";
    session.addPose({stampOf(n) + 10'000'000, {x + 0.25, 0.5, 1}, Eigen::Quaterniond::Identity()});
    ASSERT_TRUE(session.step());
    Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
    T_W_S.translation() = Eigen::Vector3d(x + 0.125, 0.25, 1);
    expected.integrateScan(scans[n].points_S, T_W_S);
    expected.update();
  }
  expectSameField(session.field(), expected);
}

TEST(LiveSession, TakesCloudsInThePosesFrameAsRays) {
  const std::vector<Scan> scans = test::wallScans(3, 5, 300);
  for (const bool doubles : {false, true}) {
    SCOPED_TRACE(doubles);
    LiveSession session(test::armTool(), coarseParams());
    AccessibilityField expected(test::armTool(), coarseParams());
    for (std::size_t n = 0; n < scans.size(); ++n) {
      LivePose pose = poseOf(scans[n], n);
      pose.frame = "odom";
      LiveScan scan;
      scan.stamp_ns = stampOf(n);
      scan.frame = "odom";
      std::vector<Eigen::Vector3d> points_W;
      for (const Eigen::Vector3f& p_S : scans[n].points_S) {
        const Eigen::Vector3d p_W = scans[n].T_W_S * p_S.cast<double>().eval();
        scan.points.push_back(p_W.cast<float>());
        points_W.push_back(doubles ? p_W : p_W.cast<float>().cast<double>().eval());
      }
      if (doubles) {
        scan.points.clear();
        scan.points_double = points_W;
      }
      session.addScan(std::move(scan));
      session.addPose(pose);
      ASSERT_TRUE(session.step());
      const std::vector<Eigen::Vector3d> origin_W = {pose.p_W};
      expected.integrateRays(points_W, origin_W);
      expected.update();
    }
    expectSameField(session.field(), expected);
  }
}

TEST(LiveSession, KnowsWhereTheSensorIsOnThePlatformAndLeavesOutThePlatform) {
  const std::vector<Scan> scans = test::wallScans(3, 5, 300);
  LiveOptions options;
  options.T_B_S =
      Eigen::Isometry3d(Eigen::Translation3d(0.25, 0, -0.5) * Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitZ()));
  options.exclude_box_S = Eigen::AlignedBox3d(Eigen::Vector3d(-0.4, -2, -1), Eigen::Vector3d(1.2, 2, 1));
  LiveSession session(test::armTool(), coarseParams(), options);
  AccessibilityField expected(test::armTool(), coarseParams());
  std::uint64_t excluded = 0;
  for (std::size_t n = 0; n < scans.size(); ++n) {
    session.addScan(scanOf(scans[n], n));
    session.addPose(poseOf(scans[n], n));
    ASSERT_TRUE(session.step());
    std::vector<Eigen::Vector3f> kept;
    for (const Eigen::Vector3f& p : scans[n].points_S) {
      if (options.exclude_box_S->contains(p.cast<double>().eval())) {
        ++excluded;
      } else {
        kept.push_back(p);
      }
    }
    expected.integrateScan(kept, sentPose(poseOf(scans[n], n)) * *options.T_B_S);
    expected.update();
  }
  EXPECT_GT(excluded, 50U);
  EXPECT_EQ(session.status().excluded_returns, excluded);
  expectSameField(session.field(), expected);
}

/// Receiving threads that are far too fast, beside the thread that takes steps.
TEST(LiveSession, AccountsForEveryScanWhenTheyComeTooFast) {
  const std::vector<Scan> scans = test::wallScans(3, 120, 200);
  LiveOptions options;
  options.queue_scans = 2;
  LiveSession session(test::armTool(), coarseParams(), options);
  std::atomic<bool> sending = true;
  std::thread poses([&] {
    for (std::size_t n = 0; n < scans.size(); ++n) session.addPose(poseOf(scans[n], n));
  });
  std::thread sender([&] {
    for (std::size_t n = 0; n < scans.size(); ++n) {
      session.addScan(scanOf(scans[n], n));
      std::this_thread::sleep_for(std::chrono::microseconds(300));
    }
    sending = false;
  });
  std::vector<std::size_t> taken;
  const auto takeAll = [&] {
    while (const auto step = session.step()) taken.push_back(step->number);
  };
  while (sending) {
    session.waitForWork(std::chrono::milliseconds(5));
    takeAll();
    expectAllAccountedFor(session.status());
  }
  poses.join();
  sender.join();
  takeAll();
  const LiveStatus status = session.status();
  EXPECT_EQ(status.published, scans.size());
  EXPECT_EQ(status.taken, taken.size());
  EXPECT_EQ(status.waiting, 0U);
  EXPECT_EQ(status.taken + status.allDropped(), status.published);
  EXPECT_EQ(taken.size(), scans.size());
  test::expectSameMap(session.field().volume(), fedDirectly(scans, taken).volume());
}

}  // namespace
}  // namespace accessvdb::live_test

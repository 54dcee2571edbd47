// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a live session takes of `map`: several tools and their orientations, labels after every n scans, a level world;
/// and what it can be told while it goes on.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <optional>

#include "accessvdb/error.h"
#include "accessvdb/tool_spec.h"
#include "io/poses/levelling.h"
#include "live/live_stream.h"
#include "support/scratch_folder.h"

namespace accessvdb::live_test {
namespace {

std::vector<ToolSpec> twoTools() {
  std::vector<ToolSpec> tools;
  tools.push_back({test::armTool()});
  tools.push_back({test::boxTool({0, -0.05f, -0.05f}, {0.4f, 0.05f, 0.05f}), OrientationSet::parse("sphere:60")});
  tools[1].name = "ball";
  return tools;
}

TEST(LiveChoices, SeveralToolsHaveTheBitsOfAFieldThatIsFedDirectly) {
  const std::vector<Scan> scans = test::wallScans(3, 6, 300);
  LiveSession session(twoTools(), coarseParams());
  AccessibilityField expected(twoTools(), coarseParams());
  std::vector<std::uint32_t> tools_shown;
  for (std::size_t n = 0; n < scans.size(); ++n) {
    session.addPose(poseOf(scans[n], n));
    session.addScan(scanOf(scans[n], n));
    const auto step = session.step();
    ASSERT_TRUE(step);
    for (const SurfacePoint& point : step->changed) {
      tools_shown.resize(std::max<std::size_t>(tools_shown.size(), point.id + 1));
      tools_shown[point.id] = point.tools;
    }
    expected.integrateScan(scans[n].points_S, sentPose(poseOf(scans[n], n)));
    expected.update();
  }
  expectSameField(session.field(), expected);
  const FieldSnapshot all = expected.snapshot();
  std::size_t by_second = 0;
  ASSERT_EQ(tools_shown.size(), all.points.size());
  for (std::size_t n = 0; n < all.points.size(); ++n) {
    ASSERT_EQ(tools_shown[n], all.points[n].tools) << "who only saw what changed knows which tools reach a point";
    by_second += all.points[n].tools == 2 ? 1 : 0;
  }
  EXPECT_GT(by_second, 10U);
  test::expectSame(session.field().toolSnapshot(1), expected.toolSnapshot(1));
}

TEST(LiveChoices, LabelsComeAfterEveryFewScansAndAtTheEnd) {
  const std::vector<Scan> scans = test::wallScans(3, 8, 300);
  LiveOptions options;
  options.update_every = 3;
  LiveSession session(test::armTool(), coarseParams(), options);
  AccessibilityField expected(test::armTool(), coarseParams());
  for (std::size_t n = 0; n < scans.size(); ++n) {
    session.addPose(poseOf(scans[n], n));
    session.addScan(scanOf(scans[n], n));
    const auto step = session.step();
    ASSERT_TRUE(step);
    EXPECT_FALSE(step->late);
    EXPECT_EQ(step->changed.empty(), n % 3 != 2) << n;
    expected.integrateScan(scans[n].points_S, sentPose(poseOf(scans[n], n)));
    if (n % 3 == 2) expected.update();
  }
  expectSameField(session.field(), expected);
  EXPECT_FALSE(session.step()) << "more may come";
  expectSameField(session.field(), expected);
  session.endOfPoses();
  const auto rest = session.step();
  ASSERT_TRUE(rest);
  EXPECT_TRUE(rest->only_backlog);
  EXPECT_EQ(rest->stamp_ns, stampOf(scans.size() - 1));
  EXPECT_FALSE(rest->changed.empty());
  expected.update();
  expectSameField(session.field(), expected);
  EXPECT_FALSE(session.step());
  options.update_every = 0;
  EXPECT_THROW(LiveSession(test::armTool(), coarseParams(), options), InvalidArgument);
}

/// Drivers write (0,0,0) for "no return" into clouds in the world frame, too: a third of a real frame. As returns at
/// the world's origin they would free the space between it and the sensor.
TEST(LiveChoices, NoReturnStaysOneInRegisteredClouds) {
  const std::vector<Scan> scans = test::wallScans(3, 6, 300);
  for (const bool tilted : {false, true}) {
    LiveOptions options;
    if (tilted) options.level = io::Level{false, 0.3, -0.2};
    LiveSession with(test::armTool(), coarseParams(), options), without(test::armTool(), coarseParams(), options);
    for (std::size_t n = 0; n < scans.size(); ++n) {
      LivePose pose = poseOf(scans[n], n);
      pose.frame = "map";
      LiveScan cloud = scanOf(scans[n], n);
      cloud.frame = "map";
      for (const Eigen::Vector3f& p_S : cloud.points) {
        if (!p_S.isZero(0)) cloud.points_double.emplace_back(sentPose(pose) * p_S.cast<double>());
      }
      cloud.points.clear();
      LiveScan padded = cloud;
      const std::size_t returns = cloud.points_double.size();
      for (std::size_t k = 0; k < returns / 2; ++k) padded.points_double.emplace_back(0, 0, 0);
      const auto step = [&](LiveSession& session, LiveScan scan) {
        session.addPose(pose);
        session.addScan(std::move(scan));
        return session.step();
      };
      const auto of_padded = step(with, std::move(padded)), of_cloud = step(without, std::move(cloud));
      ASSERT_TRUE(of_padded && of_cloud);
      EXPECT_EQ(of_padded->fused.points_used, of_cloud->fused.points_used);
      EXPECT_EQ(of_padded->fused.dropped[static_cast<std::size_t>(DropReason::NoReturn)], returns / 2);
    }
    expectSameField(with.field(), without.field());
    EXPECT_GT(with.field().snapshot().points.size(), 100U);
  }
}

TEST(LiveChoices, WhatIsRemovedIsAsInAFieldThatIsFedDirectly) {
  const std::vector<Scan> scans = test::wallScans(3, 6, 300);
  LiveSession session(test::armTool(), coarseParams());
  AccessibilityField expected(test::armTool(), coarseParams());
  const auto feed = [&](std::size_t n) {
    session.addPose(poseOf(scans[n], n));
    session.addScan(scanOf(scans[n], n));
    EXPECT_TRUE(session.step());
    expected.integrateScan(scans[n].points_S, sentPose(poseOf(scans[n], n)));
    expected.update();
  };
  for (std::size_t n = 0; n < 4; ++n) feed(n);
  const Eigen::Vector3d middle_W = expected.snapshot().points[20].position_W;
  const Region box = Region::box(middle_W.array() - 0.3, middle_W.array() + 0.3);
  const FieldSnapshot before = session.field().snapshot();
  const LiveRemoval removal = session.removeRegion(box, RemovedAs::Free);
  EXPECT_EQ(removal.removal.voxels, expected.removeRegion(box, RemovedAs::Free).voxels);
  expected.update();
  expectSameField(session.field(), expected);
  std::size_t changed = 0;
  const FieldSnapshot after = session.field().snapshot();
  for (std::size_t n = 0; n < after.points.size(); ++n)
    changed += test::sameVerdict(before.points[n], after.points[n]) ? 0 : 1;
  EXPECT_GE(changed, removal.changed.size());
  EXPECT_GT(removal.changed.size(), 5U);
  for (std::size_t n = 4; n < scans.size(); ++n) feed(n);
  expectSameField(session.field(), expected);
  EXPECT_THROW(static_cast<void>(session.removeRegion(Region::box({90, 90, 90}, {91, 91, 91}))), UnusableInput);
}

TEST(LiveChoices, AResetForgetsTheMapAndTakesEarlierTimes) {
  const std::vector<Scan> scans = test::wallScans(3, 6, 300);
  for (const bool several : {false, true}) {
    LiveSession session =
        several ? LiveSession(twoTools(), coarseParams()) : LiveSession(test::armTool(), coarseParams());
    LiveSession fresh =
        several ? LiveSession(twoTools(), coarseParams()) : LiveSession(test::armTool(), coarseParams());
    const auto feed = [&](LiveSession& to, std::size_t n) {
      to.addPose(poseOf(scans[n], n));
      to.addScan(scanOf(scans[n], n));
    };
    for (std::size_t n = 2; n < 5; ++n) feed(session, n);
    EXPECT_EQ(stepAll(session), 3U);
    feed(session, 5);                 // waits for its turn
    session.addScan({stampOf(500)});  // waits for a pose, long after those that come again
    session.reset();
    EXPECT_EQ(session.field().snapshot().points.size(), 0U);
    EXPECT_EQ(session.status().resets, 1U);
    EXPECT_EQ(session.status().waiting, 0U);
    EXPECT_EQ(stepAll(session), 0U);
    for (std::size_t n = 0; n < 3; ++n) {
      feed(session, n);
      feed(fresh, n);
      const auto step = session.step(), expected = fresh.step();
      ASSERT_TRUE(step && expected);
      EXPECT_EQ(step->changed.size(), expected->changed.size());
    }
    expectSameField(session.field(), fresh.field());
    expectAllAccountedFor(session.status());
    EXPECT_EQ(droppedFor(session, ScanDrop::Reset), 2U);
    EXPECT_EQ(session.status().allDropped(), 2U);
  }
}

TEST(LiveChoices, WhatComesWhileItIsPausedIsCountedAndNotSeen) {
  const std::vector<Scan> scans = test::wallScans(3, 6, 300);
  LiveSession session(test::armTool(), coarseParams());
  for (std::size_t n = 0; n < scans.size(); ++n) {
    session.pause(n == 2 || n == 3);
    session.addPose(poseOf(scans[n], n));
    session.addScan(scanOf(scans[n], n));
    EXPECT_EQ(session.status().paused, n == 2 || n == 3);
    EXPECT_EQ(session.step().has_value(), n != 2 && n != 3);
  }
  EXPECT_EQ(droppedFor(session, ScanDrop::Paused), 2U);
  EXPECT_EQ(session.status().left_out_returns, 0U);
  expectAllAccountedFor(session.status());
  expectSameField(session.field(), fedDirectly(scans, {0, 1, 4, 5}));
}

/// The odometry's frame is tilted by angles, and so are its poses and registered clouds; the map is as if it were not.
class LiveLevelling : public ::testing::Test {
 protected:
  static constexpr double kRoll = 0.3, kPitch = -0.2;
  const Eigen::Matrix3d R_L_W_ =
      (Eigen::AngleAxisd(kPitch, Eigen::Vector3d::UnitY()) * Eigen::AngleAxisd(kRoll, Eigen::Vector3d::UnitX()))
          .toRotationMatrix();
  const std::vector<Scan> scans_ = test::wallScans(3, 5, 300);

  [[nodiscard]] LivePose tilted(std::size_t n) const {
    LivePose pose = poseOf(scans_[n], n);
    pose.p_W = R_L_W_.transpose() * pose.p_W;
    pose.q_W_B = Eigen::Quaterniond(R_L_W_.transpose() * scans_[n].T_W_S.linear());
    pose.frame = "odom";
    return pose;
  }
  [[nodiscard]] LiveScan registered(std::size_t n) const {
    LiveScan scan;
    scan.stamp_ns = stampOf(n);
    scan.frame = "odom";
    for (const Eigen::Vector3f& p : scans_[n].points_S)
      scan.points_double.emplace_back(R_L_W_.transpose() * (scans_[n].T_W_S * p.cast<double>().eval()));
    return scan;
  }
  /// Coordinates are turned there and back: rounded, so that a few returns may lie in another voxel.
  void expectAsLevel(const LiveSession& session) const {
    const AccessibilityField level = fedDirectly(scans_, upTo(scans_.size()));
    const FieldSnapshot got = session.field().snapshot(), wanted = level.snapshot();
    const auto count = static_cast<double>(wanted.points.size());
    EXPECT_NEAR(static_cast<double>(got.points.size()), count, 0.01 * count);
    EXPECT_NEAR(static_cast<double>(got.count(PointLabel::Accessible)),
                static_cast<double>(wanted.count(PointLabel::Accessible)), 0.02 * count);
    for (std::size_t n = 0; n < std::min<std::size_t>(5, wanted.points.size()); ++n)
      EXPECT_LT((got.points[n].position_W - wanted.points[n].position_W).norm(), 1e-5);
  }
  /// At 200 Hz from a second before the first scan on, when the platform stands where the first scan is.
  void sendRest(LiveSession& session, const Eigen::Vector3d& shake = Eigen::Vector3d::Zero(),
                const std::string& frame = "imu") const {
    for (int i = 0; i <= 210; ++i) {
      const std::int64_t stamp_ns = stampOf(0) - 1'050'000'000 + i * 5'000'000;
      LivePose pose = tilted(0);
      pose.stamp_ns = stamp_ns;
      if (i < 210) session.addPose(pose);
      LiveImu imu;
      imu.stamp_ns = stamp_ns;
      imu.frame = frame;
      imu.force = pose.q_W_B.inverse() * (R_L_W_.transpose() * Eigen::Vector3d(0, 0, 9.81));
      if (i % 2 == 0) imu.force += shake;
      session.addImu(imu);
    }
  }
};

TEST_F(LiveLevelling, ByAngles) {
  for (const bool registered_clouds : {false, true}) {
    LiveOptions options;
    options.level = io::Level{false, kRoll, kPitch};
    LiveSession session(test::armTool(), coarseParams(), options);
    for (std::size_t n = 0; n < scans_.size(); ++n) {
      session.addPose(tilted(n));
      session.addScan(registered_clouds ? registered(n) : scanOf(scans_[n], n));
      ASSERT_TRUE(session.step());
    }
    ASSERT_TRUE(session.levelling());
    EXPECT_LT((*session.levelling() - R_L_W_).norm(), 1e-12);
    expectAsLevel(session);
  }
}

TEST_F(LiveLevelling, ByWhatTheImuFeels) {
  LiveOptions options;
  options.level = io::Level{.from_imu = true};
  LiveSession session(test::armTool(), coarseParams(), options);
  session.addScan(scanOf(scans_[0], 0));
  session.addPose(tilted(0));
  EXPECT_FALSE(session.waitForWork(std::chrono::milliseconds(0)));
  EXPECT_FALSE(session.step()) << "it is not known yet what is up";
  EXPECT_TRUE(session.status().waits_for_level);
  sendRest(session);
  for (std::size_t n = 1; n < scans_.size(); ++n) {
    session.addPose(tilted(n));
    session.addScan(scanOf(scans_[n], n));
    EXPECT_TRUE(session.waitForWork(std::chrono::milliseconds(0)));
  }
  EXPECT_EQ(stepAll(session), scans_.size());
  EXPECT_FALSE(session.status().waits_for_level);
  ASSERT_TRUE(session.levelling());
  // By the smallest turn, which may leave a yaw: up is up.
  const Eigen::Vector3d up_W = R_L_W_.transpose() * Eigen::Vector3d::UnitZ();
  EXPECT_LT((*session.levelling() * up_W - Eigen::Vector3d::UnitZ()).norm(), 1e-9);
}

/// Of a map that goes on: up is what it was, with no IMU, and no other up is taken.
TEST_F(LiveLevelling, AsItWasFoundBefore) {
  const io::Level imu{.from_imu = true}, angles{false, kRoll, kPitch}, others{false, kRoll, 0};
  for (const std::optional<io::Level>& level :
       {std::optional(imu), std::optional(angles), std::optional<io::Level>()}) {
    const test::ScratchFolder scratch;
    LiveOptions options;
    options.level = level;
    options.rolling = RollingOptions{.folder = scratch / "tiles"};
    std::optional<Eigen::Matrix3d> before;
    {
      LiveSession session(test::armTool(), coarseParams(), options);
      session.addScan(scanOf(scans_[0], 0));
      sendRest(session);
      session.addPose(tilted(0));
      ASSERT_EQ(stepAll(session), 1U);
      before = session.levelling();
      ASSERT_EQ(before.has_value(), level.has_value());
      session.rolling()->checkpoint();
    }
    options.resume = true;
    {
      LiveSession session(test::armTool(), coarseParams(), options);
      EXPECT_FALSE(session.status().waits_for_level);
      EXPECT_TRUE(session.levelling() == before);
      for (std::size_t n = 1; n < scans_.size(); ++n) {
        session.addPose(tilted(n));
        session.addScan(scanOf(scans_[n], n));
        ASSERT_TRUE(session.step());
      }
      session.rolling()->checkpoint();
    }
    EXPECT_TRUE(LiveSession(test::armTool(), coarseParams(), options).levelling() == before) << "twice";
    options.level = level ? std::optional(others) : std::optional(imu);
    try {
      const LiveSession session(test::armTool(), coarseParams(), options);
      ADD_FAILURE() << "turned otherwise";
    } catch (const UnusableInput& error) {
      EXPECT_EQ(error.id(), "rolling.changed");
    }
  }
}

/// A transform that comes late is waited for; without one, after ten seconds, it is said that there is none.
TEST_F(LiveLevelling, AnImuThatNothingConnectsYetIsNotTakenForWhatIsPosed) {
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitX()));
  for (const bool comes : {true, false}) {
    LiveOptions options;
    options.level = io::Level{.from_imu = true};
    LiveSession session(test::armTool(), coarseParams(), options);
    const auto pose = [&](std::int64_t ms) {
      LivePose one = tilted(0);
      one.stamp_ns = stampOf(0) + ms * 1'000'000;
      one.child = "body";
      session.addPose(one);
      return one.q_W_B;
    };
    for (std::int64_t ms = -1500; ms <= 3000; ms += 10) {
      LiveImu imu;
      imu.stamp_ns = stampOf(0) + ms * 1'000'000;
      imu.frame = "/imu";
      const Eigen::Quaterniond q_W_B = pose(ms);
      imu.force = (comes ? turn.inverse() : Eigen::Quaterniond::Identity()) * q_W_B.inverse() *
                  (R_L_W_.transpose() * Eigen::Vector3d(0, 0, 9.81));
      session.addImu(imu);
    }
    session.addScan(scanOf(scans_[0], 0));
    EXPECT_FALSE(session.waitForWork(std::chrono::milliseconds(0)));
    EXPECT_FALSE(session.step());
    EXPECT_FALSE(session.levelling());
    EXPECT_EQ(session.status().unconnected_imu, "");
    if (comes) {
      session.addTransform({0, "body", "imu", {0, 0, 0}, turn, true});
    } else {
      pose(8400);
      EXPECT_FALSE(session.step());
      pose(8600);
    }
    EXPECT_TRUE(session.waitForWork(std::chrono::milliseconds(0)));
    EXPECT_TRUE(session.step());
    ASSERT_TRUE(session.levelling());
    const Eigen::Vector3d up_W = R_L_W_.transpose() * Eigen::Vector3d::UnitZ();
    EXPECT_LT((*session.levelling() * up_W - Eigen::Vector3d::UnitZ()).norm(), 1e-9);
    EXPECT_EQ(session.status().unconnected_imu, comes ? "" : "imu");
  }
}

/// Squares of such numbers are infinite, and so would be what they are compared with.
TEST_F(LiveLevelling, WhatNoImuMeasuresIsNotUsed) {
  LiveOptions options;
  options.level = io::Level{.from_imu = true};
  LiveSession session(test::armTool(), coarseParams(), options);
  for (int i = 0; i <= 210; ++i) {
    for (const double force : {1e200, 1e308, 1500.0, -std::numeric_limits<double>::infinity()}) {
      LiveImu imu;
      imu.stamp_ns = stampOf(0) - 1'050'000'000 + i * 5'000'000;
      imu.force = Eigen::Vector3d(force, 0, force);
      session.addImu(imu);
    }
  }
  sendRest(session);
  session.addPose(tilted(0));
  session.addScan(scanOf(scans_[0], 0));
  EXPECT_EQ(stepAll(session), 1U);
  ASSERT_TRUE(session.levelling());
  const Eigen::Vector3d up_W = R_L_W_.transpose() * Eigen::Vector3d::UnitZ();
  EXPECT_LT((*session.levelling() * up_W - Eigen::Vector3d::UnitZ()).norm(), 1e-9);
  // Of recordings: what is not finite is not at rest.
  EXPECT_FALSE(io::upByForce(std::vector<Eigen::Vector3d>(30, {1e200, 0, 1e200})));
  EXPECT_FALSE(io::upByForce(std::vector<Eigen::Vector3d>(30, {1e308, 0, 1e308})));
}

TEST_F(LiveLevelling, AnImuThatIsNotAtRestOrThatIsNotThereIsSaid) {
  const auto errorOf = [](LiveSession& session) -> std::string {
    try {
      static_cast<void>(session.step());
    } catch (const UnusableInput& error) {
      return error.id();
    }
    return "";
  };
  LiveOptions options;
  options.level = io::Level{.from_imu = true};
  LiveSession moving(test::armTool(), coarseParams(), options);
  moving.addScan(scanOf(scans_[0], 0));
  sendRest(moving, {4, 0, 0});
  moving.addPose(tilted(0));
  EXPECT_EQ(errorOf(moving), "level.moving");
  LiveSession without(test::armTool(), coarseParams(), options);
  without.addScan(scanOf(scans_[0], 0));
  without.addPose(tilted(0));
  EXPECT_EQ(errorOf(without), "");
  without.endOfPoses();
  EXPECT_EQ(errorOf(without), "level.no_imu");
  EXPECT_EQ(without.status().waiting, 1U);
}

}  // namespace
}  // namespace accessvdb::live_test

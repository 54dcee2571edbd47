// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Transforms of a stream: where the sensor is on what is posed, by the rules of recordings, and what is not believed.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "live/live_stream.h"
#include "support/same_map.h"

namespace accessvdb::live_test {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

const Vector3d kLidarOnBody(0.25, 0, -0.5);
const Eigen::Quaterniond kUnturned = Eigen::Quaterniond::Identity();
const Eigen::Quaterniond kTurn(Eigen::AngleAxisd(M_PI / 2, Vector3d::UnitZ()));

LivePose bodyPose(const Scan& scan, std::size_t n) {
  LivePose pose = poseOf(scan, n);
  pose.frame = "odom";
  pose.child = "body";
  return pose;
}
LiveScan lidarScan(const Scan& scan, std::size_t n, const char* frame = "lidar") {
  LiveScan sent = scanOf(scan, n);
  sent.frame = frame;
  return sent;
}
LiveTransform fixedLidar(const char* parent = "body", const char* child = "lidar") {
  return {0, parent, child, kLidarOnBody, kTurn, true};
}
Isometry3d lidarOnBody() {
  Isometry3d T = Isometry3d::Identity();
  T.linear() = kTurn.normalized().toRotationMatrix();
  T.translation() = kLidarOnBody;
  return T;
}
AccessibilityField fedOn(const std::vector<Scan>& scans, const Isometry3d& T_B_S) {
  AccessibilityField field(test::armTool(), coarseParams());
  for (std::size_t n = 0; n < scans.size(); ++n) {
    field.integrateScan(scans[n].points_S, sentPose(poseOf(scans[n], n)) * T_B_S);
    field.update();
  }
  return field;
}

class LiveTransforms : public ::testing::Test {
 protected:
  const std::vector<Scan> scans_ = test::wallScans(3, 5, 300);
  const AccessibilityField expected_ = fedOn(scans_, lidarOnBody());
  LiveSession session_{test::armTool(), coarseParams()};

  void send(std::size_t n) {
    session_.addScan(lidarScan(scans_[n], n));
    session_.addPose(bodyPose(scans_[n], n));
  }
  void sendAll() {
    for (std::size_t n = 0; n < scans_.size(); ++n) send(n);
  }
  void expectAsExpected() {
    EXPECT_EQ(session_.status().taken, scans_.size());
    expectAllAccountedFor(session_.status());
    expectSameField(session_.field(), expected_);
  }
};

TEST_F(LiveTransforms, SayWhereTheSensorIs) {
  session_.addTransform(fixedLidar());
  for (std::size_t n = 0; n < scans_.size(); ++n) {
    send(n);
    ASSERT_TRUE(session_.step());
  }
  expectAsExpected();
  const LiveStatus status = session_.status();
  EXPECT_EQ(status.sensor_chain, "odom -> body -> lidar");
  EXPECT_NEAR(status.extrinsic_m, kLidarOnBody.norm(), 1e-12);
  EXPECT_EQ(status.transforms, 1U);
}

/// A transform that is none connects nothing: it neither settles a scan nor takes the place of the right one.
TEST_F(LiveTransforms, ThatAreNoPoseConnectNothing) {
  const double none = std::numeric_limits<double>::quiet_NaN();
  LiveTransform odd = fixedLidar("elsewhere"), unturned = fixedLidar(), moving = fixedLidar();
  odd.p.x() = none;
  unturned.q = Eigen::Quaterniond(2, 0, 0, 0);
  moving.fixed = false;
  moving.stamp_ns = std::numeric_limits<std::int64_t>::max();
  for (const LiveTransform& bad : {odd, unturned, moving}) session_.addTransform(bad);
  EXPECT_EQ(session_.status().transforms_invalid, 3U);
  sendAll();
  EXPECT_FALSE(session_.step()) << "the right one may come";
  EXPECT_EQ(session_.status().waiting, scans_.size());
  session_.addTransform(fixedLidar());
  EXPECT_EQ(stepAll(session_), scans_.size());
  EXPECT_EQ(session_.status().transforms_other_parent, 0U);
  test::expectSameMap(session_.field().volume(), expected_.volume());
}

/// They come once, and late: scans wait for them.
TEST_F(LiveTransforms, MayComeLateAndWithSlashes) {
  for (std::size_t n = 0; n < scans_.size(); ++n) {
    LiveScan scan = lidarScan(scans_[n], n, "/lidar");
    LivePose pose = bodyPose(scans_[n], n);
    pose.frame = "/odom";
    pose.child = "/body";
    session_.addScan(std::move(scan));
    session_.addPose(pose);
    EXPECT_FALSE(session_.step());
  }
  EXPECT_EQ(session_.status().waiting, scans_.size());
  session_.addTransform(fixedLidar("/body", "/lidar"));
  EXPECT_TRUE(session_.waitForWork(std::chrono::milliseconds(0)));
  // The first are fused only, since more than four waited: the points are the same, and the labels of the last step.
  EXPECT_EQ(stepAll(session_), scans_.size());
  EXPECT_EQ(session_.status().world_frame, "odom");
  test::expectSameMap(session_.field().volume(), expected_.volume());
}

TEST_F(LiveTransforms, AreMultipliedAlongTheWayAndInterpolated) {
  // body -> arm moves up from 0 to 1 m while scan 0 is at half of it; arm -> lidar is fixed.
  session_.addTransform({0, "arm", "lidar", Vector3d::Zero(), kTurn, true});
  session_.addScan(lidarScan(scans_[0], 0));
  session_.addPose(bodyPose(scans_[0], 0));
  session_.addTransform(
      {stampOf(0) - 50'000'000, "body", "arm", kLidarOnBody - Vector3d(0, 0, 0.25), kUnturned, false});
  EXPECT_FALSE(session_.step()) << "nobody knows yet where the arm is at that time";
  session_.addTransform(
      {stampOf(0) + 50'000'000, "body", "arm", kLidarOnBody + Vector3d(0, 0, 0.25), kUnturned, false});
  ASSERT_TRUE(session_.step());
  EXPECT_EQ(session_.status().sensor_chain, "odom -> body -> arm -> lidar");
  expectSameField(session_.field(), fedOn({scans_[0]}, lidarOnBody()));
}

TEST_F(LiveTransforms, AnExtrinsicIsUsedInstead) {
  LiveOptions options;
  options.T_B_S = lidarOnBody();
  session_ = LiveSession(test::armTool(), coarseParams(), options);
  session_.addTransform({0, "body", "lidar", Vector3d(7, 7, 7), kUnturned, true});
  for (std::size_t n = 0; n < scans_.size(); ++n) {
    send(n);
    ASSERT_TRUE(session_.step());
  }
  expectAsExpected();
  EXPECT_EQ(session_.status().sensor_chain, "");
}

/// What is not believed: a second parent, a circle, other poses of what the odometry poses or is in, names that are
/// none, numbers that are none. Nothing else changes.
TEST_F(LiveTransforms, GarbageIsCountedAndChangesNothing) {
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  const auto garbage = [&] {
    session_.addTransform({0, "map", "lidar", Vector3d(1, 2, 3), kUnturned, true});     // a second parent
    session_.addTransform({0, "lidar", "lidar", Vector3d(1, 2, 3), kUnturned, true});   // its own
    session_.addTransform({0, "lidar", "odom", Vector3d(1, 2, 3), kUnturned, true});    // a circle
    session_.addTransform({0, "nowhere", "body", Vector3d(1, 2, 3), kUnturned, true});  // the odometry says that
    session_.addTransform({0, "odom", "body", Vector3d(9, 9, 9), kUnturned, true});
    session_.addTransform({stampOf(1), "odom", "body", Vector3d(9, 9, 9), kUnturned, false});
    session_.addTransform({0, "body", "lidar", Vector3d(kNone, 0, 0), kUnturned, true});
    session_.addTransform({0, "body", "lidar", Vector3d::Zero(), Eigen::Quaterniond(0, 0, 0, 0), true});
    session_.addTransform({0, "", "lidar", Vector3d::Zero(), kUnturned, true});
    session_.addTransform({0, "body", std::string(100'000, 'x'), Vector3d::Zero(), kUnturned, true});
    // A frame that was fixed does not move.
    session_.addTransform({stampOf(2), "body", "lidar", Vector3d(5, 5, 5), kUnturned, false});
  };
  session_.addTransform(fixedLidar());
  for (std::size_t n = 0; n < scans_.size(); ++n) {
    garbage();
    send(n);
    ASSERT_TRUE(session_.step());
  }
  expectAsExpected();
  const LiveStatus status = session_.status();
  EXPECT_EQ(status.transforms, 1 + 11 * scans_.size());
  EXPECT_EQ(status.transforms_invalid, 4 * scans_.size());
  EXPECT_GE(status.transforms_other_parent, 2 * scans_.size());
}

/// Names and poses come from whoever can send: memory is bounded, and what was known before stays.
TEST_F(LiveTransforms, FloodsOfFramesAndPosesAreBounded) {
  session_.addTransform(fixedLidar());
  send(0);
  ASSERT_TRUE(session_.step());
  for (int frame = 0; frame < 3000; ++frame)
    session_.addTransform({stampOf(0), "body", "frame_" + std::to_string(frame), Vector3d::Zero(), kUnturned, false});
  EXPECT_GE(session_.status().transforms_other_parent, 2000U);
  for (std::int64_t n = 0; n < 200'000; ++n)
    session_.addTransform(
        {stampOf(0) + n, "body", "frame_" + std::to_string(n % 900), Vector3d::Zero(), kUnturned, false});
  for (std::size_t n = 1; n < scans_.size(); ++n) {
    send(n);
    ASSERT_TRUE(session_.step());
  }
  expectAsExpected();
}

TEST_F(LiveTransforms, AFrameThatNothingConnectsIsDroppedAndKeepsNobodyWaiting) {
  // Before any scan was taken it waits, for ten seconds by the poses' times.
  session_.addScan(lidarScan(scans_[0], 0));
  session_.addPose(bodyPose(scans_[0], 0));
  LivePose later = bodyPose(scans_[1], 1);
  later.stamp_ns = stampOf(0) + 9'000'000'000;
  session_.addPose(later);
  EXPECT_FALSE(session_.step());
  EXPECT_EQ(session_.status().waiting, 1U);
  later.stamp_ns = stampOf(0) + 10'100'000'000;
  session_.addPose(later);
  EXPECT_FALSE(session_.step());
  EXPECT_EQ(droppedFor(session_, ScanDrop::NoPose), 1U);
  EXPECT_EQ(session_.status().unconnected_frame, "lidar");
  // Afterwards it does not.
  session_ = LiveSession(test::armTool(), coarseParams());
  session_.addTransform(fixedLidar());
  send(0);
  ASSERT_TRUE(session_.step());
  session_.addScan(lidarScan(scans_[1], 1, "elsewhere"));
  session_.addPose(bodyPose(scans_[1], 1));
  EXPECT_FALSE(session_.step());
  EXPECT_EQ(droppedFor(session_, ScanDrop::NoPose), 1U);
  EXPECT_EQ(session_.status().unconnected_frame, "elsewhere");
}

/// Poses that do not say whose they are, and scans that do not say in which frame: as without transforms.
TEST_F(LiveTransforms, AreNotNeededWhereNamesAreNotGiven) {
  const AccessibilityField plain = fedOn(scans_, Isometry3d::Identity());
  for (const bool by_pose : {false, true}) {
    session_ = LiveSession(test::armTool(), coarseParams());
    session_.addTransform(fixedLidar());
    for (std::size_t n = 0; n < scans_.size(); ++n) {
      LivePose pose = bodyPose(scans_[n], n);
      if (by_pose) pose.child.clear();
      session_.addScan(by_pose ? lidarScan(scans_[n], n) : scanOf(scans_[n], n));
      session_.addPose(pose);
      ASSERT_TRUE(session_.step());
    }
    expectSameField(session_.field(), plain);
  }
  // Poses of another frame than the first are not used.
  LivePose other = bodyPose(scans_[0], 9);
  other.child = "wheel";
  session_.addPose(other);
  EXPECT_EQ(session_.status().poses_other_frame, 1U);
}

}  // namespace
}  // namespace accessvdb::live_test

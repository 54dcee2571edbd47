// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Messages to and from the middleware, without it.
#include <gtest/gtest.h>

#include <cstring>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <random>

#include "bags/messages.h"
#include "dds/cdr_writer.h"
#include "dds/incoming_messages.h"
#include "dds/outgoing_messages.h"
#include "dds/participant.h"

namespace accessvdb::dds {
namespace {

TEST(LiveMessages, NamesAreThoseOfRos) {
  EXPECT_EQ(rosType("sensor_msgs::msg::dds_::PointCloud2_"), "sensor_msgs/PointCloud2");
  EXPECT_EQ(rosType("livox_ros_driver2::msg::dds_::CustomMsg_"), "livox_ros_driver2/CustomMsg");
  for (const char* other : {"", "_", "PointCloud2", "::msg::dds_::", "a::msg::dds_::B"})
    EXPECT_EQ(rosType(other), other);
  EXPECT_EQ(ddsTopic("/livox/lidar"), "rt/livox/lidar");
}

/// Read as ROS 2 lays it out, by offset: numbers are aligned to their size from the fifth byte on.
TEST(LiveMessages, PublishedPosesAreAPoseArray) {
  Eigen::Isometry3d T_WT = Eigen::Isometry3d::Identity();
  T_WT.translation() = Eigen::Vector3d(1, 2, 3);
  T_WT.linear() = Eigen::AngleAxisd(0.5, Eigen::Vector3d(1, 2, 2) / 3).toRotationMatrix();
  const Eigen::Matrix3d R_L_W = Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitX()).toRotationMatrix();
  for (const char* frame : {"odom", "a_longer_frame"}) {
    for (const bool level : {false, true}) {
      const std::vector<Eigen::Isometry3d> poses = {Eigen::Isometry3d::Identity(), T_WT};
      const OutgoingFrame outgoing = {frame, level ? std::optional(R_L_W) : std::nullopt};
      const std::string cdr = posesMessage(poses, 1'700'000'000'123'456'789, outgoing);
      std::size_t at = 4;
      const auto read = [&](auto value) {
        at += (sizeof value - (at - 4) % sizeof value) % sizeof value;
        std::memcpy(&value, cdr.data() + at, sizeof value);
        at += sizeof value;
        return value;
      };
      EXPECT_EQ(read(std::int32_t{}), 1'700'000'000);
      EXPECT_EQ(read(std::uint32_t{}), 123'456'789U);
      const auto length = read(std::uint32_t{});
      EXPECT_EQ(cdr.substr(at, length - 1), frame);
      at += length;
      ASSERT_EQ(read(std::uint32_t{}), 2U);
      for (const Eigen::Isometry3d& pose : poses) {
        Eigen::Vector3d p;
        for (int axis = 0; axis < 3; ++axis) p[axis] = read(double{});
        Eigen::Quaterniond q;
        for (int n = 0; n < 4; ++n) q.coeffs()[n] = read(double{});  // x y z w
        const Eigen::Matrix3d back = level ? Eigen::Matrix3d(R_L_W.transpose()) : Eigen::Matrix3d::Identity();
        EXPECT_LT((p - back * pose.translation()).norm(), 1e-12);
        EXPECT_LT((q.toRotationMatrix() - back * pose.linear()).norm(), 1e-12);
      }
      EXPECT_EQ(at, cdr.size());
    }
  }
}

/// What is published is a cloud for whoever reads clouds of ROS 2; the fields beside x, y and z are read by offset
/// here, and by Cyclone DDS in the tests of the program.
TEST(LiveMessages, PublishedCloudsAreCloudsOfRos) {
  std::vector<SurfacePoint> points(3);
  for (std::size_t n = 0; n < points.size(); ++n) {
    points[n].id = static_cast<std::uint32_t>(100 + n);
    points[n].position_W = Eigen::Vector3d(1.5, -2.25, 0.5 * static_cast<double>(n));
    points[n].direction_W = Eigen::Vector3f(0, -1, 0);
    points[n].label = static_cast<PointLabel>(n);
    points[n].reason = static_cast<PointReason>(6 - n);
    points[n].score = static_cast<std::uint16_t>(300 + n);
    points[n].confidence = 0.25F;
    points[n].access_probability = 0.5F;
  }
  for (const char* frame : {"", "odom", "a_longer_frame"}) {
    const std::string cdr = cloudMessage(points, 1'700'000'000'123'456'789, {frame});
    const bags::CloudMessage cloud = bags::readCloud(bags::MessageKind::PointCloud2, cdr, bags::Wire::Cdr);
    EXPECT_EQ(cloud.header.stamp_ns, 1'700'000'000'123'456'789);
    EXPECT_EQ(cloud.header.frame, frame);
    ASSERT_EQ(cloud.points(), points.size());
    ASSERT_EQ(cloud.data.size(), points.size() * kPointBytes);
    std::vector<Eigen::Vector3f> xyz;
    bags::appendPoints(cloud, xyz);
    for (std::size_t n = 0; n < points.size(); ++n) {
      EXPECT_EQ(xyz[n], points[n].position_W.cast<float>());
      const char* point = cloud.data.data() + n * kPointBytes;
      const auto read = [&](auto value, std::size_t offset) {
        std::memcpy(&value, point + offset, sizeof value);
        return value;
      };
      EXPECT_EQ(read(std::uint32_t{}, 16), points[n].id);
      EXPECT_EQ(read(std::uint8_t{}, 20), n);
      EXPECT_EQ(read(std::uint8_t{}, 21), 6 - n);
      EXPECT_EQ(read(std::uint16_t{}, 22), 300 + n);
      EXPECT_EQ(read(0.0F, 24), 0.25F);
      EXPECT_EQ(read(0.0F, 32), -1.0F);
      EXPECT_EQ(read(0.0F, 40), 0.5F);
    }
    EXPECT_EQ(cdr.back(), '\1');  // dense
  }
  const FieldSnapshot snapshot{points, {0, 0, 0}, 0.05};
  EXPECT_EQ(cloudMessage(SnapshotPoints(snapshot), 5, {"odom"}), cloudMessage(points, 5, {"odom"}));
}

/// Of several tools, in a map that was turned level by a quarter about x.
TEST(LiveMessages, PublishedCloudsSayWhichToolsAndAreInTheFrameOfTheOdometry) {
  std::vector<SurfacePoint> points(1);
  points[0].position_W = Eigen::Vector3d(1, 2, 3);
  points[0].direction_W = Eigen::Vector3f(0, 0, 1);
  points[0].tools = 0x80000005U;
  Eigen::Matrix3d R_L_W;
  R_L_W << 1, 0, 0, 0, 0, -1, 0, 1, 0;
  const std::string cdr = cloudMessage(points, 5, {"odom", R_L_W, true});
  const bags::CloudMessage cloud = bags::readCloud(bags::MessageKind::PointCloud2, cdr, bags::Wire::Cdr);
  ASSERT_EQ(cloud.data.size(), kPointBytes + kToolBytes);
  std::vector<Eigen::Vector3f> xyz;
  bags::appendPoints(cloud, xyz);
  EXPECT_EQ(xyz[0], Eigen::Vector3f(1, 3, -2));
  float direction[3];
  std::uint32_t tools = 0;
  std::memcpy(direction, cloud.data.data() + 28, sizeof direction);
  std::memcpy(&tools, cloud.data.data() + 44, sizeof tools);
  EXPECT_EQ(Eigen::Vector3f(direction), Eigen::Vector3f(0, 1, 0));
  EXPECT_EQ(tools, points[0].tools);
  EXPECT_NE(cdr.find("tools"), std::string::npos);
}

/// A pose with header and child as ROS 2 lays it out, by hand.
std::string odometry(const Eigen::Quaterniond& q) {
  CdrWriter message;
  message.number(std::int32_t{12});
  message.number(std::uint32_t{34});
  message.text("odom");
  message.text("body");
  for (const double value : {1.0, 2.0, 3.0, q.x(), q.y(), q.z(), q.w()}) message.number(value);
  return message.take();
}

TEST(LiveMessages, PosesAreRead) {
  const Eigen::Quaterniond q(0.5, 0.5, -0.5, 0.5);
  const LivePose pose = poseFrom(bags::MessageKind::Odometry, odometry(q));
  EXPECT_EQ(pose.stamp_ns, 12'000'000'034);
  EXPECT_EQ(pose.frame, "odom");
  EXPECT_EQ(pose.p_W, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(pose.q_W_B.coeffs(), q.coeffs());
}

TEST(LiveMessages, WhatAnImuFeelsAndTransformsAreRead) {
  CdrWriter imu;
  imu.number(std::int32_t{12});
  imu.number(std::uint32_t{34});
  imu.text("imu_link");
  for (int n = 0; n < 4 + 9 + 3 + 9; ++n) imu.number(100.0 + n);  // orientation, rates and their covariances
  for (const double value : {0.5, -0.25, 9.75}) imu.number(value);
  for (int n = 0; n < 9; ++n) imu.number(0.0);
  const LiveImu felt = imuFrom(imu.bytes());
  EXPECT_EQ(felt.stamp_ns, 12'000'000'034);
  EXPECT_EQ(felt.frame, "imu_link");
  EXPECT_EQ(felt.force, Eigen::Vector3d(0.5, -0.25, 9.75));

  CdrWriter tf;
  tf.number(std::uint32_t{1});
  tf.number(std::int32_t{5});
  tf.number(std::uint32_t{6});
  tf.text("/body");
  tf.text("lidar");
  for (const double value : {1.0, 2.0, 3.0, 0.0, 0.6, 0.0, 0.8}) tf.number(value);
  for (const bool fixed : {false, true}) {
    const std::vector<LiveTransform> transforms = transformsFrom(tf.bytes(), fixed);
    ASSERT_EQ(transforms.size(), 1U);
    EXPECT_EQ(transforms[0].stamp_ns, 5'000'000'006);
    EXPECT_EQ(transforms[0].parent, "body");
    EXPECT_EQ(transforms[0].child, "lidar");
    EXPECT_EQ(transforms[0].p, Eigen::Vector3d(1, 2, 3));
    EXPECT_EQ(transforms[0].q.coeffs(), Eigen::Vector4d(0, 0.6, 0, 0.8));
    EXPECT_EQ(transforms[0].fixed, fixed);
  }
  for (std::size_t n = 0; n < tf.bytes().size(); ++n)
    EXPECT_THROW(static_cast<void>(transformsFrom(tf.bytes().substr(0, n), true)), bags::MessageError) << n;
}

TEST(LiveMessages, TheLayoutsForViewersShowTheTopics) {
  for (const char* layout : {"accessvdb.rviz", "foxglove_layout.json"}) {
    std::ifstream in(std::string(ACCESSVDB_SOURCE_DIR) + "/tools/live/" + layout);
    const std::string text{std::istreambuf_iterator<char>(in), {}};
    const bool json = std::string(layout).ends_with(".json");
    EXPECT_EQ(json, nlohmann::json::accept(text)) << layout;
    for (const Output output : {Output::Points, Output::Changes, Output::Status}) {
      if (output == Output::Status && !json) continue;  // RViz shows no text
      EXPECT_NE(text.find(kOutputTopics[static_cast<int>(output)]), std::string::npos) << layout;
    }
  }
}

/// Cut off anywhere, and with any bytes in it: an error or a message, and no more points than the bytes can hold.
TEST(LiveMessages, BadBytesAreAnErrorOrAMessage) {
  std::vector<SurfacePoint> points(40);
  const std::string cloud = cloudMessage(points, 1'000, {"odom"}), pose = odometry(Eigen::Quaterniond::Identity());
  std::mt19937_64 random(3);
  int refused = 0, read = 0;
  const auto tryIt = [&](const std::string& bytes) {
    for (const bags::MessageKind kind : {bags::MessageKind::PointCloud2, bags::MessageKind::LivoxCustom}) {
      try {
        const LiveScan scan = scanFrom(kind, bytes);
        EXPECT_LE(scan.points.size(), bytes.size() / 12);
        EXPECT_LE(scan.points_double.size(), bytes.size() / 24);
        ++read;
      } catch (const bags::MessageError& error) {
        EXPECT_FALSE(error.id().empty());
        ++refused;
      }
    }
    try {
      static_cast<void>(poseFrom(bags::MessageKind::Odometry, bytes));
    } catch (const bags::MessageError&) {
    }
  };
  for (std::size_t n = 0; n <= cloud.size(); ++n) tryIt(cloud.substr(0, n));
  for (std::size_t n = 0; n < pose.size(); ++n)
    EXPECT_THROW(static_cast<void>(poseFrom(bags::MessageKind::Odometry, pose.substr(0, n))), bags::MessageError) << n;
  for (int n = 0; n < 20000; ++n) {
    std::string bytes = cloud;
    for (std::uint64_t hits = 1 + random() % 6; hits > 0; --hits) {
      const std::size_t at = random() % 320;  // where the sizes are
      bytes[at] = static_cast<char>(random() % 3 == 0 ? 0xFF : random());
    }
    tryIt(bytes);
  }
  EXPECT_GT(refused, 1000);
  EXPECT_GT(read, 1000);
}

}  // namespace
}  // namespace accessvdb::dds

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One bad message of a recording costs that message. Recordings are MCAP with messages of ROS 1, written here.
#include <cstring>
#include <functional>

#include "inputs/field_world.h"
#include "support/bytes.h"

namespace accessvdb::inputs_test {
namespace {

using test::put;

std::string counted(const std::string& text) {
  std::string bytes;
  put(bytes, static_cast<std::uint32_t>(text.size()));
  return bytes + text;
}
std::string record(char opcode, const std::string& content) {
  std::string bytes(1, opcode);
  put(bytes, std::uint64_t{content.size()});
  return bytes + content;
}

enum Channel : std::uint16_t { kClouds = 1, kOdometry = 2, kFixed = 3, kImu = 4 };

std::string channel(Channel id, const std::string& topic, const std::string& type) {
  std::string schema, channel;
  put(schema, static_cast<std::uint16_t>(id));
  put(channel, static_cast<std::uint16_t>(id));
  put(channel, static_cast<std::uint16_t>(id));
  return record(3, schema + counted(type) + counted("ros1msg") + counted("")) +
         record(4, channel + counted(topic) + counted("ros1") + counted(""));
}
std::string message(Channel id, double stamp_s, const std::string& data) {
  std::string content;
  put(content, static_cast<std::uint16_t>(id));
  put(content, std::uint32_t{0});
  const auto stamp_ns = static_cast<std::uint64_t>(stamp_s * 10 + 0.5) * 100'000'000;
  put(content, stamp_ns);
  put(content, stamp_ns);
  return record(5, content + data);
}
std::string header(double stamp_s, const std::string& frame) {
  const auto tenths = static_cast<std::uint64_t>(stamp_s * 10 + 0.5);
  std::string bytes;
  put(bytes, std::uint32_t{0});
  put(bytes, static_cast<std::uint32_t>(tenths / 10));
  put(bytes, static_cast<std::uint32_t>(tenths % 10 * 100'000'000));
  return bytes + counted(frame);
}
std::string cloud(const WorldScan& scan, double stamp_s, std::size_t missing_bytes = 0,
                  const std::string& frame = "lidar") {
  std::string points;
  for (const Eigen::Vector3d& p_S : scan.points_S())
    for (const double value : {p_S.x(), p_S.y(), p_S.z()}) put(points, static_cast<float>(value));
  const auto count = static_cast<std::uint32_t>(points.size() / 12);
  points.resize(points.size() - missing_bytes);
  std::string data = header(stamp_s, frame);
  put(data, std::uint32_t{1});
  put(data, count);
  put(data, std::uint32_t{3});
  for (std::uint32_t axis = 0; axis < 3; ++axis) {
    data += counted(std::string(1, "xyz"[axis]));
    put(data, 4 * axis);
    put(data, std::uint8_t{7});
    put(data, std::uint32_t{1});
  }
  put(data, std::uint8_t{0});
  put(data, std::uint32_t{12});
  put(data, 12 * count);
  data += counted(points);
  put(data, std::uint8_t{1});
  return message(kClouds, stamp_s, data);
}
std::string odometry(const WorldScan& scan, double stamp_s, double quaternion_length = 1) {
  const Eigen::Quaterniond q(scan.T_W_S.linear());
  const Eigen::Vector3d p = scan.T_W_S.translation();
  std::string data = header(stamp_s, "odom") + counted("base");
  for (const double value : {p.x(), p.y(), p.z()}) put(data, value);
  for (const double value : {q.x(), q.y(), q.z(), q.w()}) put(data, quaternion_length * value);
  for (int i = 0; i < 36 + 6 + 36; ++i) put(data, 0.0);
  return message(kOdometry, stamp_s, data);
}
std::string fixedTransform(double x_m) {
  std::string data;
  put(data, std::uint32_t{1});
  data += header(1700000000, "base") + counted("lidar");
  for (const double value : {x_m, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0}) put(data, value);
  return message(kFixed, 1700000000, data);
}
/// At rest, in the frame of what is posed.
std::string imu(const WorldScan& scan, double stamp_s) {
  constexpr double kGravity_m_s2 = 9.81;
  std::string data = header(stamp_s, "base");
  for (int i = 0; i < 4 + 9 + 3 + 9; ++i) put(data, i == 3 ? 1.0 : 0.0);
  const Eigen::Vector3d force = scan.T_W_S.linear().transpose() * Eigen::Vector3d(0, 0, kGravity_m_s2);
  for (const double value : {force.x(), force.y(), force.z()}) put(data, value);
  for (int i = 0; i < 9; ++i) put(data, 0.0);
  return message(kImu, stamp_s, data);
}
std::string recording(const std::string& messages) {
  const std::string magic("\x89MCAP0\r\n", 8);
  return magic + record(1, counted("ros1") + counted("")) + channel(kClouds, "/points", "sensor_msgs/PointCloud2") +
         channel(kOdometry, "/odom", "nav_msgs/Odometry") + channel(kFixed, "/tf_static", "tf2_msgs/TFMessage") +
         channel(kImu, "/imu", "sensor_msgs/Imu") + messages + record(15, std::string(4, '\0')) +
         record(2, std::string(20, '\0')) + magic;
}

class BadMessages : public InputTest {
 protected:
  /// @param messageOf  what stands in the recording for a scan; its odometry is apart
  [[nodiscard]] MapOutcome mapRecording(const std::function<std::string(const WorldScan&, int)>& messageOf,
                                        double quaternion_of_third = 1, double lidar_x_m = 0) const {
    std::string messages = fixedTransform(lidar_x_m);
    for (int i = 0; i < 8; ++i) {
      const WorldScan& scan = scans_[static_cast<std::size_t>(i)];
      messages += odometry(scan, scan.stamp_s, i == 3 ? quaternion_of_third : 1) + messageOf(scan, i);
    }
    writeBytes("flight.mcap", recording(messages));
    return map({"--scans", path("flight.mcap")});
  }
  void expectSame(const MapOutcome& outcome, const MapOutcome& other) const {
    expectRight(outcome);
    EXPECT_EQ(outcome.points, other.points) << outcome.program.err;
    EXPECT_EQ(outcome.accessible, other.accessible) << outcome.program.err;
  }
  static std::string whole(const WorldScan& scan, int) { return cloud(scan, scan.stamp_s); }
  static std::string withoutThird(const WorldScan& scan, int i) { return i == 3 ? "" : whole(scan, i); }

  const std::vector<WorldScan> scans_ = worldScans();
};

TEST_F(BadMessages, OfCloudsCostTheirCloud) {
  const MapOutcome all = mapRecording(whole), without = mapRecording(withoutThird);
  expectRight(all);
  EXPECT_EQ(all.program.err.find("warning["), std::string::npos) << all.program.err;
  EXPECT_NE(all.points, without.points);
  const MapOutcome damaged =
      mapRecording([](const WorldScan& scan, int i) { return cloud(scan, scan.stamp_s, i == 3 ? 5000 : 0); });
  expectSame(damaged, without);
  EXPECT_TRUE(damaged.warns("scans.skipped")) << damaged.program.err;
  EXPECT_NE(damaged.program.err.find("1 of 8 messages of /points"), std::string::npos) << damaged.program.err;
  EXPECT_TRUE(mapRecording([](const WorldScan& scan, int i) {
                return cloud(scan, scan.stamp_s, i > 3 ? 5000 : 0);
              }).fails("recording.message"));
  const MapOutcome elsewhere =
      mapRecording([](const WorldScan& scan, int i) { return cloud(scan, i == 3 ? 12.5 : scan.stamp_s); });
  expectSame(elsewhere, without);
  EXPECT_TRUE(elsewhere.warns("scans.skipped")) << elsewhere.program.err;
}

TEST_F(BadMessages, InAnotherFrameCostTheirCloud) {
  for (const int stray : {0, 3, 7}) {
    const auto without = mapRecording([&](const WorldScan& scan, int i) { return i == stray ? "" : whole(scan, i); });
    for (const char* frame : {"other", ""}) {
      const MapOutcome outcome = mapRecording(
          [&](const WorldScan& scan, int i) { return cloud(scan, scan.stamp_s, 0, i == stray ? frame : "lidar"); });
      expectSame(outcome, without);
      EXPECT_TRUE(outcome.warns("scans.skipped")) << outcome.program.err;
      EXPECT_NE(outcome.program.err.find("1 of 8 clouds of /points"), std::string::npos) << outcome.program.err;
    }
  }
  EXPECT_TRUE(mapRecording([](const WorldScan& scan, int i) {
                return cloud(scan, scan.stamp_s, 0, i > 3 ? "other" : "lidar");
              }).fails("recording.frames"));
  // A frame that is connected is one more sensor.
  EXPECT_FALSE(mapRecording([](const WorldScan& scan, int i) {
                 return cloud(scan, scan.stamp_s, 0, i == 3 ? "base" : "lidar");
               }).warns("scans.skipped"));
}

TEST_F(BadMessages, ThatAreThereTwiceCountOnce) {
  const MapOutcome once = mapRecording(whole);
  const MapOutcome twice = mapRecording(
      [](const WorldScan& scan, int i) { return i == 5 ? whole(scan, i) + whole(scan, i) : whole(scan, i); });
  expectSame(twice, once);
  EXPECT_TRUE(twice.warns("scans.repeated")) << twice.program.err;
}

TEST_F(BadMessages, OfPosesCostTheirPose) {
  const MapOutcome outcome = mapRecording(whole, 0);
  expectRight(outcome);
  EXPECT_TRUE(outcome.warns("poses.skipped")) << outcome.program.err;
}

TEST_F(BadMessages, AWorldThatIsTiltedIsNamedOnce) {
  static constexpr double kTilt_rad = 0.4;
  const std::vector<WorldScan> scans = worldScans(12000);  // dense enough for patches of floor and wall
  const auto warnings = [this, &scans](bool with_imu) {
    std::string messages = fixedTransform(0);
    for (const WorldScan& scan : scans) {
      WorldScan tilted = scan;
      tilted.T_W_S = Eigen::AngleAxisd(kTilt_rad, Eigen::Vector3d::UnitX()) * scan.T_W_S;
      messages += odometry(tilted, scan.stamp_s) + whole(scan, 0);
      for (int sample = 0; with_imu && sample < 4; ++sample) messages += imu(scan, scan.stamp_s);
    }
    writeBytes("flight.mcap", recording(messages));
    const std::string err = map({"--scans", path("flight.mcap")}).program.err;
    std::size_t count = 0;
    for (std::size_t at = 0; (at = err.find("warning[poses.up]", at)) != std::string::npos; ++at) ++count;
    EXPECT_EQ(count, 1U) << err;
    return err;
  };
  EXPECT_NE(warnings(true).find("what the IMU feels"), std::string::npos);
  EXPECT_NE(warnings(false).find("level surfaces"), std::string::npos);
}

TEST_F(BadMessages, TransformsThatPutTheSensorFarAwayAreNamed) {
  EXPECT_TRUE(mapRecording(whole, 1, 40).warns("poses.extrinsic"));
  EXPECT_FALSE(mapRecording(whole, 1, 0.4).warns("poses.extrinsic"));
}

}  // namespace
}  // namespace accessvdb::inputs_test

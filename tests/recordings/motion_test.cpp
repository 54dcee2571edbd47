// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Clouds of recordings whose points have times, and frames that are tilted: against a motion in closed form.
#include "recordings/flight.h"
#include "unit/io/moving_scanner.h"

namespace accessvdb::recordings_test {
namespace {

using io::Deskew;
using io::ScanSequence;
using io::test::expectError;
using io::test::MovingScanner;

constexpr std::size_t kScans = 4, kCount = 200;

class RecordingMotion : public FlightTest {
 protected:
  /// Scans with a column t in ns since their stamps, which are in times.txt.
  void writeMoving(double poses_every_s = 0.005) const {
    std::string times;
    for (std::size_t scan = 0; scan < kScans; ++scan) {
      std::string pcd = "VERSION 0.7\nFIELDS x y z t\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH " +
                        std::to_string(kCount) + "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " +
                        std::to_string(kCount) + "\nDATA binary\n";
      for (std::size_t i = 0; i < kCount; ++i) {
        const Eigen::Vector3f p = scanner_.measured(scan, i, kCount);
        for (int axis = 0; axis < 3; ++axis) io::test::put(pcd, p[axis]);
        io::test::put(pcd, static_cast<std::uint32_t>(std::llround(1e9 * scanner_.timeOf(i, kCount))));
      }
      folder_.write("scans/00000" + std::to_string(scan) + ".pcd", pcd);
      char line[40];
      std::snprintf(line, sizeof line, "%.6f\n", scanner_.stamp_s + 0.1 * static_cast<double>(scan));
      times += line;
    }
    folder_.write("times.txt", times);
    folder_.write("poses.txt", scanner_.poses(0.1 * kScans, poses_every_s));
  }
  /// Times in double seconds since 1970 are known to 2.4e-7 s, 5e-7 m at 2 m/s and 4e-6 m at 10 m and 1.5 rad/s.
  static constexpr double kTolerance_m = 2e-5;

  void expectRemoved(ScanSequence scans) const {
    ASSERT_EQ(scans.size(), kScans);
    EXPECT_NE(scans.matchingRule().find("in 4 of 4 scans"), std::string::npos) << scans.matchingRule();
    for (std::size_t scan = 0; scan < kScans; ++scan) {
      const io::ScanRecord record = scans.read(scan);
      EXPECT_TRUE(record.deskewed);
      ASSERT_EQ(record.points_W.size(), kCount);
      ASSERT_EQ(record.origins_W.size(), kCount);
      for (std::size_t i = 0; i < kCount; ++i) {
        ASSERT_NEAR((record.points_W[i] - scanner_.pointOn(i)).norm(), 0, kTolerance_m) << scan << " " << i;
        const double t_s = scanner_.stamp_s + 0.1 * static_cast<double>(scan) + scanner_.timeOf(i, kCount);
        ASSERT_NEAR((record.origins_W[i] - scanner_.at(t_s).translation()).norm(), 0, kTolerance_m);
      }
    }
  }
  MovingScanner scanner_;
};

TEST_F(RecordingMotion, IsRemovedForEveryFieldOfTimes) {
  ACCESSVDB_NEED_ROS2_WRITER();
  writeMoving();
  for (const auto& [name, options] : {std::pair("t.mcap", ""),
                                      {"time.mcap", "times=time layout=padded"},
                                      {"stamp.mcap", "times=timestamp"},
                                      {"stamps.db3", "times=timestamps layout=organised"},
                                      {"offset.mcap", "times=offset_time"},
                                      {"livox.mcap", "clouds=livox"}})
    expectRemoved(ScanSequence::open({.scans = write(name, options)}));
}

TEST_F(RecordingMotion, IsLeftWhereItCannotBeRemoved) {
  ACCESSVDB_NEED_ROS2_WRITER();
  writeMoving();
  const fs::path moving = write("moving.mcap", "");
  ScanSequence off = ScanSequence::open({.scans = moving, .deskew = Deskew::Off});
  EXPECT_FALSE(off.deskews());
  EXPECT_EQ(off.read(2).points_S.at(5), scanner_.measured(2, 5, kCount));
  // The odometry ends before the last scan does: that one is used as it is, or without what has no pose.
  folder_.write("poses.txt", scanner_.poses(0.1 * kScans - 0.05, 0.005));
  const fs::path early = write("early.mcap", "");
  ScanSequence scans = ScanSequence::open({.scans = early});
  EXPECT_NE(scans.matchingRule().find("in 3 of 4 scans"), std::string::npos) << scans.matchingRule();
  EXPECT_TRUE(scans.read(2).deskewed);
  EXPECT_EQ(scans.read(3).points_S.size(), kCount);
  ScanSequence asked = ScanSequence::open({.scans = early, .deskew = Deskew::On});
  // The last pose is at 50 ms; whether the point at 50 ms has it is a matter of the last bit.
  EXPECT_NEAR(static_cast<double>(asked.read(3).unposed_points), kCount / 2 - 0.5, 0.5);
  // Without times, and registered already.
  writeFlight(kScans, 50);
  fs::remove(folder_.path() / "times.txt");
  for (const char* const clouds : {"clouds=sensor", "clouds=livox"}) {
    const fs::path still = write("still.mcap", clouds);
    EXPECT_FALSE(ScanSequence::open({.scans = still}).deskews()) << clouds;
    expectError([&] { (void)ScanSequence::open({.scans = still, .deskew = Deskew::On}); }, ErrorCode::Unusable,
                "deskew.no_times", {"Deskew::On"});
  }
  EXPECT_FALSE(ScanSequence::open({.scans = write("world.mcap", "clouds=world"), .deskew = Deskew::On}).deskews());
}

/// An IMU that lies as the poses say, in a world that is tilted: what it feels is up.
TEST_F(RecordingMotion, IsTurnedLevelByTheImu) {
  ACCESSVDB_NEED_ROS2_WRITER();
  writeFlight(15, 20);
  const Eigen::Vector3d up_W = Eigen::Vector3d(0.1, -0.2, 0.97).normalized();
  std::string poses;
  const Eigen::Quaterniond q = turnAt(3);
  for (std::size_t scan = 0; scan < 15; ++scan) {
    char line[200];
    std::snprintf(line, sizeof line, "%.1f 1 2 3 %.17g %.17g %.17g %.17g\n", static_cast<double>(scan) / 10, q.x(),
                  q.y(), q.z(), q.w());
    poses += line;
  }
  folder_.write("poses.txt", poses);
  const Eigen::Vector3d felt = 9.81 * (q.inverse() * up_W);
  char imu[120];
  std::snprintf(imu, sizeof imu, "imu=%.17g,%.17g,%.17g", felt.x(), felt.y(), felt.z());
  for (const char* const frame : {"", " imu_frame=body"}) {
    ScanSequence scans =
        ScanSequence::open({.scans = write("a.mcap", imu + std::string(frame)), .level = io::Level{.from_imu = true}});
    EXPECT_NE(scans.matchingRule().find("turned level by /imu in frame body (roll "), std::string::npos)
        << scans.matchingRule();
    // The writer's noise of 0.05 m/s^2 has a mean below 5e-4 over a second.
    EXPECT_LT((scans.read(4).T_W_S.linear() * q.inverse() * up_W - Eigen::Vector3d::UnitZ()).norm(), 2e-4);
  }
  expectError([&] { (void)ScanSequence::open({.scans = write("b.mcap", ""), .level = io::Level{.from_imu = true}}); },
              ErrorCode::Unusable, "level.no_imu", {"ScanInputOptions::level ROLL,PITCH"});
  expectError(
      [&] {
        (void)ScanSequence::open({.scans = folder_.path() / "scans",
                                  .poses = folder_.path() / "poses.txt",
                                  .level = io::Level{.from_imu = true}});
      },
      ErrorCode::Usage, "usage.level", {"recordings"});
}

}  // namespace
}  // namespace accessvdb::recordings_test

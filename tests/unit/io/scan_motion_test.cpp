// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Motion within scans: a scanner whose motion is known in closed form, and files with times in every form.
#include "io/scans/scan_motion.h"

#include <limits>

#include "accessvdb/scan_io.h"
#include "io/poses/levelling.h"
#include "unit/io/input_fixture.h"
#include "unit/io/moving_scanner.h"

namespace accessvdb::io {
namespace {

using test::expectError;
using test::MovingScanner;
using test::TempFolder;

/// Float coordinates at 10 m are rounded to 5e-7 m. A straight line between poses 1 ms apart cuts a circle of 10 m by
/// 10 (1.5e-3)^2 / 8 = 3e-6 m, one between poses 5 ms apart cuts the path of the rotation nowhere: slerp is exact.
constexpr double kTolerance_m = 1e-5;

TEST(PointTimes, FindTheUnitByTheSpan) {
  struct Case {
    double stamp_s, first, last;
    const char* words;
  };
  for (const Case& one : {Case{100, 0, 0.0999, "s since the scan's stamp"},
                          {100, -0.1, 0, "s since the scan's stamp"},
                          {100, 0, 99.9, "ms since the scan's stamp"},
                          {100, 0, 99900, "us since the scan's stamp"},
                          {100, 0, 99900000, "ns since the scan's stamp"},
                          {1.7e9, 1.7e9, 1.7e9 + 0.1, "s, absolute"},
                          {1.7e9, 1.7e18, 1.7e18 + 1e8, "ns, absolute"},
                          {1.7e9, 1.7e15, 1.7e15 + 1e5, "us, absolute"},
                          {100, 0, 2e6, "us since the scan's stamp"},
                          {100, 0, 3e6, "ns since the scan's stamp"}}) {
    const TimeSpan spans[] = {{one.stamp_s, one.first, one.last}};
    const auto scale = timeScaleOf(spans);
    ASSERT_TRUE(scale) << one.words;
    EXPECT_EQ(scale->inWords(), one.words);
  }
  for (const TimeSpan& none : {TimeSpan{100, 5, 5}, {100, 0, 0}, {100, 5000, 5000.1}, {1.7e9, 12, 12.1}}) {
    const TimeSpan spans[] = {none};
    EXPECT_FALSE(timeScaleOf(spans)) << none.first;
  }
}

TEST(ScanMotion, PutsEachReturnWhereItWasMeasured) {
  const MovingScanner scanner;
  constexpr std::size_t kCount = 500;
  std::vector<Eigen::Vector3f> points_S;
  std::vector<double> times;
  for (std::size_t i = 0; i < kCount; ++i) {
    points_S.push_back(scanner.measured(0, i, kCount));
    times.push_back(1e9 * scanner.timeOf(i, kCount));
  }
  points_S[7].setZero();
  points_S[8][1] = std::numeric_limits<float>::quiet_NaN();
  times[9] = std::numeric_limits<double>::quiet_NaN();
  times[10] = 3e9;  // no scan takes three seconds
  const auto poseAt = [&](std::int64_t ms) -> std::optional<Eigen::Isometry3d> {
    if (ms > 90) return std::nullopt;
    return scanner.at(scanner.stamp_s + 1e-3 * static_cast<double>(ms));
  };
  const Eigen::Vector3d excluded_S = points_S[20].cast<double>();
  const Eigen::AlignedBox3d box(excluded_S.array() - 1e-4, excluded_S.array() + 1e-4);
  const MovedScan moved = removeMotion({points_S, times, {1e-9, false}, 100, scanner.at(100), box}, poseAt);
  // The last one is at 99.8 ms; those after 90 ms have no pose: 50 - 1 of them.
  EXPECT_EQ(moved.excluded, 1U);
  EXPECT_EQ(moved.unposed, 2U + 49U);
  ASSERT_EQ(moved.points_W.size(), kCount - 1 - 51);
  ASSERT_EQ(moved.origins_W.size(), moved.points_W.size());
  EXPECT_FALSE(coversScan(moved));
  std::size_t n = 0;
  for (std::size_t i = 0; i < kCount; ++i) {
    if (i == 9 || i == 10 || i == 20 || scanner.timeOf(i, kCount) > 0.09 + 1e-9) continue;
    const Eigen::Vector3d p_W = moved.points_W[n], q_W = moved.origins_W[n];
    ++n;
    if (i == 7) {
      EXPECT_EQ(p_W, q_W) << "no return has become one";
    } else if (i == 8) {
      EXPECT_FALSE(p_W.allFinite());
    } else {
      EXPECT_NEAR((p_W - scanner.pointOn(i)).norm(), 0, kTolerance_m) << i;
      EXPECT_NEAR((q_W - scanner.at(100 + scanner.timeOf(i, kCount)).translation()).norm(), 0, kTolerance_m) << i;
    }
  }
}

TEST(ScanMotion, BeginsRegisteredRaysWhereTheSensorWas) {
  const MovingScanner scanner;
  constexpr std::size_t kCount = 500;
  std::vector<Eigen::Vector3d> points_W;
  std::vector<double> times;
  for (std::size_t i = 0; i < kCount; ++i) {
    points_W.push_back(scanner.pointOn(i));
    times.push_back(1e3 * scanner.timeOf(i, kCount));
  }
  points_W[7].setZero();
  times[9] = std::numeric_limits<double>::quiet_NaN();
  // In the sensor's frame, one that moves: only what is in it at its own time is left out.
  const Eigen::Vector3d excluded_S = scanner.measured(0, 250, kCount).cast<double>();
  const Eigen::AlignedBox3d box(excluded_S.array() - 1e-3, excluded_S.array() + 1e-3);
  const MovedScan moved = beginWhereMeasured(
      {points_W, times, {1e-3, false}, 100, scanner.at(100), box},
      [&](std::int64_t ms) { return std::optional(scanner.at(scanner.stamp_s + 1e-3 * static_cast<double>(ms))); });
  EXPECT_EQ(moved.excluded, 1U);
  EXPECT_EQ(moved.unposed, 1U);
  ASSERT_EQ(moved.points_W.size(), kCount - 2);
  std::size_t n = 0;
  for (std::size_t i = 0; i < kCount; ++i) {
    if (i == 9 || i == 250) continue;
    const Eigen::Vector3d p_W = moved.points_W[n], q_W = moved.origins_W[n];
    ++n;
    if (i == 7) {
      EXPECT_EQ(p_W, q_W) << "no return has become one";
      continue;
    }
    EXPECT_EQ(p_W, scanner.pointOn(i)) << i;
    EXPECT_NEAR((q_W - scanner.at(100 + scanner.timeOf(i, kCount)).translation()).norm(), 0, kTolerance_m) << i;
  }
}

/// Scans of the moving scanner as files.
class MovingFiles : public ::testing::Test {
 protected:
  static constexpr std::size_t kScans = 4, kCount = 200;

  void writePoses(double every_s) { (void)folder_.write("poses.txt", scanner_.poses(0.1 * kScans, every_s)); }
  void writeStamps() {
    std::string times;
    for (std::size_t scan = 0; scan < kScans; ++scan)
      times += std::to_string(100 + 0.1 * static_cast<double>(scan)) + "\n";
    (void)folder_.write("times.txt", times);
  }
  [[nodiscard]] std::string scanName(std::size_t scan, const char* extension) const {
    return "scans/" + std::to_string(scan) + extension;
  }
  /// Text, with the time in the column of that name, in units of a second.
  void writePcd(const std::string& column, double unit_s, bool absolute = false) {
    for (std::size_t scan = 0; scan < kScans; ++scan) {
      std::string text = "FIELDS x y " + column + " z\nSIZE 4 4 8 4\nTYPE F F F F\nWIDTH " + std::to_string(kCount) +
                         "\nHEIGHT 1\nPOINTS " + std::to_string(kCount) + "\nDATA ascii\n";
      for (std::size_t i = 0; i < kCount; ++i) {
        const Eigen::Vector3f p = scanner_.measured(scan, i, kCount);
        const double base_s = absolute ? 100 + 0.1 * static_cast<double>(scan) : 0;
        char line[200];
        std::snprintf(line, sizeof line, "%.9g %.9g %.17g %.9g\n", p[0], p[1],
                      (base_s + scanner_.timeOf(i, kCount)) / unit_s, p[2]);
        text += line;
      }
      (void)folder_.write(scanName(scan, ".pcd"), text);
    }
  }
  /// Binary, uint32 ns in "t".
  void writePly() {
    for (std::size_t scan = 0; scan < kScans; ++scan) {
      std::string bytes = "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(kCount) +
                          "\nproperty float x\nproperty float y\nproperty float z\nproperty uint t\nend_header\n";
      for (std::size_t i = 0; i < kCount; ++i) {
        const Eigen::Vector3f p = scanner_.measured(scan, i, kCount);
        for (int axis = 0; axis < 3; ++axis) test::put(bytes, p[axis]);
        test::put(bytes, static_cast<std::uint32_t>(std::llround(1e9 * scanner_.timeOf(i, kCount))));
      }
      (void)folder_.write(scanName(scan, ".ply"), bytes);
    }
  }
  [[nodiscard]] ScanSequence open(Deskew deskew = Deskew::Auto) const {
    return ScanSequence::open({.scans = folder_ / "scans", .poses = folder_ / "poses.txt", .deskew = deskew});
  }
  void expectRemoved(ScanSequence scans) const {
    ASSERT_EQ(scans.size(), kScans);
    EXPECT_TRUE(scans.deskews());
    EXPECT_NE(scans.matchingRule().find("by the pose at its own time"), std::string::npos) << scans.matchingRule();
    EXPECT_NE(scans.matchingRule().find("in 4 of 4 scans"), std::string::npos) << scans.matchingRule();
    for (std::size_t scan = 0; scan < kScans; ++scan) {
      const ScanRecord record = scans.read(scan);
      EXPECT_TRUE(record.deskewed);
      EXPECT_TRUE(record.points_S.empty());
      ASSERT_EQ(record.points_W.size(), kCount);
      for (std::size_t i = 0; i < kCount; ++i)
        ASSERT_NEAR((record.points_W[i] - scanner_.pointOn(i)).norm(), 0, kTolerance_m) << scan << " " << i;
    }
  }
  void expectAsToday(ScanSequence scans, const char* why) const {
    EXPECT_FALSE(scans.deskews());
    EXPECT_NE(scans.matchingRule().find("motion within a scan is not removed"), std::string::npos);
    EXPECT_NE(scans.matchingRule().find(why), std::string::npos) << scans.matchingRule();
    for (std::size_t scan = 0; scan < kScans; ++scan) {
      const ScanRecord record = scans.read(scan);
      ASSERT_EQ(record.points_S.size(), kCount);
      EXPECT_TRUE(record.points_W.empty());
      for (std::size_t i = 0; i < kCount; ++i) ASSERT_EQ(record.points_S[i], scanner_.measured(scan, i, kCount));
    }
  }

  MovingScanner scanner_;
  TempFolder folder_;
};

TEST_F(MovingFiles, OfEveryFieldAndUnitGiveTheWall) {
  writeStamps();
  writePoses(0.005);
  for (const auto& [column, unit_s, absolute] :
       {std::tuple("t", 1e-9, false), std::tuple("time", 1.0, false), std::tuple("offset_time", 1e-6, false),
        std::tuple("timestamp", 1.0, true), std::tuple("timestamps", 1e-3, true)}) {
    writePcd(column, unit_s, absolute);
    expectRemoved(open());
  }
  std::filesystem::remove_all(folder_ / "scans");
  writePly();
  expectRemoved(open());
  expectAsToday(open(Deskew::Off), "Deskew::Off");
}

/// As odometry at the rate of the scans has them: the motion between is a straight line and an even turn.
TEST_F(MovingFiles, NeedOnlyPosesAtTheirEnds) {
  writeStamps();
  writePoses(0.1);
  writePly();
  expectRemoved(open());
}

TEST_F(MovingFiles, WithoutTimesOrPosesAreUsedAsTheyAre) {
  writeStamps();
  writePoses(0.005);
  writePcd("intensity", 1);
  expectAsToday(open(), "its points have no times");
  expectError([&] { (void)open(Deskew::On); }, ErrorCode::Unusable, "deskew.no_times", {"Deskew::On", "no times"});
  (void)folder_.write("poses.txt", scanner_.poses(0.1 * kScans, 0.3));
  writePcd("t", 1e-9);
  ScanSequence sparse = open();
  ASSERT_EQ(sparse.size(), 2U) << "the first and the last scan begin at a pose";
  EXPECT_NE(sparse.matchingRule().find("no scan has poses within 0.2 s of all of its points, 0 to 10"),
            std::string::npos)
      << sparse.matchingRule();
  EXPECT_EQ(sparse.read(0).points_S.size(), kCount);
  expectError([&] { (void)open(Deskew::On); }, ErrorCode::Unusable, "deskew.poses");
  // Poses at the stamps alone, and none at the end of the last scan: that one is used as it is.
  (void)folder_.write("poses.txt", scanner_.poses(0.1 * (kScans - 1), 0.1));
  ScanSequence scans = open();
  EXPECT_NE(scans.matchingRule().find("in 3 of 4 scans"), std::string::npos) << scans.matchingRule();
  EXPECT_TRUE(scans.read(2).deskewed);
  EXPECT_FALSE(scans.read(3).deskewed);
  EXPECT_EQ(scans.read(3).points_S.size(), kCount);
  // Asked for, what has no pose is left out and counted.
  ScanSequence asked = open(Deskew::On);
  EXPECT_TRUE(asked.read(3).deskewed);
  EXPECT_GT(asked.read(3).unposed_points, kCount / 2);
  EXPECT_EQ(asked.read(3).points_W.size() + asked.read(3).unposed_points, kCount);
}

TEST_F(MovingFiles, OfAnotherClockAreUsedAsTheyAre) {
  writeStamps();
  writePoses(0.005);
  scanner_.stamp_s = 100;
  for (std::size_t scan = 0; scan < kScans; ++scan) {
    std::string text = "FIELDS x y z time\nSIZE 4 4 4 8\nTYPE F F F F\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA ascii\n";
    (void)folder_.write(scanName(scan, ".pcd"), text + "1 2 3 5000.0\n1 2 4 5000.1\n");
  }
  EXPECT_NE(open().matchingRule().find("another clock"), std::string::npos) << open().matchingRule();
  EXPECT_EQ(open().read(0).points_S.size(), 2U);
  expectError([&] { (void)open(Deskew::On); }, ErrorCode::Unusable, "deskew.clock", {"time"});
}

TEST_F(MovingFiles, TakeExtrinsicLevelAndOffset) {
  writeStamps();
  writePly();
  writePoses(0.005);
  // The poses are of a body; the clock of the scans is 2 s late; the odometry's frame is tilted.
  Eigen::Isometry3d T_B_S = Eigen::Isometry3d::Identity();
  T_B_S.translate(Eigen::Vector3d(0.1, -0.2, 0.3)).rotate(Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitY()));
  const Eigen::Matrix3d R_L_W =
      (Eigen::AngleAxisd(0.1, Eigen::Vector3d::UnitY()) * Eigen::AngleAxisd(-0.05, Eigen::Vector3d::UnitX()))
          .toRotationMatrix();
  std::string poses;
  for (int i = 0; i <= 100; ++i) {
    const double t_s = 100 + 0.005 * i;
    Eigen::Isometry3d T_L_W = Eigen::Isometry3d::Identity();
    T_L_W.linear() = R_L_W;
    const Eigen::Isometry3d T_W_B = T_L_W.inverse() * scanner_.at(t_s) * T_B_S.inverse();
    const Eigen::Quaterniond q(T_W_B.linear());
    char line[300];
    std::snprintf(line, sizeof line, "%.6f %.17g %.17g %.17g %.17g %.17g %.17g %.17g\n", t_s + 2,
                  T_W_B.translation().x(), T_W_B.translation().y(), T_W_B.translation().z(), q.x(), q.y(), q.z(),
                  q.w());
    poses += line;
  }
  (void)folder_.write("poses.txt", poses);
  expectRemoved(ScanSequence::open({.scans = folder_ / "scans",
                                    .poses = folder_ / "poses.txt",
                                    .time_offset_s = 2,
                                    .T_B_S = T_B_S,
                                    .level = Level{false, -0.05, 0.1}}));
}

TEST(Levelling, TakesTheMeanForceUp) {
  std::vector<Eigen::Vector3d> force_W;
  const Eigen::Vector3d up = Eigen::Vector3d(0.1, -0.2, 0.97).normalized();
  for (int i = 0; i < 50; ++i) force_W.push_back(9.81 * up + 0.1 * std::sin(i) * Eigen::Vector3d::UnitX());
  const Eigen::Matrix3d R = levellingOf(force_W, "bag");
  // The noise's mean over 50 samples is below 0.002 m/s^2.
  EXPECT_LT((R * up - Eigen::Vector3d::UnitZ()).norm(), 1e-3);
  // It turns no more than it has to: about a level axis.
  EXPECT_NEAR(Eigen::AngleAxisd(R).axis().z(), 0, 1e-3);
  EXPECT_LT((levellingOf(0.1, -0.2) -
             (Eigen::AngleAxisd(-0.2, Eigen::Vector3d::UnitY()) * Eigen::AngleAxisd(0.1, Eigen::Vector3d::UnitX()))
                 .toRotationMatrix())
                .norm(),
            1e-15);
  force_W.resize(10);
  expectError([&] { (void)levellingOf(force_W, "bag"); }, ErrorCode::Unusable, "level.no_imu", {"10"});
  force_W.assign(50, Eigen::Vector3d::Zero());
  expectError([&] { (void)levellingOf(force_W, "bag"); }, ErrorCode::Unusable, "level.moving");
  for (int i = 0; i < 50; ++i) force_W[static_cast<std::size_t>(i)] = Eigen::Vector3d(i % 7, 0, 9.81);
  expectError([&] { (void)levellingOf(force_W, "bag"); }, ErrorCode::Unusable, "level.moving", {"not at rest"});
}

}  // namespace
}  // namespace accessvdb::io

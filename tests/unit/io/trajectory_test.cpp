// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/trajectory.h"

#include <cmath>

#include "accessvdb/scan_io.h"
#include "io/poses/trajectory_coverage.h"
#include "unit/io/timed_cloud.h"

namespace accessvdb::io {
namespace {

using test::anyContains;
using test::expectError;
using test::TempFolder;
using test::TimedPoint;

/// At time t the sensor is at (2 (t - begin), 5, 1 - (t - begin)).
Eigen::Vector3d sensorAt(double since_begin_s) { return {2 * since_begin_s, 5, 1 - since_begin_s}; }

/// Positions every 0.125 s, which is exact in binary.
std::string trajectoryText(double begin_s, int nodes) {
  std::string text;
  for (int i = 0; i < nodes; ++i) {
    char line[200];
    const Eigen::Vector3d p = sensorAt(0.125 * i);
    std::snprintf(line, sizeof(line), "%.6f %.6f %.6f %.6f\n", begin_s + 0.125 * i, p[0], p[1], p[2]);
    text += line;
  }
  return text;
}

/// Points every 1/32 s from 0 s after `begin_s` on, a few metres from the sensor.
std::vector<TimedPoint> pointsFrom(double begin_s, int count) {
  std::vector<TimedPoint> points;
  for (int i = 0; i < count; ++i)
    points.push_back({begin_s + i / 32.0, sensorAt(i / 32.0) + Eigen::Vector3d(0.5, 3, i % 5)});
  return points;
}

TEST(Trajectory, ReadsPlainTextTumRaycloudtoolsAndNamedColumns) {
  const TempFolder folder;
  for (const char* const text :
       {"1 10 20 30\n1.125 11 20 30\n",
        "# timestamp tx ty tz qx qy qz qw\n1 10 20 30 0 0 0 1\n1.125 11 20 30 0 0 0 1\n",
        "%time x y z q0 q1 q2 q3 userfields\n1 10 20 30 1 0 0 0 \n1.125 11 20 30 1 0 0 0 \n",
        "\"Easting[m]\",\"Northing[m]\",\"Height[m]\",\"Roll[deg]\",\"GPSTime[s]\"\r\n10,20,30,7,1\r\n11,20,30,7,1."
        "125\r\n",
        "# x y z time\n10 20 30 1\n\n# a remark\n11 20 30 1.125\n", "1;10;20;30\n1.125;11;20;30\n1.125;11;20;30\n"}) {
    const Trajectory trajectory = Trajectory::read(folder.write("t.txt", text), false);
    ASSERT_EQ(trajectory.size(), 2U) << text;
    std::size_t near = 0;
    EXPECT_EQ(trajectory.at(1, near), Eigen::Vector3d(10, 20, 30)) << text;
    EXPECT_EQ(trajectory.at(1.0625, near), Eigen::Vector3d(10.5, 20, 30)) << text;
    EXPECT_EQ(trajectory.at(1.125, near), Eigen::Vector3d(11, 20, 30)) << text;
  }
}

TEST(Trajectory, InterpolatesOverShortGapsOnlyAndNeverBeyondTheEnds) {
  const Trajectory trajectory({{10, {0, 0, 0}}, {10.2 - 1e-9, {1, 0, 0}}, {10.5, {2, 0, 0}}}, "t");
  const std::vector<std::pair<double, double>> known = {{10, 0},          {10.1, 0.5},       {10.2 - 1e-9, 1},
                                                        {10.200005, 1},   {10.5, 2},         {10.499995, 2},
                                                        {10 - 0.9e-5, 0}, {10.5 + 0.9e-5, 2}};
  // In any order: where the last search ended must not matter.
  for (const std::size_t start : {0U, 1U, 2U, 3U}) {
    for (const auto& [stamp, x] : known) {
      std::size_t near = start;
      const auto p = trajectory.at(stamp, near);
      ASSERT_TRUE(p) << stamp;
      EXPECT_NEAR((*p)[0], x, 1e-7) << stamp;  // the node at 10.2 - 1e-9
    }
    for (const double stamp : {9.9, 10.21, 10.35, 10.49, 10.51, -1e300, 1e300, std::nan("")}) {
      std::size_t near = start;
      EXPECT_FALSE(trajectory.at(stamp, near)) << stamp;
    }
  }
}

TEST(Trajectory, RefusesWhatIsNotATrajectory) {
  const TempFolder folder;
  const auto refuse = [&](const std::string& text, ErrorCode code, const std::string& id,
                          const std::vector<std::string>& words = {}) {
    expectError([&] { (void)Trajectory::read(folder.write("t.txt", text), false); }, code, id, words);
  };
  refuse("", ErrorCode::Input, "input.empty");
  refuse("# nothing\n", ErrorCode::Unusable, "trajectory.none", {"t.txt"});
  refuse("1 2 3\n", ErrorCode::Input, "input.malformed", {"line 1", "3 columns"});
  refuse("1 2 3 4\n2 3 x 5\n", ErrorCode::Input, "input.malformed", {"line 2", "'x'"});
  refuse("name place\n1 2 3 4\n", ErrorCode::Input, "input.malformed", {"line 1", "header"});
  refuse("1 2 3 4\ntime x y z\n", ErrorCode::Input, "input.malformed", {"line 2"});
  refuse("time,lat,lon,height\n1,49,8,100\n", ErrorCode::Unusable, "trajectory.geographic", {"projection"});
  refuse("1 2 nan 4\n", ErrorCode::Unusable, "trajectory.non_finite", {"line 1"});
  refuse("inf 2 3 4\n", ErrorCode::Unusable, "trajectory.non_finite", {"line 1"});
  refuse("1 2 3 4\n3 2 3 4\n2 2 3 4\n", ErrorCode::Unusable, "trajectory.reversed", {"line 3", "sort_poses"});
  refuse("1 2 3 4\n1 2 3 5\n", ErrorCode::Unusable, "trajectory.duplicate", {"lines 1 and 2"});
  expectError([&] { (void)Trajectory::read(folder / "none.txt", false); }, ErrorCode::Input, "input.missing");

  const Trajectory sorted = Trajectory::read(folder.write("t.txt", "1.1 3 3 3\n1 2 3 4\n1.1 3 3 3\n"), true);
  EXPECT_EQ(sorted.size(), 2U);
  EXPECT_EQ(sorted.first_s(), 1);
  EXPECT_TRUE(anyContains(sorted.notices(), "sorted"));
  EXPECT_TRUE(anyContains(sorted.notices(), "1 repeated"));
}

TEST(Trajectory, GivesEachReturnItsOwnSensorPosition) {
  const TempFolder folder;
  const double begin_s = 1.3e9;
  const auto path = folder.write("t.txt", trajectoryText(begin_s, 40));
  const std::vector<TimedPoint> points = pointsFrom(begin_s, 100);
  for (const auto& cloud :
       {folder.write("c.las", test::timedLas(points)), folder.write("c.ply", test::timedPly(points)),
        folder.write("g.ply", test::timedPly(points, "gps_time"))}) {
    ScanSequence scans = ScanSequence::open({.scans = cloud, .rays_per_step = 30, .trajectory = path});
    ASSERT_EQ(scans.size(), 4U);
    EXPECT_NE(scans.matchingRule().find("trajectory"), std::string::npos);
    EXPECT_TRUE(anyContains(scans.paths(), "t.txt"));
    std::size_t at = 0;
    for (std::size_t step = 0; step < 4; ++step) {
      const ScanRecord record = scans.read(step);
      EXPECT_EQ(record.stamp_s, points[at].stamp_s);
      EXPECT_EQ(scans.stamp_s(step), points[at].stamp_s);
      ASSERT_EQ(record.origins_W.size(), record.points_W.size());
      for (std::size_t i = 0; i < record.points_W.size(); ++i, ++at) {
        EXPECT_EQ(record.points_W[i], points[at].p_W);
        EXPECT_EQ(record.origins_W[i], sensorAt(static_cast<double>(at) / 32));  // all exact in binary
      }
    }
    EXPECT_EQ(at, 100U);
  }
}

TEST(Trajectory, TakesAFolderOfTilesAsOneCloudAndStepsOverEmptyOnes) {
  const TempFolder folder;
  const auto path = folder.write("t.txt", trajectoryText(100, 40));
  std::vector<TimedPoint> points = pointsFrom(100, 90);
  (void)folder.write("tiles/1.las", test::timedLas({points.begin(), points.begin() + 50}));
  (void)folder.write("tiles/2.las", test::timedLas({}));
  (void)folder.write("tiles/10.las", test::timedLas({points.begin() + 50, points.end()}));
  ScanSequence scans = ScanSequence::open({.scans = folder / "tiles", .rays_per_step = 40, .trajectory = path});
  ASSERT_EQ(scans.size(), 3U);
  EXPECT_EQ(std::filesystem::path(scans.path(1)).filename(), "1.las");
  EXPECT_EQ(std::filesystem::path(scans.path(2)).filename(), "10.las");
  EXPECT_EQ(scans.read(2).points_W.front(), points[50].p_W);
  EXPECT_EQ(scans.read(1).points_W.size(), 10U);
  EXPECT_EQ(scans.read(1).points_W.back(), points[49].p_W);
  EXPECT_TRUE(anyContains(scans.notices(), "2.las: contains no points"));
  expectError([&] { (void)ScanSequence::open({.scans = folder / "tiles/2.las", .trajectory = path}); },
              ErrorCode::Unusable, "input.no_points", {"2.las"});
  (void)folder.write("none/1.las", test::timedLas({}));
  (void)folder.write("none/2.las", test::timedLas({}));
  expectError([&] { (void)ScanSequence::open({.scans = folder / "none", .trajectory = path}); }, ErrorCode::Unusable,
              "input.no_points", {"none", "2 files"});
}

TEST(Trajectory, SkipsAFewReturnsAndRefusesMany) {
  const TempFolder folder;
  const auto path = folder.write("t.txt", trajectoryText(100, 401));  // 50 s
  const auto open = [&](int outside) {
    std::vector<TimedPoint> points = pointsFrom(100, 1000 - outside);
    // At the end, and with a step of their own.
    for (int i = 0; i < outside; ++i) points.push_back({200.0 + i, {1, 2, 3}});
    return ScanSequence::open({.scans = folder.write("c.las", test::timedLas(points)),
                               .rays_per_step = static_cast<std::size_t>(1000 - outside),
                               .trajectory = path});
  };
  ScanSequence all = open(0);
  EXPECT_FALSE(anyContains(all.notices(), "skipped"));
  ScanSequence some = open(10);
  EXPECT_TRUE(anyContains(some.notices(), "10 of 1000 returns are skipped"));
  ASSERT_EQ(some.size(), 1U) << "a step without returns is none";
  EXPECT_EQ(some.read(0).points_W.size(), 990U);
  expectError([&] { (void)open(11); }, ErrorCode::Unusable, "trajectory.coverage",
              {"98.9 %", "100.000 to", "150.000 s"});
  expectError([&] { (void)open(200); }, ErrorCode::Unusable, "trajectory.coverage", {"80.0 %", "whole trajectory"});
}

TEST(Trajectory, AsksForMorePositionsWhereTheyAreTooFewPerSecond) {
  const TempFolder folder;
  const auto cloud = folder.write("c.las", test::timedLas(pointsFrom(100, 300)));
  std::string one_hertz;
  for (int i = 0; i < 12; ++i) one_hertz += std::to_string(100 + i) + " 1 2 3\n";
  expectError([&] { (void)ScanSequence::open({.scans = cloud, .trajectory = folder.write("t.txt", one_hertz)}); },
              ErrorCode::Unusable, "trajectory.coverage", {"3.3 %", "every 0.2 s"});
}

struct ClockCase {
  const char* name;
  double cloud_begin_s, trajectory_begin_s;
  const char* offset;  ///< as the message writes it
};
std::ostream& operator<<(std::ostream& out, const ClockCase& c) { return out << c.name; }
class TrajectoryClock : public ::testing::TestWithParam<ClockCase> {};

/// 2023-01-02 00:00:00 UTC is GPS time 1356652818, 18 s into... week 2243, second 86418.
TEST_P(TrajectoryClock, NamesTheOffsetAndItWorks) {
  const ClockCase& clock = GetParam();
  const TempFolder folder;
  const auto path = folder.write("t.txt", trajectoryText(clock.trajectory_begin_s, 81));  // 10 s
  const auto cloud = folder.write("c.las", test::timedLas(pointsFrom(clock.cloud_begin_s, 300)));
  expectError([&] { (void)ScanSequence::open({.scans = cloud, .trajectory = path}); }, ErrorCode::Unusable,
              "trajectory.coverage", {"time_offset_s " + std::string(clock.offset) + ","});
  ScanSequence scans =
      ScanSequence::open({.scans = cloud, .trajectory = path, .time_offset_s = std::stod(clock.offset)});
  // 1e-6 s, the rounding of 1.7e9 s in doubles, at 2.3 m/s.
  EXPECT_LT((scans.read(0).origins_W.back() - sensorAt(299 / 32.0)).norm(), 3e-6);
}
constexpr double kGps = 1356652818;
INSTANTIATE_TEST_SUITE_P(Clocks, TrajectoryClock,
                         ::testing::Values(ClockCase{"adjusted", kGps - 1e9, kGps, "1000000000"},
                                           ClockCase{"adjusted_trajectory", kGps, kGps - 1e9, "-1000000000"},
                                           ClockCase{"week_seconds", 86418, kGps, "1356566400"},
                                           ClockCase{"week_seconds_trajectory", kGps, 86418, "-1356566400"},
                                           ClockCase{"adjusted_and_week_seconds", kGps - 1e9, 86418, "-356566400"},
                                           ClockCase{"leap_seconds", kGps, kGps - 18, "-18"},
                                           ClockCase{"leap_seconds_back", 86400, 86418, "18"},
                                           ClockCase{"adjusted_less_leap_seconds", kGps - 1e9, kGps - 18, "999999982"},
                                           ClockCase{"since_1970", kGps, 1672617600, "315964782"}));

TEST(Trajectory, GuessesNoOffsetForAnotherRecording) {
  const TempFolder folder;
  const auto path = folder.write("t.txt", trajectoryText(kGps, 81));
  for (const double begin_s : {kGps + 604800, kGps - 3600, 5e11}) {
    const auto cloud = folder.write("c.las", test::timedLas(pointsFrom(begin_s, 300)));
    try {
      (void)ScanSequence::open({.scans = cloud, .trajectory = path});
      ADD_FAILURE() << begin_s;
    } catch (const UnusableInput& error) {
      EXPECT_EQ(error.id(), "trajectory.coverage");
      EXPECT_NE(std::string(error.what()).find("0.0 %"), std::string::npos) << error.what();
      EXPECT_EQ(std::string(error.what()).find("time_offset_s -"), std::string::npos) << error.what();
      EXPECT_EQ(std::string(error.what()).find("time_offset_s 6"), std::string::npos) << error.what();
    }
  }
}

TEST(Trajectory, RefusesOneInAnotherDatum) {
  const TempFolder folder;
  const auto path = folder.write("t.txt", trajectoryText(100, 81));
  std::vector<TimedPoint> points = pointsFrom(100, 300);
  for (TimedPoint& point : points) point.p_W += Eigen::Vector3d(470000, 1900000, 0);
  expectError(
      [&] { (void)ScanSequence::open({.scans = folder.write("c.las", test::timedLas(points)), .trajectory = path}); },
      ErrorCode::Unusable, "trajectory.far", {"300 of 300", "1957", "datum"});
  // An aeroplane at 5 km is no other datum.
  for (TimedPoint& point : points) point.p_W = Eigen::Vector3d(0, 0, -5000);
  EXPECT_TRUE(anyContains(
      ScanSequence::open({.scans = folder.write("c.las", test::timedLas(points)), .trajectory = path}).notices(),
      "typically 4996 m"));
}

TEST(Trajectory, NeedsTimesOfSufficientPrecision) {
  const TempFolder folder;
  const auto path = folder.write("t.txt", trajectoryText(100, 81));
  const auto refuse = [&](const std::filesystem::path& scans, ErrorCode code, const std::string& id,
                          const std::vector<std::string>& words) {
    expectError([&] { (void)ScanSequence::open({.scans = scans, .trajectory = path}); }, code, id, words);
  };
  const auto points = pointsFrom(100, 30);
  std::string no_times = test::timedLas(points);
  no_times[104] = 0;
  refuse(folder.write("n.las", no_times), ErrorCode::Unusable, "input.no_times", {"point format 0"});
  refuse(folder.write("n.ply", test::timedPly(points, "intensity")), ErrorCode::Unusable, "input.no_times", {"time"});
  refuse(folder.write("f.ply", test::timedPly(points, "time", "float")), ErrorCode::Unusable, "input.coarse_times",
         {"double"});
  refuse(folder.write("c.xyz", "1 2 3\n"), ErrorCode::Usage, "usage.trajectory", {".las"});
  std::vector<TimedPoint> not_numbers = points;
  for (TimedPoint& point : not_numbers) point.stamp_s = NAN;
  refuse(folder.write("nan.ply", test::timedPly(not_numbers)), ErrorCode::Unusable, "trajectory.coverage",
         {"not numbers"});

  const auto cloud = folder.write("c.las", test::timedLas(points));
  expectError([&] { (void)ScanSequence::open({.scans = cloud, .poses = path, .trajectory = path}); }, ErrorCode::Usage,
              "usage.trajectory");
  expectError(
      [&] { (void)ScanSequence::open({.scans = cloud, .sensor_at_W = Eigen::Vector3d::Zero(), .trajectory = path}); },
      ErrorCode::Usage, "usage.trajectory");
  for (const double bad : {NAN, INFINITY})
    expectError([&] { (void)ScanSequence::open({.scans = cloud, .trajectory = path, .time_offset_s = bad}); },
                ErrorCode::Usage, "usage.time_offset");
  expectError([&] { (void)ScanSequence::open({.scans = cloud, .time_offset_s = 1}); }, ErrorCode::Usage,
              "usage.time_offset", {"ScanInputOptions::trajectory"});
}

}  // namespace
}  // namespace accessvdb::io

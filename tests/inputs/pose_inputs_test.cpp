// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Poses and names of scans as other software writes them: each spelling gives the map of the plain one, or one line
/// that says what it is.
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>

#include "inputs/field_world.h"

namespace accessvdb::inputs_test {
namespace {

using Line = std::function<std::string(const WorldScan&, int)>;
using Name = std::function<std::string(const WorldScan&, int)>;

std::string text(const char* format, auto... values) {
  char line[600];
  std::snprintf(line, sizeof line, format, values...);
  return line;
}
Eigen::Quaterniond q(const WorldScan& scan) { return Eigen::Quaterniond(scan.T_W_S.linear()); }
Eigen::Vector3d p(const WorldScan& scan) { return scan.T_W_S.translation(); }
std::string xyz(const WorldScan& s, const std::string& between) {
  return decimals(p(s).x()) + between + decimals(p(s).y()) + between + decimals(p(s).z());
}
std::string wFirst(const WorldScan& s, const std::string& between) {
  return decimals(q(s).w()) + between + decimals(q(s).x()) + between + decimals(q(s).y()) + between +
         decimals(q(s).z());
}
std::string wLast(const WorldScan& s, const std::string& between) {
  return decimals(q(s).x()) + between + decimals(q(s).y()) + between + decimals(q(s).z()) + between +
         decimals(q(s).w());
}
std::string tenths(const WorldScan& s) { return text("%.6f", s.stamp_s); }
std::string nanoseconds(const WorldScan& s) {
  return text("%lld", static_cast<long long>(std::llround(s.stamp_s * 10)) * 100000000LL);
}
std::string tum(const WorldScan& s) { return tenths(s) + " " + xyz(s, " ") + " " + wLast(s, " "); }
std::string replaced(std::string line, char from, char to) {
  for (char& c : line) c = c == from ? to : c;
  return line;
}
std::string matrix(const WorldScan& s, int rows, bool by_column = false) {
  std::string line;
  for (int i = 0; i < rows; ++i)
    for (int k = 0; k < 4; ++k) line += (i + k > 0 ? " " : "") + decimals(by_column ? s.T_W_S(k, i) : s.T_W_S(i, k));
  return line;
}

class PoseInputs : public InputTest {
 protected:
  void SetUp() override {
    InputTest::SetUp();
    writeNumberedScans(scans_);
    base_ = map({"--scans", path("scans"), "--poses", path("poses.txt")});
    expectRight(base_);
  }
  void write(const Name& name, const std::string& header, const Line& line) const {
    std::filesystem::remove_all(path("scans"));
    std::string poses = header;
    for (int i = 0; i < static_cast<int>(scans_.size()); ++i) {
      writePcd("scans/" + name(scans_[i], i) + ".pcd", scans_[i].points_S());
      poses += line(scans_[i], i) + "\n";
    }
    writeBytes("given.txt", poses);
  }
  [[nodiscard]] MapOutcome mapGiven(const std::vector<std::string>& more = {}) const {
    std::vector<std::string> arguments = {"--scans", path("scans"), "--poses", path("given.txt")};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return map(arguments);
  }
  /// Poses have nine decimals, so that a point may fall on the other side of a face of a voxel.
  void expectBase(const MapOutcome& outcome, const std::string& what) const {
    expectRight(outcome);
    constexpr double kFaces = 5;
    EXPECT_NEAR(static_cast<double>(outcome.points), static_cast<double>(base_.points), kFaces) << what;
    EXPECT_NEAR(static_cast<double>(outcome.accessible), static_cast<double>(base_.accessible), kFaces) << what;
    EXPECT_EQ(outcome.program.err.find("warning["), std::string::npos) << what << outcome.program.err;
  }

  const std::vector<WorldScan> scans_ = worldScans();
  MapOutcome base_;
};

const Name kStamped = [](const WorldScan& s, int) { return tenths(s); };
const Name kInNanoseconds = [](const WorldScan& s, int) { return nanoseconds(s); };
const Name kNumbered = [](const WorldScan&, int i) { return text("%06d", i); };

TEST_F(PoseInputs, ColumnsAreWhatTheirNamesSay) {
  struct Case {
    Name name;
    const char* header;
    Line line;
  };
  const Line euroc_s = [](const WorldScan& s, int) { return tenths(s) + "," + xyz(s, ",") + "," + wFirst(s, ","); };
  const Line euroc_ns = [](const WorldScan& s, int) {
    return nanoseconds(s) + "," + xyz(s, ",") + "," + wFirst(s, ",");
  };
  for (const Case& one : {
           Case{kStamped,
                "#timestamp [s], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z "
                "[]\n",
                euroc_s},
           Case{kInNanoseconds,
                "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z "
                "[]\n",
                euroc_ns},
           Case{kStamped, "num, t, x, y, z, qx, qy, qz, qw\n",
                [](const WorldScan&s, int i) {
                  return text("%d,", i) + tenths(s) + "," + xyz(s, ",") + "," + wLast(s, ",");
                }},
           Case{kStamped, "#timestamp x y z qx qy qz qw id\n",
                [](const WorldScan&s, int i) { return tum(s) + text(" %d", i + 1); }},
           Case{kStamped, "sec;nsec;qw;qx;qy;qz;pos_x;pos_y;pos_z\n",
                [](const WorldScan&s, int i) {
                  return text("1700000000;%d;", i * 100000000) + wFirst(s, ";") + ";" + xyz(s, ";");
                }},
           Case{kStamped,
                "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.pose.pose.position.x,"
                "field.pose.pose.position.y,field.pose.pose.position.z,field.pose.pose.orientation.x,"
                "field.pose.pose.orientation.y,field.pose.pose.orientation.z,field.pose.pose.orientation.w,"
                "field.pose.covariance0,field.twist.twist.linear.x\n",
                [](const WorldScan&s, int i) {
                  return text("1800000000000000000,%d,", i) + nanoseconds(s) + ",," + xyz(s, ",") + "," +
                         wLast(s, ",") + ",0.1,3";
                }},
           Case{kStamped, "t\ttx\tty\ttz\tqx\tqy\tqz\tqw\n",
                [](const WorldScan&s, int) { return replaced(replaced(tum(s), ' ', '\t'), '.', ','); }},
           Case{kNumbered, "frame r11 r12 r13 r21 r22 r23 r31 r32 r33 tx ty tz\n",
                [](const WorldScan&s, int i) {
                  std::string line = text("%d", i);
                  for (int k = 0; k < 9; ++k) line += " " + decimals(s.T_W_S(k / 3, k % 3));
                  return line + " " + xyz(s, " ");
                }},
           Case{
               kNumbered, "file,x,y,z,qx,qy,qz,qw\n",
               [](const WorldScan&s, int i) { return text("scans/%06d.pcd,", i) + xyz(s, ",") + "," + wLast(s, ","); }},
       }) {
    write(one.name, one.header, one.line);
    expectBase(mapGiven(), one.header);
  }
}

TEST_F(PoseInputs, NamesThatContradictOrLackAreRefused) {
  write(kStamped, "time,x,y,z,qw,qx,qy,qz\n",
        [](const WorldScan& s, int) { return tenths(s) + "," + xyz(s, ",") + "," + wFirst(s, ","); });
  EXPECT_TRUE(mapGiven({"--pose-format", "tum"}).fails("usage.pose_format"));
  expectBase(mapGiven(), "w first");
  write(kStamped, "time,x,y,z,roll,pitch,yaw\n",
        [](const WorldScan& s, int) { return tenths(s) + "," + xyz(s, ",") + ",0,0,0"; });
  const MapOutcome angles = mapGiven();
  EXPECT_TRUE(angles.fails("input.malformed")) << angles.program.err;
  EXPECT_NE(angles.program.err.find("roll,pitch,yaw"), std::string::npos) << angles.program.err;
  write(kStamped, "", [](const WorldScan& s, int i) { return tum(s) + text(" %d", i); });
  const MapOutcome nine = mapGiven();
  EXPECT_TRUE(nine.fails("input.malformed")) << nine.program.err;
  EXPECT_NE(nine.program.err.find("column names"), std::string::npos) << nine.program.err;
}

TEST_F(PoseInputs, MatricesOfAnyLayoutAreRead) {
  write(kNumbered, "", [](const WorldScan& s, int) { return matrix(s, 4); });
  expectBase(mapGiven(), "16 numbers");
  write(kNumbered, "8\n", [](const WorldScan& s, int) { return matrix(s, 4, true); });
  const MapOutcome columns = mapGiven();
  expectBase(columns, "16 numbers, column by column, and a count");
  EXPECT_NE(columns.program.err.find("column by column"), std::string::npos) << columns.program.err;
  write(kStamped, "", [](const WorldScan& s, int) { return tenths(s) + " " + matrix(s, 4); });
  expectBase(mapGiven(), "a time and 16 numbers");
  write(kNumbered, "", [](const WorldScan& s, int i) { return text("%d ", i) + matrix(s, 3); });
  expectBase(mapGiven(), "a number and 12");
}

TEST_F(PoseInputs, NamesOfFilesCountBeforeNumbers) {
  const auto file = [](int i) { return text("%06d.pcd", i); };
  const auto csv = [](const WorldScan& s) { return xyz(s, ",") + "," + wLast(s, ","); };
  write(kNumbered, "id,file,x,y,z,qx,qy,qz,qw\n",
        [&](const WorldScan& s, int i) { return text("%d,", i + 1) + file(i) + "," + csv(s); });
  expectBase(mapGiven(), "ids from 1");
  write(kNumbered, "frame,filename,x,y,z,qx,qy,qz,qw\n",
        [&](const WorldScan& s, int i) { return text("%d,C:\\scans\\", 100 + i) + file(i) + "," + csv(s); });
  expectBase(mapGiven(), "frames from 100");
  write(kNumbered, "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n", [&](const WorldScan& s, int i) {
    return text("%d ", i + 1) + wFirst(s, " ") + " " + xyz(s, " ") + " 1 " + file(i) + "\n";
  });
  expectBase(mapGiven(), "COLMAP's columns");
  write(kNumbered, "time,file,x,y,z,qx,qy,qz,qw\n",
        [&](const WorldScan& s, int i) { return tenths(s) + "," + file(7 - i) + "," + csv(s); });
  const MapOutcome reversed = mapGiven();
  EXPECT_NE(reversed.program.err.find("file name = name in the pose file"), std::string::npos) << reversed.program.err;
  // The column is of something else: the numbers count.
  write(kNumbered, "id,camera_name,x,y,z,qx,qy,qz,qw\n",
        [&](const WorldScan& s, int i) { return text("%d,front,", i) + csv(s); });
  expectBase(mapGiven(), "a camera's name");
  write(kNumbered, "file,x,y,z,qx,qy,qz,qw\n",
        [&](const WorldScan& s, int i) { return file(i == 5 ? 4 : i) + "," + csv(s); });
  EXPECT_TRUE(mapGiven().fails("poses.duplicate"));
}

TEST_F(PoseInputs, NumbersFromAnotherBaseAreNeverMatchedOffByOne) {
  const auto from = [](int first) {
    return [first](const WorldScan& s, int i) { return text("%d ", i + first) + xyz(s, " ") + " " + wLast(s, " "); };
  };
  const auto named = [](int first) { return [first](const WorldScan&, int i) { return text("%06d", i + first); }; };
  const std::string header = "id x y z qx qy qz qw\n";
  for (const auto& [scan, pose] : {std::pair(0, 1), std::pair(1, 0)}) {
    write(named(scan), header, from(pose));
    const MapOutcome outcome = mapGiven();
    expectBase(outcome, text("scans from %d, poses from %d", scan, pose));
    EXPECT_NE(outcome.program.err.find("taken in order"), std::string::npos) << outcome.program.err;
    EXPECT_NE(outcome.program.err.find("--match name"), std::string::npos) << outcome.program.err;
    write(named(scan), "scan x y z qx qy qz qw\n", from(pose));
    expectBase(mapGiven(), "numbers as names");
  }
  write(named(0), "", [](const WorldScan& s, int i) { return text("%d ", i + 1) + matrix(s, 3); });
  expectBase(mapGiven(), "matrices with numbers from 1");
  // A pose that is none must not hide the shift.
  write(named(0), header, [&](const WorldScan& s, int i) {
    return i == 3 ? std::string("4 nan nan nan nan nan nan nan") : from(1)(s, i);
  });
  const MapOutcome one_bad = mapGiven();
  expectRight(one_bad);
  EXPECT_NE(one_bad.program.err.find("7 of 8 scans, 7 poses"), std::string::npos) << one_bad.program.err;
  for (const auto& [scan, pose] : {std::pair(0, 3), std::pair(5, 7), std::pair(0, 100)}) {
    write(named(scan), header, from(pose));
    const MapOutcome outcome = mapGiven();
    EXPECT_TRUE(outcome.fails("poses.no_match")) << scan << pose << outcome.program.err;
    EXPECT_NE(outcome.program.err.find("--match order"), std::string::npos) << outcome.program.err;
    expectBase(mapGiven({"--match", "order"}), "order");
  }
}

TEST_F(PoseInputs, QuotesAreNotPartOfCells) {
  const auto quoted = [](const WorldScan& s, const std::string& between) {
    return "\"" + tenths(s) + "\"" + between + "\"" + xyz(s, "\"" + between + "\"") + "\"" + between + "\"" +
           wLast(s, "\"" + between + "\"") + "\"";
  };
  for (const char* between : {",", ";", "\t", " ", ", "}) {
    write(kStamped, "", [&](const WorldScan& s, int) { return quoted(s, between); });
    expectBase(mapGiven(), std::string("quoted, between them '") + between + "'");
  }
  write(kStamped, "\"time\",\"x\",\"y\",\"z\",\"qx\",\"qy\",\"qz\",\"qw\"\n",
        [&](const WorldScan& s, int) { return quoted(s, ","); });
  expectBase(mapGiven(), "a quoted header");
  write(kStamped, "", [&](const WorldScan& s, int) { return replaced(quoted(s, ";"), '.', ','); });
  expectBase(mapGiven(), "decimal commas");
  write(kStamped, "", [&](const WorldScan& s, int) { return replaced(replaced(quoted(s, ";"), '.', ','), ';', ','); });
  expectBase(mapGiven(), "decimal commas in quotes, between commas");
  write(kStamped,
        "Time,header.seq,header.frame_id,pose.pose.position.x,pose.pose.position.y,pose.pose.position.z,"
        "pose.pose.orientation.x,pose.pose.orientation.y,pose.pose.orientation.z,pose.pose.orientation.w,"
        "pose.covariance,twist.twist.linear.x\n",
        [](const WorldScan& s, int i) {
          return tenths(s) + text(",%d,odom,", i) + xyz(s, ",") + "," + wLast(s, ",") + ",\"(0.0, 0.0; 0.1)\",3";
        });
  expectBase(mapGiven(), "a cell with commas");
}

TEST_F(PoseInputs, MatricesOverSeveralLinesAreRead) {
  const auto lines = [](const WorldScan& s, int rows) {
    std::string all;
    for (int i = 0; i < rows; ++i)
      for (int k = 0; k < 4; ++k) all += decimals(s.T_W_S(i, k)) + (k < 3 ? " " : i + 1 < rows ? "\n" : "");
    return all;
  };
  write(kNumbered, "", [&](const WorldScan& s, int) { return lines(s, 3); });
  expectBase(mapGiven(), "3 lines of 4");
  write(kNumbered, "8\n", [&](const WorldScan& s, int) { return lines(s, 3) + "\n"; });
  expectBase(mapGiven(), "3 lines of 4, a blank one, and a count");
  write(kNumbered, "", [&](const WorldScan& s, int) { return lines(s, 4); });
  expectBase(mapGiven(), "4 lines of 4");
  write(kNumbered, "", [&](const WorldScan& s, int i) { return text("%d %d %d\n", i, i, i + 1) + lines(s, 4); });
  expectBase(mapGiven(), "Open3D's .log");
  write(kNumbered, "", [&](const WorldScan& s, int) { return "0\t0\t8\n" + lines(s, 4); });
  expectBase(mapGiven(), "a .log without numbers");
  write(kNumbered, "", [&](const WorldScan& s, int i) { return text("%d %d 8\n", i, i + 1) + lines(s, 4); });
  const MapOutcome pairs = mapGiven();
  EXPECT_TRUE(pairs.fails("input.malformed")) << pairs.program.err;
  EXPECT_NE(pairs.program.err.find("pairs of scans"), std::string::npos) << pairs.program.err;
}

TEST_F(PoseInputs, RotationsThatAreAnglesAreRefusedByName) {
  for (const char* names : {"time,x,y,z,roll,pitch,yaw", "# time x y z roll_deg pitch_deg yaw_deg",
                            "time x y z rx ry rz", "t;x;y;z;Heading[deg];Pitch[deg];Roll[deg]"}) {
    write(kStamped, std::string(names) + "\n", [](const WorldScan& s, int) { return tenths(s) + " 0 0 1 0.1 0 0"; });
    const MapOutcome outcome = mapGiven();
    EXPECT_TRUE(outcome.fails("input.malformed")) << outcome.program.err;
    EXPECT_NE(outcome.program.err.find("rotations as angles"), std::string::npos) << outcome.program.err;
    EXPECT_EQ(outcome.program.err.find("remove the line"), std::string::npos) << outcome.program.err;
  }
}

TEST_F(PoseInputs, ClocksThatDifferByAConstantAreNamed) {
  write(kStamped, "",
        [](const WorldScan& s, int i) { return text("%.1f ", 0.1 * i) + xyz(s, " ") + " " + wLast(s, " "); });
  const MapOutcome relative = mapGiven();
  EXPECT_TRUE(relative.fails("poses.no_overlap")) << relative.program.err;
  EXPECT_NE(relative.program.err.find("--time-offset -1700000000 "), std::string::npos) << relative.program.err;
  expectBase(mapGiven({"--time-offset", "-1700000000"}), "as advised");
  // Of another span, nothing says what belongs together.
  write(kStamped, "",
        [](const WorldScan& s, int i) { return text("%.1f ", 0.3 * i) + xyz(s, " ") + " " + wLast(s, " "); });
  const MapOutcome longer = mapGiven();
  EXPECT_TRUE(longer.fails("poses.no_overlap")) << longer.program.err;
  EXPECT_EQ(longer.program.err.find("--time-offset"), std::string::npos) << longer.program.err;
}

TEST_F(PoseInputs, NamesOfScansAreTimes) {
  const Line line = [](const WorldScan& s, int) { return tum(s); };
  const auto expectTime = [&](const Name& name, const std::string& what) {
    write(name, "", line);
    const MapOutcome outcome = mapGiven();
    expectBase(outcome, what);
    EXPECT_NE(outcome.program.err.find("file name = time stamp"), std::string::npos) << what << outcome.program.err;
  };
  expectTime(kInNanoseconds, "nanoseconds");
  expectTime([](const WorldScan&, int i) { return text("cloud_1700000000%d00000_left", i); }, "microseconds, suffix");
  expectTime([](const WorldScan&, int i) { return text("1700000000_%d", i * 100000000); }, "nanoseconds not padded");
  expectTime([](const WorldScan&, int i) { return text("1700000000.%d", i * 100000000); }, "the same after a point");
  expectTime([](const WorldScan&, int i) { return text("1700000000.%d", i); }, "decimals without zeros");
  expectTime([](const WorldScan&, int i) { return text("2023-11-14-22-13-20-%d00000", i); }, "date");
  expectTime([](const WorldScan&, int i) { return text("scan_20231114_221320.%d", i); }, "short date");
  expectTime([](const WorldScan&, int i) { return text("2023-11-14T22:13:20.%d00Z", i); }, "ISO 8601");
  // In local time: the offset that mends it is named.
  write([](const WorldScan&, int i) { return text("2023-11-15_00-13-20.%d", i); }, "", line);
  const MapOutcome local = mapGiven();
  EXPECT_TRUE(local.fails("poses.no_overlap")) << local.program.err;
  EXPECT_NE(local.program.err.find("--time-offset -7200"), std::string::npos) << local.program.err;
  expectBase(mapGiven({"--time-offset", "-7200"}), "local time");
}

TEST_F(PoseInputs, TimesOfPosesAreInAnyUnit) {
  write(kStamped, "", [](const WorldScan& s, int) { return nanoseconds(s) + " " + xyz(s, " ") + " " + wLast(s, " "); });
  expectBase(mapGiven(), "nanoseconds");
  write(kInNanoseconds, "stamp_us x y z qx qy qz qw\n",
        [](const WorldScan& s, int) { return text("%.0f ", s.stamp_s * 1e6) + xyz(s, " ") + " " + wLast(s, " "); });
  expectBase(mapGiven(), "microseconds");
}

TEST_F(PoseInputs, MatchInsists) {
  // Numbers from 1 without leading zeros: in the order of the numbers, which is said.
  write([](const WorldScan&, int i) { return text("scan%d", i + 5); }, "",
        [](const WorldScan& s, int) { return tum(s); });
  const MapOutcome order = mapGiven({"--match", "order"});
  expectBase(order, "order");
  EXPECT_NE(order.program.err.find("sorted as text"), std::string::npos) << order.program.err;
  EXPECT_TRUE(mapGiven({"--match", "time"}).fails("poses.no_match"));
  EXPECT_TRUE(mapGiven({"--match", "name"}).fails("poses.no_match"));
  EXPECT_TRUE(mapGiven({"--match", "size"}).fails("usage.word"));
  EXPECT_TRUE(map({"--scans", path("scans"), "--match", "name"}).fails("usage.match"));
  write(kNumbered, "", [](const WorldScan& s, int) { return tum(s); });
  expectBase(mapGiven({"--match", "name"}), "name");
  write(kStamped, "", [](const WorldScan& s, int) { return tum(s); });
  expectBase(mapGiven({"--match", "time"}), "time");
}

TEST_F(PoseInputs, LongerGapsAreBridgedWhenAsked) {
  // Every second pose is missing, and the stamps of the others have jitter.
  write(kStamped, "", [](const WorldScan& s, int i) {
    if (i % 2 == 1 && i != 7) return std::string("# missing");
    return text("%.6f ", s.stamp_s + (i == 4 ? 0.003 : 0)) + xyz(s, " ") + " " + wLast(s, " ");
  });
  const MapOutcome short_gap = mapGiven();
  EXPECT_NE(short_gap.program.err.find("scans are skipped"), std::string::npos) << short_gap.program.err;
  EXPECT_NE(short_gap.program.err.find("--max-gap 0.22"), std::string::npos) << short_gap.program.err;
  const MapOutcome bridged = mapGiven({"--max-gap", "0.22"});
  EXPECT_EQ(bridged.program.err.find("scans are skipped"), std::string::npos) << bridged.program.err;
  EXPECT_NE(bridged.program.err.find("at most 0.22 s"), std::string::npos) << bridged.program.err;
  for (const char* bad : {"0", "-1", "11", "nan"})
    EXPECT_TRUE(mapGiven({"--max-gap", bad}).program.exit_code == 2) << bad;
}

TEST_F(PoseInputs, TrajectoriesHaveNamesCountsAndGaps) {
  std::string ply =
      "ply\nformat ascii 1.0\nelement vertex 12000\nproperty double x\nproperty double y\nproperty double z\n"
      "property double time\nend_header\n";
  const auto trajectory = [&](const std::string& between, double step_s, const std::string& header) {
    std::string lines = header;
    for (int i = 0; i <= std::lround(3 / step_s); ++i) {
      const double t = -1 + i * step_s;
      lines += text("%.4f", 1000 + t) + between + decimals(0.3) + between + decimals(-1 + 0.5 * t) + between + "1\n";
    }
    return lines;
  };
  for (const WorldScan& scan : worldScans(1500, 0)) {
    for (const Eigen::Vector3d& point : scan.points_W)
      ply += decimals(point.x()) + " " + decimals(point.y()) + " " + decimals(point.z()) + " " +
             text("%.6f\n", 1000 + scan.stamp_s);
  }
  writeBytes("walk.ply", ply);
  writeBytes("plain.txt", trajectory(" ", 0.1, ""));
  const auto walk = [&](const std::string& file, const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = {"--scans", path("walk.ply"), "--trajectory", path(file)};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return map(arguments);
  };
  const MapOutcome plain = walk("plain.txt");
  ASSERT_EQ(plain.program.exit_code, 0) << plain.program.err;
  writeBytes("named.csv", trajectory(";", 0.1, "31\nstamp [s];pos_x;pos_y;pos_z\n"));
  writeBytes("commas.csv", replaced(trajectory(";", 0.1, ""), '.', ','));
  for (const char* file : {"named.csv", "commas.csv"}) {
    const MapOutcome outcome = walk(file);
    EXPECT_EQ(outcome.accessible, plain.accessible) << file << outcome.program.err;
  }
  writeBytes("cut.csv", trajectory(";", 0.1, "99\n"));
  EXPECT_TRUE(walk("cut.csv").fails("input.malformed"));
  writeBytes("slow.txt", trajectory(" ", 0.2013, ""));
  const MapOutcome slow = walk("slow.txt");
  EXPECT_TRUE(slow.fails("trajectory.coverage")) << slow.program.err;
  EXPECT_NE(slow.program.err.find("--max-gap 0.22"), std::string::npos) << slow.program.err;
  EXPECT_EQ(walk("slow.txt", {"--max-gap", "0.22"}).program.exit_code, 0);
}

TEST_F(PoseInputs, SensorsFarFromWhatIsPosedAreNamed) {
  const std::vector<std::string> given = {"--scans", path("scans"), "--poses", path("poses.txt"), "--extrinsic"};
  const auto extrinsic = [&](const std::string& value) {
    std::vector<std::string> arguments = given;
    arguments.push_back(value);
    return map(arguments);
  };
  EXPECT_TRUE(extrinsic("120,0,50,0,0,0").warns("poses.extrinsic"));
  EXPECT_FALSE(extrinsic("0.12,0,0.05,0,0,0").warns("poses.extrinsic"));
}

}  // namespace
}  // namespace accessvdb::inputs_test

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/column_names.h"

#include "io/poses/column_reader.h"
#include "io/poses/file_stamps.h"
#include "io/poses/pose_files.h"
#include "unit/io/input_fixture.h"

namespace accessvdb::io {
namespace {

using test::anyContains;
using test::expectError;
using test::TempFolder;

/// "t x y z w i j k" of columns: which column each is, -1 for none.
std::vector<int> placesOf(const std::string& line) {
  const auto names = parseColumnNames(line);
  if (!names) return {};
  std::vector<int> places = {static_cast<int>(names->time)};
  for (const std::size_t column : names->position) places.push_back(static_cast<int>(column));
  for (const std::size_t column : names->quaternion) places.push_back(static_cast<int>(column));
  return places;
}

TEST(ColumnNames, AreReadInManySpellings) {
  const std::vector<int> tum = {0, 1, 2, 3, 7, 4, 5, 6}, w_first = {0, 1, 2, 3, 4, 5, 6, 7};
  for (const char* const line :
       {"# timestamp tx ty tz qx qy qz qw", "#timestamp x y z qx qy qz qw id", "time,x,y,z,q_x,q_y,q_z,q_w",
        "% t px py pz quat_x quat_y quat_z quat_w",
        "\"Timestamp [s]\";\"pos x [m]\";\"pos y [m]\";\"pos z [m]\";qX;qY;qZ;qW",
        "stamp\tposition.x\tposition.y\tposition.z\torientation.x\torientation.y\torientation.z\torientation.w",
        "header.stamp,pose.position.x,pose.position.y,pose.position.z,pose.orientation.x,pose.orientation.y,"
        "pose.orientation.z,pose.orientation.w",
        "__time,/odom/pose/pose/position/x,/odom/pose/pose/position/y,/odom/pose/pose/position/z,"
        "/odom/pose/pose/orientation/x,/odom/pose/pose/orientation/y,/odom/pose/pose/orientation/z,"
        "/odom/pose/pose/orientation/w,/odom/twist/twist/linear/x"})
    EXPECT_EQ(placesOf(line), tum) << line;
  for (const char* const line :
       {"#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], "
        "v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], b_a_RS_S_x [m s^-2]",
        "t x y z q0 q1 q2 q3", "TIME TX TY TZ QW QX QY QZ", "stamp_ns,x_m,y_m,z_m,qw,qx,qy,qz"})
    EXPECT_EQ(placesOf(line), w_first) << line;
  EXPECT_EQ(placesOf("nothing of that kind"), std::vector<int>());
  EXPECT_EQ(placesOf("# made by a program on 2023-01-02"), std::vector<int>());
}

TEST(ColumnNames, SayUnitsTimesInTwoPartsAndMatrices) {
  EXPECT_EQ(parseColumnNames("#timestamp [ns], x, y, z")->time_unit_s, 1e-9);
  EXPECT_EQ(parseColumnNames("time_us x y z")->time_unit_s, 1e-6);
  EXPECT_EQ(parseColumnNames("t [ms];x;y;z")->time_unit_s, 1e-3);
  EXPECT_EQ(parseColumnNames("t;x;y;z")->time_unit_s, std::nullopt);
  EXPECT_EQ(parseColumnNames("t;x [mm];y [mm];z [mm]")->position_unit_m, 1e-3);
  EXPECT_EQ(parseColumnNames("t;x [ft];y [ft];z [ft]")->conflict, "feet");
  for (const char* const line : {"sec,nsec,x,y,z", "header.stamp.sec,header.stamp.nanosec,x,y,z",
                                 "stamp.secs,stamp.nsecs,x,y,z", "time_sec,time_nsec,x,y,z"}) {
    const auto names = parseColumnNames(line);
    EXPECT_EQ(names->time, 0U) << line;
    EXPECT_EQ(names->nanoseconds, 1U) << line;
  }
  EXPECT_EQ(parseColumnNames("nsec,sec,x,y,z")->nanoseconds, 0U);
  // The stamp of the message counts before the time of its recording.
  EXPECT_EQ(parseColumnNames("%time,field.header.seq,field.header.stamp,x,y,z")->time, 2U);
  EXPECT_EQ(parseColumnNames("time,t,x,y,z")->conflict, "time");
  EXPECT_EQ(parseColumnNames("t,x,x,y,z")->conflict, "x");
  EXPECT_TRUE(parseColumnNames("time,lat,lon,height")->geographic);
  const std::array<std::size_t, 12> in_order = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11};
  for (const char* const line :
       {"m00 m01 m02 m03 m10 m11 m12 m13 m20 m21 m22 m23", "r11,r12,r13,tx,r21,r22,r23,ty,r31,r32,r33,tz",
        "T_0_0 T_0_1 T_0_2 T_0_3 T_1_0 T_1_1 T_1_2 T_1_3 T_2_0 T_2_1 T_2_2 T_2_3",
        "m11 m12 m13 m14 m21 m22 m23 m24 m31 m32 m33 m34 m41 m42 m43 m44",
        "r00;r01;r02;t0;r10;r11;r12;t1;r20;r21;r22;t2"})
    EXPECT_EQ(parseColumnNames(line)->matrix, in_order) << line;
}

TEST(ColumnNames, OfACommentCountOnlyIfTheyAreThoseOfTheColumns) {
  const TempFolder folder;
  const auto read = [&](const std::string& text) {
    return readPoseFile(folder.write("a.txt", text), PoseFormat::Auto, {}, false);
  };
  // 90 degrees about x, or about z where w is taken for the last.
  const std::string tum = "1 0 0 0 0.6 0 0 0.8\n";
  const auto turn = [](const PoseFile& file) { return file.poses.at(0).T_W_S.linear()(2, 1); };
  const double expected = turn(read(tum));
  EXPECT_NE(expected, 0);
  EXPECT_EQ(turn(read("# my format: timestamp tx ty tz qx qy qz qw\n" + tum)), expected);
  EXPECT_EQ(turn(read("# x y z were measured in the hall\n" + tum)), expected);
  EXPECT_EQ(turn(read("# time x y z qw qx qy qz\n1 0 0 0 0.8 0.6 0 0\n")), expected);
  EXPECT_EQ(turn(read("# time x y z qw qx qy qz number\n1 0 0 0 0.8 0.6 0 0 7\n")), expected);
  expectError([&] { (void)read("# x y z qw qx qy qz\n1 0 0 0 0.8 0.6 0 0\n"); }, ErrorCode::Input, "input.malformed",
              {"7 columns", "8"});
  expectError([&] { (void)read("# time x y z roll pitch yaw\n1 0 0 0 0 0 0\n"); }, ErrorCode::Input, "input.malformed",
              {"roll pitch yaw"});
}

TEST(ColumnReader, FindsTheUnitOfTimes) {
  const auto unit = [](double first, double step, std::optional<double> said = {}) {
    return timeUnit_s({first, first + step, first + 2 * step, first + 3 * step}, said, "t");
  };
  EXPECT_EQ(unit(0, 0.1), 1);
  EXPECT_EQ(unit(1.7e9, 0.1), 1);
  EXPECT_EQ(unit(1.7e12, 100), 1e-3);
  EXPECT_EQ(unit(1.7e15, 1e5), 1e-6);
  EXPECT_EQ(unit(1.7e18, 1e8), 1e-9);
  EXPECT_EQ(unit(5e12, 1e8), 1e-9);     // since the start, 1.4 h
  EXPECT_EQ(unit(0, 1e8, 1e-9), 1e-9);  // as said
  EXPECT_EQ(unit(1.7e18, 1e8, 1), 1e-9) << "cannot be seconds";
  expectError([&] { (void)unit(1.7e9, 0.1, 1e-9); }, ErrorCode::Input, "input.malformed", {"seconds"});
}

TEST(FileStamps, AreReadAlikeInAllNames) {
  const auto stamps = [](const std::vector<std::string>& stems) {
    const auto found = fileStamps(stems);
    return found ? found->stamps_s : std::vector<double>();
  };
  using V = std::vector<double>;
  EXPECT_EQ(stamps({"1700000000_5000", "1700000000_100000000"}), (V{1700000000.000005, 1700000000.1}));
  EXPECT_EQ(stamps({"1700000000.50000000", "1700000000.100000000"}), (V{1700000000.05, 1700000000.1}));
  EXPECT_EQ(stamps({"1700000000.5", "1700000000.25"}), (V{1700000000.5, 1700000000.25}));
  EXPECT_EQ(stamps({"1700000000-500000", "1700000001-000000"}), (V{1700000000.5, 1700000001}));
  EXPECT_EQ(stamps({"1.5", "10.25"}), (V{1.5, 10.25}));
  EXPECT_EQ(stamps({"2023-05-01-12-30-00-123456"}), V{1682944200.123456});
  EXPECT_EQ(stamps({"20230501_123000.123"}), V{1682944200.123});
  EXPECT_EQ(stamps({"20230501123000123"}), V{1682944200.123});
  EXPECT_EQ(stamps({"2023-05-01T12:30:00.5Z"}), V{1682944200.5});
  EXPECT_EQ(stamps({"2023-05-01T14:30:00.5+02:00"}), V{1682944200.5});
  EXPECT_EQ(stamps({"lidar_1700000000.5_front2", "lidar_1700000001.5_front2"}), (V{1700000000.5, 1700000001.5}));
  // Numbers behind the time of a recording are numbers.
  EXPECT_EQ(stamps({"1700000000_001", "1700000000_002"}), V());
  EXPECT_EQ(stamps({"1700000000_1", "1700000000_12"}), V());
  EXPECT_EQ(stamps({"2023-05-01-12-30-00_000001", "2023-05-01-12-30-00_000002"}), V());
  EXPECT_EQ(stamps({"2023-05-01-12-30-00-a1", "2023-05-01-12-30-00-a2"}), V());
  EXPECT_EQ(stamps({"2023-13-01-12-30-00"}), V());
  EXPECT_EQ(stamps({"scan1", "1700000000.5"}), V());
  EXPECT_TRUE(sortDifferentlyAsText({"scan2", "scan10"}));
  EXPECT_FALSE(sortDifferentlyAsText({"scan02", "scan10"}));
}

}  // namespace
}  // namespace accessvdb::io

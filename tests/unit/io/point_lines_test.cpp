// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Text with points, as other programs export it: each spelling is read right or refused by name.
#include "io/streams/point_lines.h"

#include <cmath>
#include <cstdio>

#include "accessvdb/scan_io.h"
#include "unit/io/cloud_parts.h"

namespace accessvdb::io {
namespace {

using test::expectError;
using test::TempFolder;

PointCloud readText(const std::string& text, const ReadOptions& options = {}) {
  const TempFolder folder;
  return test::readInParts(folder.write("a.xyz", text), ScanKind::Xyz, options);
}

void expectRefused(const std::string& text, const std::string& id, const std::vector<std::string>& words = {}) {
  SCOPED_TRACE(text);
  expectError([&] { (void)readText(text); }, ErrorCode::Input, id, words);
}

void expectTwoPoints(const std::string& text) {
  SCOPED_TRACE(text);
  const PointCloud cloud = readText(text);
  ASSERT_EQ(cloud.points.size(), 2U);
  EXPECT_EQ(cloud.points[0], Eigen::Vector3d(2.5, -1.25, 3));
  EXPECT_EQ(cloud.points[1], Eigen::Vector3d(1, 2, 0.5));
}

TEST(PointLines, ReadsColumnsByTheirNames) {
  for (const char* const text :
       {"2.5 -1.25 3\n1 2 .5\n", "X Y Z\n2.5 -1.25 3\n1 2 .5\n", "x,y,z,intensity\n2.5,-1.25,3,9\n1,2,.5,9\n",
        "\xef\xbb\xbf\"X\";\"Y\";\"Z\"\r\n2.5;-1.25;3\r\n1;2;.5\r\n",
        "//X Y Z R G B\n2.5 -1.25 3 1 2 3\n1 2 .5 1 2 3\n", "2\n2.5 -1.25 3\n1 2 .5\n",
        "2\r\n2.5 -1.25 3 0\r\n1 2 .5 0\r\n", "//X Y Z\n2\n2.5 -1.25 3\n1 2 .5\n", "1\n2.5 -1.25 3\n1\n1 2 .5\n",
        "# a comment\nX(m)\tY(m)\tZ(m)\n2.5\t-1.25\t3\n1\t2\t.5\n",
        "x [m] y [m] z [m] intensity [%]\n2.5 -1.25 3 7\n1 2 .5 7\n", "intensity,z,y,x\n7,3,-1.25,2.5\n7,.5,2,1\n",
        "# intensity x y z\n7 2.5 -1.25 3\n7 1 2 .5\n", "time,Easting,Northing,Height\n0,2.5,-1.25,3\n0,1,2,.5\n",
        "nx ny nz x y z\n0 0 1 2.5 -1.25 3\n0 0 1 1 2 .5\n", "\"2.5\",\"-1.25\",\"3\"\n\"1\",\"2\",\".5\"\n",
        "# points of x y z, and more words\n2.5 -1.25 3 7\n1 2 .5 7\n", "2.5, -1.25, 3\n1, 2, 0.5\n"})
    expectTwoPoints(text);
}

TEST(PointLines, NamesMayHaveBlanksAndUnitsOfTheirOwn) {
  for (const char* const text :
       {"Timestamp,LiDAR Index,X,Y,Z\n1,0,2.5,-1.25,3\n1,0,1,2,.5\n",
        "Point ID\tX\tY\tZ\n7\t2.5\t-1.25\t3\n8\t1\t2\t.5\n", "Point No;X [m];Y [m];Z [m]\n7;2.5;-1.25;3\n8;1;2;.5\n",
        "\"Point No\" ; \"X\" ; \"Y\" ; \"Z\"\r\n7;2.5;-1.25;3\r\n8;1;2;.5\r\n",
        "TIMESTAMP (ns), RANGE (mm), X (m), Y (m), Z (m)\n1, 2000, 2.5, -1.25, 3\n1, 2000, 1, 2, .5\n",
        "intensity (dB),x,y,z\n7,2.5,-1.25,3\n7,1,2,.5\n", "time (ns) x (m) y (m) z (m)\n7 2.5 -1.25 3\n7 1 2 .5\n",
        "# Point No, X, Y, Z\n7,2.5,-1.25,3\n8,1,2,.5\n", "X,Y,Z,Return Number,GPS Time\n2.5,-1.25,3,1,7\n1,2,.5,1,7\n",
        "X Y Z,intensity (dB)\n2.5 -1.25 3 7\n1 2 .5 7\n", "# R G B,X,Y,Z\n9 9 9 2.5 -1.25 3\n9 9 9 1 2 .5\n",
        ",x,y,z\n0,2.5,-1.25,3\n1,1,2,.5\n", "\tx\ty\tz\n0\t2.5\t-1.25\t3\n1\t1\t2\t.5\n",
        "\tx\ty\tz\n\t2.5\t-1.25\t3\n\t1\t2\t.5\n", "#\tX\tY\tZ\n2.5\t-1.25\t3\t7\n1\t2\t.5\t7\n",
        "N;E;H\n-1.25;2.5;3\n2;1;.5\n", "X\t\tY\t\tZ\n2.5\t\t-1.25\t\t3\n1\t\t2\t\t.5\n"})
    expectTwoPoints(text);
  for (const auto& [text, unit] : {std::pair("Easting (US ft);Northing (US ft);Elev (US ft)\n1;2;3\n", "usft"),
                                   {"E(ftUS),N(ftUS),H(ftUS)\n1,2,3\n", "ftus"},
                                   {"time (ns),X (mm),Y (mm),Z (mm)\n1,2,3,4\n", "mm"},
                                   {"X (US ft) Y (US ft) Z (US ft)\n1 2 3\n", "usft"},
                                   {"Point ID,x ft,y ft,z ft\n1,2,3,4\n", "ft"}})
    expectRefused(text, "input.unit", {unit});
}

TEST(PointLines, RefusesThousandsSeparators) {
  for (const char* const text :
       {"1 2 3\n4,002.345 -1.453 0.864\n", "500,003.000 5,399,998.547 0.864\n", "500,003 5,399,998 1\n",
        "500,003.000\t5,399,998.547\t0.864\n", "4,002.345;-1.453;0.864\n", "-4,002.345, -1.453, 0.864\n",
        "\"4,002.345\",\"-1.453\",\"0.864\"\n", "4.002,345 -1,453 0,864\n", "5.399.998,547;1,5;2,5\n",
        "500'003.000 5'399'998.547 0.864\n"})
    expectRefused(text, "input.thousands_separator", {"thousands"});
  for (const char* const text : {"4,002.345,1\n", "4,002.345,1,2,3,4\n", "4, 002.345, 1\n", "4,002.345,1 7\n"})
    EXPECT_EQ(readText(text).points[0], Eigen::Vector3d(4, 2.345, 1)) << text;
  EXPECT_EQ(readText("1,200,300 255 0 1\n").points[0], Eigen::Vector3d(1, 200, 300));
}

TEST(PointLines, RefusesDegrees) {
  const auto lines = [](double scale, int decimals, double x, double y) {
    std::string text;
    for (int i = 0; i < 50; ++i) {
      char line[100];
      std::snprintf(line, sizeof line, "%.*f %.*f %.3f\n", decimals, x + scale * (i % 7), decimals, y - scale * (i % 5),
                    0.05 * i);
      text += line;
    }
    return text;
  };
  for (const auto& [x, y] : {std::pair(48.1, 11.5), {11.5, 48.1}, {-122.4, 37.7}, {-33.8, 151.2}}) {
    expectRefused(lines(1e-5, 8, x, y), "input.geographic", {"degrees"});
    expectRefused("0 0 0\n" + lines(1e-4, 7, x, y), "input.geographic", {"degrees"});
    expectRefused(lines(1e-3, 7, x, y), "input.geographic", {"degrees"});
    expectRefused("x,y,z\n" + lines(1e-5, 8, x, y), "input.geographic", {"degrees"});
  }
  // Posts of 6 cm and of 2 cm, one far from zero, a scene of metres, few decimals.
  for (const std::string& text :
       {lines(0.01, 6, 2.5, 1), lines(0.003, 6, 2.5, 1), lines(0.005, 3, 48, 11), lines(1, 8, 48, 11),
        lines(1e-4, 5, 48, 11), lines(1e-5, 8, 480, 11), lines(1e-5, 8, 100, 100)})
    EXPECT_EQ(readText(text).points.size(), 50U);
}

TEST(PointLines, NamesCarriageReturnsOfLargeFiles) {
  std::string text;
  while (text.size() < 2 * kMaxLineBytes) text += "2.5 -1.25 3\r";
  expectRefused(text, "input.malformed", {"carriage returns", "mac2unix"});
  expectRefused(std::string(2 * kMaxLineBytes, '7'), "input.malformed", {"longer"});
}

TEST(PointLines, CountsWhatIsNotFinite) {
  for (const char* const word :
       {"nan",     "NaN",      "NAN",    "-nan",    "nan(ind)", "-nan(ind)", "1.#QNAN",  "1.#QNAN0",
        "-1.#IND", "1.#IND00", "1.#INF", "-1.#INF", "inf",      "-Inf",      "Infinity", "null",
        "NULL",    "N/A",      "na",     "None",    "\"\"",     "\"nan\""}) {
    const PointCloud cloud = readText(std::string("1,2,3\n4,") + word + ",6\n7,8,9\n");
    ASSERT_EQ(cloud.points.size(), 3U) << word;
    EXPECT_FALSE(std::isfinite(cloud.points[1].y())) << word;
    EXPECT_EQ(cloud.points[1].z(), 6) << word;
  }
  for (const char* const line : {"4,,6", "4, ,6", "4;;6"})
    EXPECT_TRUE(std::isnan(readText(std::string("1,2,3\n") + line + "\n").points[1].y())) << line;
}

TEST(PointLines, RefusesDecimalCommas) {
  for (const char* const text :
       {"2,6020 0,1721 0,0000\n", "2,6020;0,1721;0,0000\n", "2,6020\t0,1721\t0,0000\n", "3 0 0\n2,6020 0 1\n",
        "2,6020, 0,1721, 0,0000\n", "\"2,6020\",\"0,1721\",\"0,0000\"\n", "2,6020,0,1721,0,0426\n",
        "x;y;z\n2,6;0,17;-0,5\n", "1,5e3 2,5e0 0\n"})
    expectRefused(text, "input.decimal_comma", {"decimal commas"});
  EXPECT_EQ(readText("2,6020,0\n1,2,3,4,5,6\n").points[0], Eigen::Vector3d(2, 6020, 0));
  EXPECT_EQ(readText("1,2,3 255 0 1\n").points[0], Eigen::Vector3d(1, 2, 3));
}

TEST(PointLines, RefusesWhatItWouldMisread) {
  expectRefused("latitude,longitude,height\n1,2,3\n", "input.geographic", {"latitude"});
  expectRefused("x_ft,y_ft,z_ft\n1,2,3\n", "input.unit", {"ft"});
  expectRefused("X (mm) Y (mm) Z (mm)\n1 2 3\n", "input.unit", {"mm"});
  expectRefused("a b c\n1 2 3\n", "input.malformed", {"line 1"});
  expectRefused("x y z\n1 2 3\nx y z\n", "input.malformed", {"line 3"});
  expectRefused("GPS time x y z\n7 1 2 3\n", "input.malformed", {"columns"});
  expectRefused("1 2 3\r4 5 6\r", "input.malformed", {"carriage"});
  expectRefused("1\n1 2 3\n4 5 6\n", "input.malformed", {"line 3", "1 points"});
  expectRefused("3\n1 2 3\n4 5 6\n", "input.truncated", {"3 points"});
  const PointCloud cut = readText("3\n1 2 3\n4 5 6\n", {.allow_truncated = true});
  EXPECT_EQ(cut.points.size(), 2U);
  EXPECT_EQ(cut.truncated_points, 1U);
}

std::string wide(const std::string& text, std::size_t width, bool big) {
  std::string out;
  for (const char c : text) {
    std::string letter(width, '\0');
    letter[big ? width - 1 : 0] = c;
    out += letter;
  }
  return out;
}

TEST(PointLines, NamesUtf16And32) {
  using namespace std::string_literals;
  for (const bool big : {false, true})
    for (const std::string& mark : {""s, big ? "\xfe\xff"s : "\xff\xfe"s})
      expectRefused(mark + wide("1 2 3\r\n4 5 6\r\n", 2, big), "input.encoding", {"UTF-16"});
  expectRefused("\xff\xfe\0\0"s + wide("1 2 3\n", 4, false), "input.encoding", {"UTF-32"});
  expectRefused(wide("1 2 3\n4 5 6\n", 4, true), "input.encoding", {"UTF-32"});
  const TempFolder folder;
  expectError([&] { (void)test::readPcd(folder.write("a.pcd", wide("VERSION 0.7\nFIELDS x y z\n", 2, false)), {}); },
              ErrorCode::Input, "input.encoding", {"UTF-16"});
}

TEST(PointLines, PositionsFollowTheSameRules) {
  const TempFolder folder;
  const auto read = [&](const char* text) { return readPositions(folder.write("p.txt", text)); };
  const Eigen::Vector3d p(1, 2, 3);
  for (const char* const text : {"X,Y,Z\n1,2,3\n", "name;z;y;x\n7;3;2;1\n", "1\n1 2 3\n"})
    EXPECT_EQ(read(text).at(0), p) << text;
  expectError([&] { (void)read("2,6020 0,1721 0,0000\n"); }, ErrorCode::Input, "input.decimal_comma", {"line 1"});
  expectError([&] { (void)read("x y z\n1 2 n/a\n"); }, ErrorCode::Input, "input.malformed", {"line 2"});
  expectError([&] { (void)read("2\n1 2 3\n"); }, ErrorCode::Input, "input.truncated", {"2 positions"});
}

}  // namespace
}  // namespace accessvdb::io

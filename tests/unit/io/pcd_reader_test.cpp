// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <sys/stat.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>

#include "unit/io/cloud_parts.h"

namespace accessvdb::io {
namespace {

using test::expectError;
using test::readPcd;
using test::TempFolder;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

std::string pcdHeader(const std::string& points, const std::string& data, const std::string& fields = "x y z",
                      const std::string& size = "4 4 4", const std::string& type = "F F F") {
  return "# .PCD v0.7\nVERSION 0.7\nFIELDS " + fields + "\nSIZE " + size + "\nTYPE " + type + "\nWIDTH " + points +
         "\nHEIGHT 1\nPOINTS " + points + "\nDATA " + data + "\n";
}

std::string floats(const std::vector<float>& values) {
  std::string bytes;
  for (const float value : values) test::put(bytes, value);
  return bytes;
}

TEST(PcdReader, TakesFieldsInAnyOrderOfAnyTypeAndSize) {
  const TempFolder folder;
  std::string body;
  for (int i = 0; i < 3; ++i) {
    test::put(body, std::uint8_t{9});
    test::put(body, 5600000.125 + i);  // z, as double
    for (int k = 0; k < 3; ++k) test::put(body, std::int16_t{4});
    test::put(body, 1.5F + static_cast<float>(i));  // x
    test::put(body, std::int32_t{-7 - i});          // y
  }
  const std::string fields = "FIELDS ring z hist x y\nSIZE 1 8 2 4 4\nTYPE U F I F I\nCOUNT 1 1 3 1 1\n";
  const auto path = folder.write("a.pcd", fields + "WIDTH 3\nHEIGHT 1\nPOINTS 3\nDATA binary\n" + body);
  const PointCloud cloud = readPcd(path, {});
  ASSERT_EQ(cloud.points.size(), 3U);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(cloud.points[i], Eigen::Vector3d(1.5 + i, -7 - i, 5600000.125 + i));
  const auto text =
      folder.write("t.pcd", fields + "WIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n9 5600000.125 4 4 4 1.5 -7\n");
  EXPECT_EQ(readPcd(text, {}).points.at(0), Eigen::Vector3d(1.5, -7, 5600000.125));
}

TEST(PcdReader, BelievesPointsWhereWidthAndHeightAreZero) {
  const TempFolder folder;
  const std::string text =
      "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 0\nHEIGHT 0\nPOINTS 2\nDATA binary\n";
  EXPECT_EQ(readPcd(folder.write("a.pcd", text + floats({1, 2, 3, 4, 5, 6})), {}).points.at(1),
            Eigen::Vector3d(4, 5, 6));
  expectError(
      [&] {
        (void)readPcd(folder.write("b.pcd", text + floats({1, 2, 3, 4, 5})), {});
      },
      ErrorCode::Input, "input.truncated",
      {"b.pcd", "2 points (24 bytes)", "20 bytes", "1 complete", "allow_truncated"});
}

TEST(PcdReader, PassesBadValuesOnAndAcceptsAnEmptyCloud) {
  const TempFolder folder;
  const auto path =
      folder.write("a.pcd", pcdHeader("4", "ascii") + "nan 1 2\n0 0 0\n1e30 -inf 1e999\n-1e-999 +2 1e-3\n");
  const PointCloud cloud = readPcd(path, {});
  ASSERT_EQ(cloud.points.size(), 4U);
  EXPECT_TRUE(std::isnan(cloud.points[0][0]));
  EXPECT_EQ(cloud.points[1], Eigen::Vector3d::Zero());
  EXPECT_EQ(cloud.points[2][0], 1e30);
  EXPECT_TRUE(std::isinf(cloud.points[2][1]) && cloud.points[2][1] < 0);
  EXPECT_TRUE(std::isinf(cloud.points[2][2]) && cloud.points[2][2] > 0);
  EXPECT_EQ(cloud.points[3], Eigen::Vector3d(0, 2, 1e-3));
  const auto binary = folder.write("b.pcd", pcdHeader("1", "binary") + floats({kNan, 0, 1e30F}));
  EXPECT_TRUE(std::isnan(readPcd(binary, {}).points.at(0)[0]));
  EXPECT_TRUE(readPcd(folder.write("c.pcd", pcdHeader("0", "ascii")), {}).points.empty());
  EXPECT_TRUE(readPcd(folder.write("d.pcd", pcdHeader("0", "binary_compressed")), {}).points.empty());
}

TEST(PcdReader, ReadsWindowsLineEndsAndAByteOrderMark) {
  const TempFolder folder;
  std::string text = pcdHeader("2", "ascii") + "1 2 3\n4 5 6\n";
  std::string windows = "\xef\xbb\xbf";
  for (const char c : text) windows += c == '\n' ? std::string("\r\n") : std::string(1, c);
  EXPECT_EQ(readPcd(folder.write("a.pcd", windows), {}).points.at(1), Eigen::Vector3d(4, 5, 6));
}

TEST(PcdReader, RefusesWhatIsNoPcd) {
  const TempFolder folder;
  const auto refuse = [&](const std::string& bytes, const std::string& id, const std::vector<std::string>& words = {}) {
    expectError([&] { (void)readPcd(folder.write("a.pcd", bytes), {}); }, ErrorCode::Input, id, words);
  };
  refuse("", "input.empty", {"a.pcd", "0 bytes"});
  refuse("version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 5\n", "input.lfs_pointer", {"git lfs pull"});
  refuse("hello world\nthis is text\n", "input.malformed", {"line 1", "hello"});
  refuse("FIELDS x y z\n", "input.malformed", {"no DATA line"});
  refuse(std::string("FIELDS x y z\0\n", 14), "input.malformed");
  refuse(std::string(200000, 'a'), "input.malformed", {"65536"});
  refuse(pcdHeader("1", "zipped") + "1 2 3\n", "input.malformed", {"zipped"});
  refuse(pcdHeader("-1", "ascii") + "1 2 3\n", "input.malformed", {"-1"});
  refuse(pcdHeader("1", "ascii", "a y z") + "1 2 3\n", "input.malformed", {"without a field x"});
  refuse(pcdHeader("1", "ascii", "x y z", "4 4") + "1 2 3\n", "input.malformed");
  refuse(pcdHeader("1", "ascii", "x y z", "4 4 3") + "1 2 3\n", "input.malformed", {"SIZE 3"});
  refuse(pcdHeader("1", "ascii", "x y z", "4 4 0") + "1 2 3\n", "input.malformed");
  refuse(pcdHeader("1", "ascii", "x y z", "4 4 4", "F F Q") + "1 2 3\n", "input.malformed", {"Q"});
  refuse(pcdHeader("2", "ascii") + "1 2\n3 4 5\n", "input.malformed", {"2 values"});
  refuse(pcdHeader("1", "ascii") + "1 2 0x3\n", "input.malformed", {"not a number"});
  refuse(pcdHeader("1", "ascii") + "1,5 2 3\n", "input.decimal_comma");
  refuse("FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 3\nHEIGHT 2\nPOINTS 5\nDATA ascii\n1 2 3\n", "input.malformed",
         {"WIDTH"});
  refuse("FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 9999999\nWIDTH 1\nHEIGHT 1\nDATA ascii\n1 2 3\n",
         "input.malformed");
}

TEST(PcdReader, RefusesFoldersPipesAndMissingFiles) {
  const TempFolder folder;
  expectError([&] { (void)readPcd(folder.path(), {}); }, ErrorCode::Input, "input.not_a_file", {"folder"});
  expectError([&] { (void)readPcd(folder.path() / "none.pcd", {}); }, ErrorCode::Input, "input.missing", {"none.pcd"});
  const auto pipe = folder.path() / "pipe.pcd";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  expectError([&] { (void)readPcd(pipe, {}); }, ErrorCode::Input, "input.not_a_file");
}

TEST(PcdReader, RefusesLyingHeadersBeforeItAllocates) {
  const TempFolder folder;
  for (const char* points :
       {"2147483647", "2147483648", "4294967295", "4294967297", "9223372036854775808", "18446744073709551615"})
    for (const char* data : {"ascii", "binary"}) {
      const auto path = folder.write("a.pcd", pcdHeader(points, data) + std::string(40, '1') + "\n");
      expectError([&] { (void)readPcd(path, {}); }, ErrorCode::Input,
                  std::string(data) == "ascii" ? "input.malformed" : "input.truncated");
    }
  // A decompression bomb: 16 bytes that claim to become 4 GB, with a matching header.
  std::string body;
  test::put(body, std::uint32_t{16});
  test::put(body, std::uint32_t{4294967292U});
  const auto bomb = folder.write("b.pcd", pcdHeader("357913941", "binary_compressed") + body + std::string(16, '\0'));
  expectError([&] { (void)readPcd(bomb, {}); }, ErrorCode::Input, "input.malformed", {"4294967292"});
  // Two points as one literal run of LZF, field after field: right with 2, refused with any other count.
  body.clear();
  test::put(body, std::uint32_t{25});
  test::put(body, std::uint32_t{24});
  body += static_cast<char>(24 - 1) + floats({1, 4, 2, 5, 3, 6});
  EXPECT_EQ(readPcd(folder.write("d.pcd", pcdHeader("2", "binary_compressed") + body), {}).points.at(1),
            Eigen::Vector3d(4, 5, 6));
  for (const char* points : {"1", "3", "200", "1537228672809129302"}) {  // the last times 12 is 2^64 + 8
    const auto wrong = folder.write("e.pcd", pcdHeader(points, "binary_compressed") + body);
    expectError([&] { (void)readPcd(wrong, {}); }, ErrorCode::Input, "input.malformed", {"24 bytes from 25"});
  }
  // Matching sizes, around bytes that are not LZF.
  body.clear();
  test::put(body, std::uint32_t{3});
  test::put(body, std::uint32_t{24});
  const auto junk = folder.write("c.pcd", pcdHeader("2", "binary_compressed") + body + "\xff\xff\xff");
  expectError([&] { (void)readPcd(junk, {}); }, ErrorCode::Input, "input.malformed", {"damaged"});
}

TEST(PcdReader, SaysWhatFollowsTheLastPoint) {
  const TempFolder folder;
  const PointCloud cloud = readPcd(folder.write("a.pcd", pcdHeader("1", "binary") + floats({1, 2, 3, 4})), {});
  EXPECT_EQ(cloud.points.size(), 1U);
  EXPECT_TRUE(test::anyContains(cloud.notices, "4 bytes after the last point"));
}

/// Every prefix: an InputError, or with allow_truncated exactly the complete records.
void cutEverywhere(const std::string& file, std::size_t header_bytes,
                   const std::function<std::size_t(std::size_t)>& complete, std::size_t points) {
  const TempFolder folder;
  for (std::size_t size = 0; size < file.size(); ++size) {
    const auto path = folder.write("a.pcd", file.substr(0, size));
    EXPECT_THROW((void)readPcd(path, {}), InputError) << size;
    if (size < header_bytes) {
      EXPECT_THROW((void)readPcd(path, {true, false}), InputError) << size;
      continue;
    }
    const PointCloud cloud = readPcd(path, {true, false});
    EXPECT_EQ(cloud.points.size(), complete(size - header_bytes)) << size;
    EXPECT_EQ(cloud.points.size() + cloud.truncated_points, points) << size;
  }
  EXPECT_EQ(readPcd(folder.write("a.pcd", file), {}).points.size(), points);
}

TEST(PcdReader, SurvivesACutAtEveryByte) {
  const std::string binary = pcdHeader("3", "binary");
  cutEverywhere(
      binary + floats({1, 2, 3, 4, 5, 6, 7, 8, 9}), binary.size(), [](std::size_t body) { return body / 12; }, 3);
  const std::string ascii = pcdHeader("3", "ascii");
  // Lines of 6 bytes. The last line feed may be missing, so a file without it is not truncated: skip that case.
  cutEverywhere(
      ascii + "1 2 3\n1 2 3\n1 2 3", ascii.size(), [](std::size_t body) { return body / 6; }, 3);
}

TEST(PcdReader, FindsTheViewpoint) {
  const TempFolder folder;
  const std::string text =
      "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nVIEWPOINT 1 2 3 0.5 -0.5 0.5 0.5\nDATA ascii\n1 2 3\n";
  const auto viewpoint = readPcdViewpoint(folder.write("a.pcd", text));
  ASSERT_TRUE(viewpoint.has_value());
  EXPECT_EQ(*viewpoint, (std::array<double, 7>{1, 2, 3, 0.5, -0.5, 0.5, 0.5}));
  EXPECT_FALSE(readPcdViewpoint(folder.write("b.pcd", pcdHeader("1", "ascii") + "1 2 3\n")).has_value());
}

struct PcdFile {
  const char* name;
  std::size_t points;
};
std::ostream& operator<<(std::ostream& out, const PcdFile& file) { return out << file.name; }
class PcdReaderReal : public ::testing::TestWithParam<PcdFile> {};

TEST_P(PcdReaderReal, HasTheCountOfItsReadme) {
  ACCESSVDB_NEED_DATA(path, GetParam().name);
  const PointCloud cloud = readPcd(path, {});
  EXPECT_EQ(cloud.points.size(), GetParam().points);
}
INSTANTIATE_TEST_SUITE_P(Files, PcdReaderReal,
                         ::testing::Values(PcdFile{"pcd_misc/bunny.pcd", 397}, PcdFile{"pcd_misc/car6.pcd", 10031},
                                           PcdFile{"pcd_misc/colored_cloud.pcd", 1000},
                                           PcdFile{"pcd_misc/fraslab_scans_compressed_viewpoint.pcd", 5779},
                                           PcdFile{"pcd_misc/lamppost.pcd", 1771},
                                           PcdFile{"pcd_misc/milk_color.pcd", 13704},
                                           PcdFile{"pcd_misc/rops_cloud.pcd", 32087},
                                           PcdFile{"livox_mid360/frame_20240509061326.pcd", 19965},
                                           PcdFile{"livox_mid360/fastlio_scans.pcd", 57075},
                                           PcdFile{"scans_poses_balm/full107.pcd", 68513}));

TEST(PcdReader, ReadsTheRealFileThatPclRefuses) {
  ACCESSVDB_NEED_DATA(path, "livox_mlcc/lidar2_12.pcd");
  const PointCloud cloud = readPcd(path, {});
  ASSERT_EQ(cloud.points.size(), 246427U);
  Eigen::AlignedBox3d box;
  for (const auto& p : cloud.points) box.extend(p);
  // The README gives three decimals or four digits.
  EXPECT_LT((box.min() - Eigen::Vector3d(0.955, -52.74, -0.579)).cwiseAbs().maxCoeff(), 5.1e-3);
  EXPECT_LT((box.max() - Eigen::Vector3d(60.4, -0.567, 16.24)).cwiseAbs().maxCoeff(), 5.1e-2);
}

}  // namespace
}  // namespace accessvdb::io

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "unit/io/cloud_parts.h"

namespace accessvdb::io {
namespace {

using test::expectError;
using test::readPly;
using test::TempFolder;

std::string header(const std::string& format, const std::string& count, const std::string& before = "",
                   const std::string& properties = "property float x\nproperty double y\nproperty int z\n") {
  return "ply\nformat " + format + " 1.0\ncomment made here\n" + before + "element vertex " + count + "\n" +
         properties + "end_header\n";
}

template <typename T>
void putOrdered(std::string& bytes, T value, bool big_endian) {
  std::string raw;
  test::put(raw, value);
  if (big_endian) std::reverse(raw.begin(), raw.end());
  bytes += raw;
}

TEST(PlyReader, ReadsTextAndBothByteOrders) {
  const TempFolder folder;
  for (const std::string format : {"ascii", "binary_little_endian", "binary_big_endian"}) {
    std::string body;
    for (int i = 0; i < 3; ++i) {
      const bool big = format == "binary_big_endian";
      if (format == "ascii") {
        body += std::to_string(i) + ".5 5600000.125 " + std::to_string(-i) + "\n";
        continue;
      }
      putOrdered(body, static_cast<float>(i) + 0.5F, big);
      putOrdered(body, 5600000.125, big);
      putOrdered(body, std::int32_t{-i}, big);
    }
    const PointCloud cloud = readPly(folder.write("a.ply", header(format, "3") + body), {});
    ASSERT_EQ(cloud.points.size(), 3U) << format;
    for (int i = 0; i < 3; ++i) EXPECT_EQ(cloud.points[i], Eigen::Vector3d(i + 0.5, 5600000.125, -i)) << format;
  }
}

TEST(PlyReader, StepsOverListsAndElementsBeforeTheVertices) {
  const TempFolder folder;
  const std::string before = "element camera 1\nproperty double f\nelement face 2\nproperty list uchar short v\n";
  std::string body;
  test::put(body, 35.0);
  for (const int n : {3, 0}) {
    test::put(body, static_cast<std::uint8_t>(n));
    for (int k = 0; k < n; ++k) test::put(body, std::int16_t{1});
  }
  const std::string lists = "property float x\nproperty list uchar float w\nproperty float y\nproperty float z\n";
  for (int i = 0; i < 2; ++i) {
    test::put(body, 1.0F);
    test::put(body, std::uint8_t{2});
    test::put(body, 9.0F);
    test::put(body, 9.0F);
    test::put(body, 2.0F);
    test::put(body, static_cast<float>(i));
  }
  const std::string file = header("binary_little_endian", "2", before, lists) + body;
  const PointCloud cloud = readPly(folder.write("a.ply", file), {});
  ASSERT_EQ(cloud.points.size(), 2U);
  EXPECT_EQ(cloud.points[1], Eigen::Vector3d(1, 2, 1));
  const std::size_t vertices = file.size() - 42;
  for (std::size_t size = 0; size < file.size(); ++size) {
    const auto path = folder.write("b.ply", file.substr(0, size));
    EXPECT_THROW((void)readPly(path, {}), InputError) << size;
    if (size < vertices) {
      EXPECT_THROW((void)readPly(path, {true, false}), InputError) << size;
    } else {
      EXPECT_EQ(readPly(path, {true, false}).points.size(), (size - vertices) / 21) << size;
    }
  }
}

TEST(PlyReader, FollowsTheRayCloudConvention) {
  const TempFolder folder;
  const std::string properties =
      "property float x\nproperty float y\nproperty float z\nproperty double time\nproperty float nx\nproperty float "
      "ny\n"
      "property float nz\nproperty uchar red\nproperty uchar alpha\n";
  const auto path = folder.write("a.ply", header("ascii", "00000000000000000002", "", properties) +
                                              "1 2 3 100.5 -1 -2 -3 0 255\n4 5 6 100.6 1 0 0 0 0\n");
  const PointCloud cloud = readPly(path, {false, true});
  ASSERT_EQ(cloud.points.size(), 1U);  // the second ray hit nothing
  EXPECT_EQ(cloud.unbounded_rays, 1U);
  EXPECT_EQ(cloud.ray_vectors.at(0), Eigen::Vector3d(-1, -2, -3));
  EXPECT_EQ(cloud.stamps_s.at(0), 100.5);
  EXPECT_EQ(readPly(path, {}).points.size(), 2U);  // without rays alpha is a colour
  expectError(
      [&] {
        (void)readPly(folder.write("b.ply", header("ascii", "1") + "1 2 3\n"), {false, true});
      },
      ErrorCode::Input, "input.no_rays", {"nx ny nz", "sensor_at_W"});
}

TEST(PlyReader, RefusesWhatIsNoPly) {
  const TempFolder folder;
  const auto refuse = [&](const std::string& bytes, const std::string& id, const std::vector<std::string>& words = {}) {
    expectError([&] { (void)readPly(folder.write("a.ply", bytes), {}); }, ErrorCode::Input, id, words);
  };
  refuse("", "input.empty");
  refuse("plyx\n", "input.malformed", {"not a PLY file"});
  refuse("ply\nformat ascii 1.0\n", "input.malformed", {"ends inside the header"});
  refuse(header("text", "1") + "1 2 3\n", "input.malformed", {"format"});
  refuse(header("ascii", "-1") + "1 2 3\n", "input.malformed");
  refuse(header("ascii", "1", "", "property float x\nproperty float y\n") + "1 2\n", "input.malformed", {"property z"});
  refuse(header("ascii", "1", "", "property half x\n") + "1\n", "input.malformed", {"half"});
  refuse(header("ascii", "1") + "1 2 x\n", "input.malformed", {"not a number"});
  refuse(header("ascii", "2") + "1 2 3\n", "input.truncated", {"2", "1 complete"});
  refuse(header("binary_little_endian", "18446744073709551615") + "abc", "input.truncated");
  refuse(header("binary_little_endian", "1", "element a 18446744073709551615\nproperty double b\n") + "abc",
         "input.truncated");
  // A list of 2^32 - 1 entries in 8 bytes.
  refuse(header("binary_little_endian", "1", "element a 1\nproperty list uint double b\n") + std::string(8, '\xff'),
         "input.truncated");
  refuse("ply\nformat ascii 1.0\n" + std::string(70000, 'a') + "\n", "input.malformed", {"65536"});
}

TEST(PlyReader, SurvivesACutAtEveryByte) {
  const TempFolder folder;
  const std::string head = header("binary_little_endian", "3");
  const std::string file = head + std::string(3 * 16, '\0');
  for (std::size_t size = 0; size < file.size(); ++size) {
    const auto path = folder.write("a.ply", file.substr(0, size));
    EXPECT_THROW((void)readPly(path, {}), InputError) << size;
    if (size < head.size()) {
      EXPECT_THROW((void)readPly(path, {true, false}), InputError) << size;
      continue;
    }
    const PointCloud cloud = readPly(path, {true, false});
    EXPECT_EQ(cloud.points.size(), (size - head.size()) / 16) << size;
    EXPECT_EQ(cloud.truncated_points, 3 - cloud.points.size()) << size;
  }
}

TEST(PlyReader, ReadsOrRefusesRealOddFiles) {
  ACCESSVDB_NEED_DATA(folder, "bad_inputs");
  EXPECT_EQ(readPly(folder / "points.ply", {}).points.size(), 4U);
  // Its vertices announce a list that their lines do not contain.
  expectError([&] { (void)readPly(folder / "issue623.ply", {}); }, ErrorCode::Input, "input.unsupported", {"list"});
  expectError([&] { (void)readPly(folder / "empty.ply", {}); }, ErrorCode::Input, "input.empty");
}

}  // namespace
}  // namespace accessvdb::io

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Geometry>

#include "unit/io/cloud_parts.h"

namespace accessvdb::io {
namespace {

using test::readKittiBin;

std::string scan(int points) {
  std::string bytes;
  for (int i = 0; i < 4 * points; ++i) test::put(bytes, 0.25F * static_cast<float>(i));
  return bytes;
}

TEST(KittiBinReader, ReadsFourFloatsAPoint) {
  const test::TempFolder folder;
  const PointCloud cloud = readKittiBin(folder.write("a.bin", scan(3)), {});
  ASSERT_EQ(cloud.points.size(), 3U);
  EXPECT_EQ(cloud.points[2], Eigen::Vector3d(2, 2.25, 2.5));
}

/// Returns of a plane that is seen from above.
std::string plane(int points, const std::vector<float>& rest) {
  std::string bytes;
  for (int i = 0; i < points; ++i) {
    for (const float value : {3.0F + 0.01F * static_cast<float>(i % 17), 0.1F * static_cast<float>(i % 31 - 15), -1.7F})
      test::put(bytes, value);
    for (const float scale : rest) test::put(bytes, scale * static_cast<float>(i * 7 % 32));
  }
  return bytes;
}

TEST(KittiBinReader, TellsOtherRecordsByTheirValues) {
  const test::TempFolder folder;
  for (const int points : {1, 2, 4, 5, 10, 20, 30, 40, 100, 1000})
    for (const float scale : {0.0F, 1.0F / 32, 1.0F, 8.0F}) {
      const PointCloud cloud = readKittiBin(folder.write("a.bin", plane(points, {scale})), {});
      EXPECT_EQ(cloud.points.size(), static_cast<std::size_t>(points));
    }
  for (const int each : {2, 3, 5}) {  // one of these is no return
    std::string bytes = plane(1000, {1.0F / 32});
    for (std::size_t i = 0; i < bytes.size(); i += 16 * static_cast<std::size_t>(each)) bytes.replace(i, 16, 16, '\0');
    EXPECT_EQ(readKittiBin(folder.write("a.bin", bytes), {}).points.size(), 1000U) << each;
  }
  for (const int points : {40, 100, 1000}) {
    for (const auto& [rest, words] : {std::pair(std::vector<float>{}, "3 floats a point (12 bytes)"),
                                      {{8, 1}, "5 floats a point (20 bytes)"},
                                      {{0, 1}, "5 floats a point (20 bytes)"},
                                      {{8, 1, 1e-3F}, "6 floats a point (24 bytes)"}})
      test::expectError(
          [&, &bytes = rest] {
            (void)readKittiBin(folder.write("a.bin", plane(points, bytes)), {true, false});
          },
          ErrorCode::Input, "input.bin_layout", {words});
  }
}

TEST(KittiBinReader, SurvivesACutAtEveryByte) {
  const test::TempFolder folder;
  const std::string file = scan(3);
  test::expectError(
      [&] {
        (void)readKittiBin(folder.write("a.bin", ""), {true, false});
      },
      ErrorCode::Input, "input.empty");
  for (std::size_t size = 1; size <= file.size(); ++size) {
    const auto path = folder.write("a.bin", file.substr(0, size));
    if (size % 16 == 0) {
      EXPECT_EQ(readKittiBin(path, {}).points.size(), size / 16);
      continue;
    }
    test::expectError([&] { (void)readKittiBin(path, {}); }, ErrorCode::Input, "input.truncated",
                      {std::to_string(size) + " bytes is not a multiple of 16 (record " + std::to_string(size / 16)});
    const PointCloud cloud = readKittiBin(path, {true, false});
    EXPECT_EQ(cloud.points.size(), size / 16);
    EXPECT_EQ(cloud.truncated_points, 1U);
  }
}

TEST(KittiBinReader, AgreesWithTheReadmeOfRealScans) {
  ACCESSVDB_NEED_DATA(path, "kitti_00/velodyne/000000.bin");
  const PointCloud cloud = readKittiBin(path, {});
  ASSERT_EQ(cloud.points.size(), 124668U);
  Eigen::AlignedBox3d box;
  for (const auto& p : cloud.points) box.extend(p);
  // The README gives 4 digits.
  EXPECT_LT((box.min() - Eigen::Vector3d(-78.09, -55.72, -11.56)).cwiseAbs().maxCoeff(), 5.1e-3);
  EXPECT_LT((box.max() - Eigen::Vector3d(77.97, 44.88, 2.825)).cwiseAbs().maxCoeff(), 5.1e-3);
}

}  // namespace
}  // namespace accessvdb::io

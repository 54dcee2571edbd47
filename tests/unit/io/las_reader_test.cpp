// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Geometry>
#include <cmath>
#include <ostream>

#include "unit/io/cloud_parts.h"

namespace accessvdb::io {
namespace {

using test::expectError;
using test::readLas;
using test::TempFolder;

/// A LAS file made byte by byte from the specification.
struct LasFile {
  int minor = 2, format = 0;
  std::uint16_t record_bytes = 20, header_bytes = 227;
  std::uint32_t gap_bytes = 0;  ///< stands for variable length records
  double scale = 0.001;
  char kind = 0;
  std::uint64_t promised = 3;
  int points = 3;
  static constexpr double kOffsetY = 3810000.0;

  static Eigen::Vector3d truth(int i, double scale) {
    return {i * scale + 470000.0, 222123 * scale + kOffsetY, -i * scale};
  }

  [[nodiscard]] std::string bytes() const {
    std::string file("LASF", 4);
    file.resize(24, '\0');
    file += '\1';
    file += static_cast<char>(minor);
    file.resize(94, '\0');
    test::put(file, header_bytes);
    test::put(file, static_cast<std::uint32_t>(header_bytes + gap_bytes));
    test::put(file, std::uint32_t{0});
    file += static_cast<char>(format);
    test::put(file, record_bytes);
    test::put(file, minor == 4 ? std::uint32_t{0} : static_cast<std::uint32_t>(promised));
    file.resize(131, '\0');
    for (int axis = 0; axis < 3; ++axis) test::put(file, scale);
    for (const double offset : {470000.0, kOffsetY, 0.0}) test::put(file, offset);
    const Eigen::Vector3d first = truth(0, scale), last = truth(points - 1, scale);
    for (int axis = 0; axis < 3; ++axis) {
      test::put(file, std::max(first[axis], last[axis]));
      test::put(file, std::min(first[axis], last[axis]));
    }
    file.resize(247, '\0');
    if (minor == 4) test::put(file, promised);
    file.resize(header_bytes + gap_bytes, '\0');
    for (int i = 0; i < points; ++i) {
      const std::size_t begin = file.size();
      test::put(file, std::int32_t{i});
      test::put(file, std::int32_t{222123});
      test::put(file, std::int32_t{-i});
      file.resize(begin + record_bytes, '\x7f');
      file[begin + 15] = file[begin + 16] = kind;  // flags and class
    }
    return file;
  }
};

TEST(LasReader, ReadsEveryPointFormatInDoublePrecision) {
  constexpr std::uint16_t kBytes[] = {20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};
  const TempFolder folder;
  for (int format = 0; format <= 10; ++format)
    for (const int extra : {0, 5}) {
      LasFile las;
      las.format = format;
      las.minor = format >= 6 ? 4 : 2;
      las.header_bytes = las.minor == 4 ? 375 : 227;
      las.gap_bytes = 54;
      las.record_bytes = static_cast<std::uint16_t>(kBytes[format] + extra);
      const PointCloud cloud = readLas(folder.write("a.las", las.bytes()), {});
      ASSERT_EQ(cloud.points.size(), 3U);
      EXPECT_TRUE(cloud.notices.empty());
      for (int i = 0; i < 3; ++i) EXPECT_EQ(cloud.points[i], LasFile::truth(i, las.scale)) << format;
    }
}

TEST(LasReader, TakesTheOldCountWhereTheNewOneIsEmpty) {
  const TempFolder folder;
  LasFile las;
  las.minor = 4, las.header_bytes = 375, las.promised = 0;
  std::string bytes = las.bytes();
  bytes[107] = 3;
  EXPECT_EQ(readLas(folder.write("a.las", bytes), {}).points.size(), 3U);
}

TEST(LasReader, RefusesWhatCannotBe) {
  const TempFolder folder;
  const auto refuse = [&](std::string bytes, std::size_t at, const std::string& patch, const std::string& id,
                          const std::vector<std::string>& words = {}) {
    bytes.replace(at, patch.size(), patch);
    expectError([&] { (void)readLas(folder.write("a.las", bytes), {}); }, ErrorCode::Input, id, words);
  };
  const std::string good = LasFile().bytes();
  refuse(good, 0, "LASX", "input.malformed", {"LASF"});
  refuse(good, 25, "\5", "input.unsupported", {"1.5"});
  refuse(good, 104, "\x80", "input.unsupported", {"LAZ", "laszip"});
  refuse(good, 104, "\x0b", "input.unsupported", {"11"});
  refuse(good, 105, std::string("\x13\0", 2), "input.malformed", {"19"});
  refuse(good, 94, std::string("\x10\0", 2), "input.malformed");
  refuse(good, 96, "\xff\xff\xff\xff", "input.truncated");
  refuse(good, 131, std::string(8, '\0'), "input.malformed", {"scale"});
  refuse(good, 131, std::string("\0\0\0\0\0\0\xf8\x7f", 8), "input.malformed", {"scale"});
  refuse(good, 155, std::string("\0\0\0\0\0\0\xf0\x7f", 8), "input.malformed", {"offset"});
  LasFile las;
  las.promised = 4294967295U;
  refuse(las.bytes(), 0, "LASF", "input.truncated", {"4294967295 points", "60 bytes", "3 complete"});
  las.minor = 4, las.header_bytes = 375, las.promised = 1ULL << 63;
  refuse(las.bytes(), 0, "LASF", "input.truncated", {"9223372036854775808"});
}

TEST(LasReader, SaysHowManyPointsLieOutsideTheBoxOfTheHeader) {
  const TempFolder folder;
  std::string bytes = LasFile().bytes();
  bytes[227 + 20 + 3] = 1;  // second point: x by 2^24 steps
  const PointCloud cloud = readLas(folder.write("a.las", bytes), {});
  EXPECT_TRUE(test::anyContains(cloud.notices, "1 of 3 points are outside"));
}

TEST(LasReader, SurvivesACutAtEveryByte) {
  const TempFolder folder;
  LasFile las;
  las.gap_bytes = 10;
  const std::string file = las.bytes();
  for (std::size_t size = 0; size < file.size(); ++size) {
    const auto path = folder.write("a.las", file.substr(0, size));
    EXPECT_THROW((void)readLas(path, {}), InputError) << size;
    if (size < 237) {
      EXPECT_THROW((void)readLas(path, {true, false}), InputError) << size;
      continue;
    }
    const PointCloud cloud = readLas(path, {true, false});
    EXPECT_EQ(cloud.points.size(), (size - 237) / 20) << size;
    EXPECT_EQ(cloud.truncated_points, 3 - cloud.points.size()) << size;
  }
}

struct RealFile {
  const char* name;
  std::size_t points;
  Eigen::Vector3d min, extent;
};
std::ostream& operator<<(std::ostream& out, const RealFile& file) { return out << file.name; }
class LasReaderReal : public ::testing::TestWithParam<RealFile> {};

TEST_P(LasReaderReal, HasTheCountAndExtentOfItsReadme) {
  const RealFile& truth = GetParam();
  ACCESSVDB_NEED_DATA(path, truth.name);
  const PointCloud cloud = readLas(path, {});
  ASSERT_EQ(cloud.points.size(), truth.points);
  EXPECT_TRUE(cloud.notices.empty());
  Eigen::AlignedBox3d box;
  for (const auto& p : cloud.points) box.extend(p);
  // The README rounds to 2 decimals; a float32 would be off by up to 0.125 m in UTM.
  EXPECT_LT((box.min() - truth.min).cwiseAbs().maxCoeff(), 5.1e-3);
  EXPECT_LT((box.sizes() - truth.extent).cwiseAbs().maxCoeff(), 5.1e-3);
  // Points are whole steps of the scale, 0.0001 m, apart, which float32 cannot represent.
  for (const std::size_t i : {truth.points / 2, truth.points - 1})
    for (int axis = 0; axis < 3; ++axis) {
      const double steps = (cloud.points[i][axis] - cloud.points[0][axis]) / 1e-4;
      EXPECT_NEAR(steps, std::round(steps), 1e-4) << i;  // 1e-8 m: rounding of doubles near 4e6
    }
}
INSTANTIATE_TEST_SUITE_P(
    Files, LasReaderReal,
    ::testing::Values(RealFile{"trees/pine.las", 73851, {-1.25, -1.24, -0.22}, {2.49, 2.48, 20.16}},
                      RealFile{"trees/pine_plot.las", 114024, {0, 0, 49.04}, {10, 10, 20.33}},
                      RealFile{"trees/MLS_Clip.las", 301477, {470627.46, 3810222.30, 2278.55}, {27.11, 25.83, 34.28}}));

}  // namespace
}  // namespace accessvdb::io

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Numbers in recordings that are too large, and structures that have no end.
#include <cstdlib>
#include <fstream>

#include "bags/messages.h"
#include "io/poses/frame_tree.h"
#include "io/poses/pose_track.h"
#include "recordings/container_bytes.h"
#include "recordings/flight.h"

namespace accessvdb::recordings_test {
namespace {

struct CloudSizes {
  std::uint32_t height = 1, width = 2, point_step = 12, row_step = 24;
  std::uint32_t x = 0, y = 4, z = 8;
  std::uint32_t announced = 24;  ///< length of the data
  std::size_t bytes = 24;        ///< data that there is
  const char* names = "xyz";     ///< of the fields, one letter each
};

/// ROS 1: numbers one behind the other.
std::string cloudOf(const CloudSizes& sizes) {
  std::string message;
  for (const std::uint32_t number : {0U, 1U, 0U}) put(message, number);
  message += mcapText("body");
  put(message, sizes.height);
  put(message, sizes.width);
  put(message, std::uint32_t{3});
  for (const auto& [n, offset] : {std::pair(0, sizes.x), {1, sizes.y}, {2, sizes.z}}) {
    message += mcapText(std::string(1, sizes.names[n]));
    put(message, offset);
    message += '\7';
    put(message, std::uint32_t{1});
  }
  message += '\0';
  put(message, sizes.point_step);
  put(message, sizes.row_step);
  put(message, sizes.announced);
  return message + std::string(sizes.bytes, '\0') + '\1';
}

std::string problemOf(const CloudSizes& sizes) {
  try {
    const std::string bytes = cloudOf(sizes);
    const bags::CloudMessage cloud = bags::readCloud(bags::MessageKind::PointCloud2, bytes, bags::Wire::Ros1);
    std::vector<Eigen::Vector3f> points;
    bags::appendPoints(cloud, points);
    return std::to_string(points.size()) + " points";
  } catch (const bags::MessageError& error) {
    return error.id();
  }
}

TEST(RecordingLimits, OfSizesOfClouds) {
  constexpr std::uint32_t kMost = 0xffffffff;
  EXPECT_EQ(problemOf({}), "2 points");
  EXPECT_EQ(problemOf({.height = 0}), "0 points");
  EXPECT_EQ(problemOf({.height = 2, .width = 1, .row_step = 12}), "2 points");
  EXPECT_EQ(problemOf({.row_step = 0}), "2 points") << "one row needs no step";
  EXPECT_EQ(problemOf({.height = 2, .width = 1, .row_step = 0}), "2 points") << "an empty step";
  EXPECT_EQ(problemOf({.height = 2, .width = 1, .row_step = 24}), "2 points") << "the step of the whole message";
  EXPECT_EQ(problemOf({.height = 2, .width = 1, .row_step = 0, .announced = 28, .bytes = 28}), "recording.message");
  EXPECT_EQ(problemOf({.names = "XYZ"}), "2 points");
  EXPECT_EQ(problemOf({.names = "XyZ"}), "2 points");
  EXPECT_EQ(problemOf({.names = "XYW"}), "recording.fields");
  EXPECT_EQ(problemOf({.width = 3}), "recording.message");
  EXPECT_EQ(problemOf({.height = 2, .width = 1, .row_step = 13}), "recording.message");
  EXPECT_EQ(problemOf({.height = 2, .width = 1, .row_step = 11}), "recording.message");
  // Products that are 0 or small in 32 bits, and in 64 where one factor more is taken.
  EXPECT_EQ(problemOf({.width = 0x40000000, .point_step = 12}), "recording.message");
  EXPECT_EQ(problemOf({.height = 0x10000, .width = 0x10000, .point_step = 16}), "recording.message");
  EXPECT_EQ(problemOf({.height = kMost, .width = kMost, .point_step = kMost, .row_step = kMost}), "recording.message");
  EXPECT_EQ(problemOf({.height = kMost, .width = 1, .row_step = 0}), "recording.message");
  EXPECT_EQ(problemOf({.height = kMost, .width = 2, .point_step = 0}), "recording.fields");
  EXPECT_EQ(problemOf({.width = 6, .point_step = 4, .x = 0, .y = 0, .z = 0}), "recording.fields");
  EXPECT_EQ(problemOf({.z = 9}), "recording.fields");
  EXPECT_EQ(problemOf({.z = kMost}), "recording.fields");
  EXPECT_EQ(problemOf({.announced = 26}), "recording.message");
  EXPECT_EQ(problemOf({.announced = kMost}), "recording.message");
  EXPECT_EQ(problemOf({.bytes = 22}), "recording.message");
}

TEST(RecordingLimits, OfTopics) {
  if (!runs("command -v sqlite3")) GTEST_SKIP() << "sqlite3 is missing: tools/setup_debian.sh --tests";
  const io::test::TempFolder folder;
  const fs::path file = folder.path() / "many.db3";
  const fs::path sql =
      folder.write("many.sql",
                   "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);\n"
                   "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);\n"
                   "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n WHERE x < 1000000)\n"
                   "INSERT INTO topics SELECT x, '/topic' || x, 'std_msgs/msg/String', 'cdr' FROM n;\n");
  ASSERT_EQ(std::system(("sqlite3 '" + file.string() + "' < '" + sql.string() + "'").c_str()), 0);
  io::test::expectError([&] { (void)io::ScanSequence::open({.scans = file}); }, ErrorCode::Input, "recording.damaged",
                        {"topics"});
}

/// A view that never ends would do so at the first look.
TEST(RecordingLimits, OfViewsInDatabases) {
  if (!runs("command -v sqlite3")) GTEST_SKIP() << "sqlite3 is missing: tools/setup_debian.sh --tests";
  const io::test::TempFolder folder;
  const fs::path file = folder.path() / "view.db3";
  const fs::path sql =
      folder.write("view.sql",
                   "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);\n"
                   "CREATE VIEW messages AS WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n)\n"
                   "SELECT x AS id, 1 AS topic_id, 0 AS timestamp, zeroblob(1000000000) AS data FROM n;\n");
  ASSERT_EQ(std::system(("sqlite3 '" + file.string() + "' < '" + sql.string() + "'").c_str()), 0);
  io::test::expectError([&] { (void)io::ScanSequence::open({.scans = file}); }, ErrorCode::Input, "recording.format",
                        {"plain tables"});
}

const Eigen::Vector4d kNoTurn(1, 0, 0, 0);

TEST(RecordingLimits, OfFramesInACircle) {
  io::FrameTree frames;
  for (const auto& [parent, child] : {std::pair("a", "b"), {"b", "c"}, {"c", "a"}, {"d", "d"}})
    frames.add(parent, child, 0, {1, 0, 0}, kNoTurn, true);
  frames.finish();
  EXPECT_FALSE(frames.chain("d", "c"));
  EXPECT_FALSE(frames.chain("c", "nobody"));
  ASSERT_TRUE(frames.chain("a", "c"));
  EXPECT_TRUE(frames.at(*frames.chain("a", "c"), 5));
  EXPECT_TRUE(frames.links().top("c"));
  EXPECT_EQ(frames.links().otherParents(), 1U) << "d in d";
}

TEST(RecordingLimits, OfNamesOfFrames) {
  io::FrameTree frames;
  io::test::expectError(
      [&] {
        for (int i = 0; i < 20'000; ++i) frames.add("map", "frame" + std::to_string(i), 0, {0, 0, 0}, kNoTurn, true);
      },
      ErrorCode::Resource, "limit.recording");
}

/// Poses that are thinned still answer at any time, within what interpolation between the others gives.
TEST(RecordingLimits, OfPosesAreKeptByThinning) {
  io::PoseTrack track;
  for (std::int64_t i = 0; i < 1000; ++i) track.add(i * 1'000'000, {static_cast<double>(i) / 64, 0, 0}, kNoTurn);
  track.thin(50'000'000);
  EXPECT_EQ(track.size(), 20U);
  track.finish();
  for (std::int64_t i = 0; i <= 950; i += 7) {
    const auto pose = track.at(i * 1'000'000);
    ASSERT_TRUE(pose) << i;
    EXPECT_NEAR(pose->translation()[0], static_cast<double>(i) / 64, 1e-9);
  }
}

TEST(RecordingLimits, OfPosesThatAreNone) {
  io::PoseTrack track;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  track.add(0, {nan, 0, 0}, kNoTurn);
  track.add(0, {0, 0, 0}, {nan, 0, 0, 0});
  track.add(0, {0, 0, 0}, {0, 0, 0, 0});
  track.add(std::numeric_limits<std::int64_t>::max(), {0, 0, 0}, kNoTurn);
  track.add(std::numeric_limits<std::int64_t>::min(), {0, 0, 0}, kNoTurn);
  EXPECT_EQ(track.counts().invalid, 5U);
  EXPECT_TRUE(track.empty());
  track.finish();
  EXPECT_FALSE(track.at(0));
  EXPECT_FALSE(track.at(std::numeric_limits<std::int64_t>::min()));
}

}  // namespace
}  // namespace accessvdb::recordings_test

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is in recordings: points, poses and times, from independent writers and from real bags.
#include <fstream>
#include <sstream>

#include "accessvdb/scan_io.h"
#include "io/recordings/recording_index.h"
#include "recordings/flight.h"

namespace accessvdb::recordings_test {
namespace {

using io::test::anyContains;

class RecordingReading : public FlightTest {};

/// Every way of writing the same scans gives the same points, poses and times.
TEST_F(RecordingReading, GivesTheSamePointsInEveryLayout) {
  ACCESSVDB_NEED_ROS2_WRITER();
  writeFlight(5, 50);
  for (const auto& [name, options] : {std::pair("a.mcap", ""),
                                      {"b.mcap", "layout=padded compression=lz4 chunk=1"},
                                      {"c.mcap", "layout=organised compression=none"},
                                      {"d.mcap", "layout=double compression=zstd-stream index=no"},
                                      {"e.mcap", "clouds=livox chunk=0 index=no"},
                                      {"f.db3", "layout=organised"},
                                      {"g.db3", "clouds=livox"}})
    expectFlight(write(name, options), 5, 50);
}

TEST_F(RecordingReading, GivesTheSamePointsFromRos1) {
  ACCESSVDB_NEED_ROS1_WRITER();
  writeFlight(5, 50);
  for (const auto& [name, options] : {std::pair("a.bag", ""),
                                      {"b.bag", "compression=lz4 clouds=livox chunk=1"},
                                      {"c.bag", "compression=bz2 clouds=livox"}})
    expectFlight(write(name, options), 5, 50);
}

TEST_F(RecordingReading, ReadsStepsInAnyOrder) {
  ACCESSVDB_NEED_ROS2_WRITER();
  writeFlight(6, 40);
  for (const char* const name : {"a.mcap", "b.db3"}) {
    io::ScanSequence scans = io::ScanSequence::open({.scans = write(name, "chunk=1000")});
    ASSERT_EQ(scans.size(), 6U);
    for (const std::size_t step : {5U, 0U, 0U, 3U, 5U, 1U}) expectScan(scans.read(step), step, 40);
  }
}

/// The poses in one part, the clouds in another.
TEST_F(RecordingReading, TakesThePartsOfARecordingAsOne) {
  ACCESSVDB_NEED_ROS2_WRITER();
  writeFlight(6, 40);
  fs::create_directories(folder_.path() / "parts");
  (void)write("parts/flight_9.mcap", "clouds=none");
  (void)write("parts/flight_10.mcap", "poses=none");
  expectFlight(folder_.path() / "parts", 6, 40);
}

TEST_F(RecordingReading, MatchesPosesInBetween) {
  ACCESSVDB_NEED_ROS2_WRITER();
  writeFlight(6, 40);
  // Poses of every second scan only, at 0.2 s: the ones between are interpolated along the straight line.
  io::ScanSequence scans = io::ScanSequence::open({.scans = write("a.mcap", "poses=second")});
  ASSERT_EQ(scans.size(), 5U);  // the last scan is after the last pose
  for (std::size_t step = 0; step < 5; ++step) {
    const io::ScanRecord record = scans.read(step);
    EXPECT_NEAR((record.T_W_S.translation() - sensorAt(step)).norm(), 0, 1e-12) << step;
  }
  EXPECT_TRUE(anyContains(scans.notices(), "1 of 6 clouds are skipped")) << scans.notices().back();
}

TEST_F(RecordingReading, CountsLateOdometry) {
  ACCESSVDB_NEED_ROS2_WRITER();
  writeFlight(6, 40);
  const io::ScanSequence scans = io::ScanSequence::open({.scans = write("a.mcap", "poses=late")});
  EXPECT_EQ(scans.size(), 4U);
  EXPECT_TRUE(anyContains(scans.notices(), "2 of 6 clouds are skipped")) << scans.notices().back();
  EXPECT_TRUE(anyContains(scans.notices(), "2 of them before the first that has"));
}

TEST_F(RecordingReading, WarnsOfJumps) {
  ACCESSVDB_NEED_ROS2_WRITER();
  writeFlight(6, 40);
  const io::ScanSequence scans = io::ScanSequence::open({.scans = write("a.mcap", "poses=jump")});
  ASSERT_EQ(scans.warnings().size(), 1U);
  EXPECT_EQ(scans.warnings()[0].id, "poses.jumps");
  EXPECT_NE(scans.warnings()[0].text.find("jumps 1 times"), std::string::npos) << scans.warnings()[0].text;
}

TEST_F(RecordingReading, PrefersRegisteredClouds) {
  ACCESSVDB_NEED_ROS2_WRITER();
  writeFlight(4, 40);
  io::ScanSequence scans = io::ScanSequence::open({.scans = write("a.mcap", "clouds=world second=/cloud_other")});
  EXPECT_NE(scans.matchingRule().find("/cloud_registered is in frame camera_init, which does not move"),
            std::string::npos)
      << scans.matchingRule();
  EXPECT_TRUE(anyContains(scans.notices(), "not used: /cloud_other"));
  for (std::size_t step = 0; step < 4; ++step) {
    const io::ScanRecord record = scans.read(step);
    ASSERT_EQ(record.origins_W.size(), 1U);
    EXPECT_EQ(record.origins_W[0], sensorAt(step));
    ASSERT_EQ(record.points_W.size(), 40U);
    for (std::size_t i = 0; i < 40; ++i)  // turned by hand in the writer, rounded to float
      EXPECT_NEAR((record.points_W[i] - poseOf(step) * pointAt(step, i).cast<double>()).norm(), 0, 1e-6);
  }
}

/// Against the same by hand: poses multiplied, points compared, times shifted.
TEST_F(RecordingReading, AppliesExtrinsicBoxAndOffset) {
  ACCESSVDB_NEED_ROS2_WRITER();
  writeFlight(6, 40);
  Eigen::Isometry3d T_B_S = Eigen::Isometry3d::Identity();
  T_B_S.translate(Eigen::Vector3d(0.1, -0.2, 0.3)).rotate(Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitY()));
  const fs::path raw = write("raw.mcap", ""), world = write("world.mcap", "clouds=world");
  const Eigen::AlignedBox3d box_S(Eigen::Vector3d(2.05, -1, -0.4), Eigen::Vector3d(2.2, 9, 1));
  for (const fs::path& source : {raw, folder_.path() / "scans"}) {
    io::ScanInputOptions options = {.scans = source, .T_B_S = T_B_S, .exclude_box_S = box_S};
    if (source != raw) options.poses = folder_.path() / "poses.txt";
    io::ScanSequence scans = io::ScanSequence::open(options);
    ASSERT_EQ(scans.size(), 6U);
    for (std::size_t step = 0; step < 6; ++step) {
      const io::ScanRecord record = scans.read(step);
      EXPECT_EQ(record.T_W_S.matrix(), (poseOf(step) * T_B_S).matrix());
      std::vector<Eigen::Vector3f> left;
      for (std::size_t i = 0; i < 40; ++i)
        if (!box_S.contains(pointAt(step, i).cast<double>())) left.push_back(pointAt(step, i));
      EXPECT_EQ(record.points_S, left);
      EXPECT_EQ(record.excluded_points, 40 - left.size());
      EXPECT_GT(record.excluded_points, 0U);
    }
  }
  // Registered: where the rays begin, and a box that turns with the sensor.
  io::ScanSequence registered = io::ScanSequence::open({.scans = world, .T_B_S = T_B_S, .exclude_box_S = box_S});
  for (std::size_t step = 0; step < 6; ++step) {
    const io::ScanRecord record = registered.read(step);
    EXPECT_EQ(record.origins_W.at(0), (poseOf(step) * T_B_S).translation());
    std::uint64_t inside = 0;
    for (std::size_t i = 0; i < 40; ++i)
      inside += box_S.contains(T_B_S.inverse() * pointAt(step, i).cast<double>()) ? 1 : 0;
    EXPECT_EQ(record.excluded_points, inside);
  }
  // The clouds' clock is 0.1 s late: each gets the pose of the next.
  io::ScanSequence late = io::ScanSequence::open({.scans = raw, .time_offset_s = 0.1});
  ASSERT_EQ(late.size(), 5U);
  for (std::size_t step = 0; step < 5; ++step) EXPECT_EQ(late.read(step).T_W_S.matrix(), poseOf(step + 1).matrix());
  io::test::expectError(
      [&] {
        (void)io::ScanSequence::open(
            {.scans = folder_.path() / "scans", .poses = folder_.path() / "poses.txt", .time_offset_s = 1});
      },
      ErrorCode::Usage, "usage.time_offset");
}

/// The same transforms are in a bag of ROS 1 and in a database of ROS 2.
TEST_F(RecordingReading, FindsTheSameTransformsInRealBags) {
  ACCESSVDB_NEED_DATA(bag, "trajectories/tf_example.bag");
  ACCESSVDB_NEED_DATA(database, "trajectories/tf_example.db3");
  io::RecordingIndex indices[2] = {indexOf(bag, io::ScanKind::RosBag), indexOf(database, io::ScanKind::Sqlite)};
  ASSERT_EQ(indices[0].transforms.links().edges(100), indices[1].transforms.links().edges(100));
  ASSERT_EQ(indices[0].transforms.poses(), indices[1].transforms.poses());
  ASSERT_GT(indices[0].transforms.poses(), 500U);
  for (auto& index : indices) index.transforms.finish();
  for (const std::string& edge : indices[0].transforms.links().edges(100)) {
    const auto arrow = edge.find(" -> ");
    const std::string parent = edge.substr(0, arrow), child = edge.substr(arrow + 4);
    const auto chains = {indices[0].transforms.chain(parent, child), indices[1].transforms.chain(parent, child)};
    int found = 0;
    for (const auto& topic : indices[0].topics) {
      for (std::int64_t stamp_ns = topic.topic.first_ns; stamp_ns < topic.topic.last_ns; stamp_ns += 50'000'000) {
        const auto a = indices[0].transforms.at(**chains.begin(), stamp_ns);
        const auto b = indices[1].transforms.at(**(chains.begin() + 1), stamp_ns);
        ASSERT_EQ(a.has_value(), b.has_value());
        if (!a) continue;
        ++found;
        EXPECT_EQ(a->matrix(), b->matrix());
      }
    }
    EXPECT_GT(found, 0) << edge;
  }
}

/// Against what @mcap/core and @foxglove/rosmsg2-serialization read.
TEST_F(RecordingReading, FindsTheOdometryOfARealBag) {
  ACCESSVDB_NEED_ROS2_WRITER();
  ACCESSVDB_NEED_DATA(bag, "trajectories/nav2_turtlebot.mcap");
  const fs::path text = folder_.path() / "odometry.txt";
  const std::string command = "node '" + (scriptFolder() / "read_odometry.mjs").string() + "' '" +
                              npmFolder().string() + "' '" + bag.string() + "' /odom > '" + text.string() + "'";
  ASSERT_EQ(std::system(command.c_str()), 0) << command;
  io::RecordingIndex index = indexOf(bag, io::ScanKind::Mcap);
  const auto odometry = std::find_if(index.topics.begin(), index.topics.end(),
                                     [](const io::IndexedTopic& topic) { return topic.topic.name == "/odom"; });
  ASSERT_NE(odometry, index.topics.end());
  std::ifstream in(text);
  std::size_t lines = 0;
  std::int64_t stamp_ns = 0;
  std::string frame, child;
  Eigen::Vector3d t;
  Eigen::Vector4d q;
  while (in >> stamp_ns >> frame >> child >> t[0] >> t[1] >> t[2] >> q[1] >> q[2] >> q[3] >> q[0]) {
    ++lines;
    EXPECT_EQ(frame, odometry->frames.at(0));
    EXPECT_EQ(child, odometry->child);
    const auto pose = odometry->poses.at(stamp_ns);
    ASSERT_TRUE(pose) << stamp_ns;
    EXPECT_EQ(pose->translation(), t);
    EXPECT_EQ(pose->linear(), Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix());
  }
  EXPECT_EQ(lines, odometry->topic.messages);
  EXPECT_GT(lines, 2000U);
}

/// What is whole is read; the count is that of the messages before the cut.
TEST_F(RecordingReading, ReadsWhatIsWholeOfACutOffRecording) {
  ACCESSVDB_NEED_ROS2_WRITER();
  writeFlight(8, 400);
  std::vector<fs::path> files = {write("a.mcap", "chunk=6000"), write("b.db3", "")};
  if (hasRos1Writer()) files.push_back(write("c.bag", "compression=lz4 chunk=6000"));
  for (const fs::path& file : files) {
    const auto bytes = fs::file_size(file);
    std::size_t before = 8;
    bool some = false;
    for (const double share : {0.95, 0.8, 0.6, 0.5}) {
      fs::resize_file(file, static_cast<std::uintmax_t>(share * static_cast<double>(bytes)));
      std::optional<io::ScanSequence> opened;
      try {
        opened = io::ScanSequence::open({.scans = file});
      } catch (const UnusableInput&) {
        break;  // nothing is left of it
      }
      io::ScanSequence& scans = *opened;
      EXPECT_LE(scans.size(), before);
      // The index at the end of MCAP is not missed.
      ASSERT_EQ(scans.warnings().size(), scans.size() == 8 ? scans.warnings().size() : 1U) << file << share;
      for (const io::ScanWarning& warning : scans.warnings()) EXPECT_EQ(warning.id, "recording.cut_off");
      for (std::size_t step = 0; step < scans.size(); ++step) expectScan(scans.read(step), step, 400);
      some = some || scans.size() < 8;
      before = scans.size();
    }
    EXPECT_TRUE(some) << file;
  }
}

}  // namespace
}  // namespace accessvdb::recordings_test

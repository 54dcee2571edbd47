// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb live with a peer that flies while it scans: what a driver really sends, with the times of its points.
#include <cmath>

#include "live/dds_world.h"

namespace accessvdb::live_test {
namespace {

class LiveDdsMotion : public LiveDds {
 protected:
  /// Scans of 0.1 s around a box, and poses every 5 ms; the streams of both.
  void fly(int scans) {
    const ProgramResult result =
        runLab({"simulate", "--scene", "box", "--moving", "--frames", std::to_string(scans), "--out", path("flight")});
    ASSERT_EQ(result.exit_code, 0) << result.err;
    std::ifstream poses(path("flight/poses.txt"));
    std::ofstream odometry(path("odometry"), std::ios::binary), stream(path("stream"), std::ios::binary);
    const auto write = [](std::ofstream& to, const void* from, std::size_t bytes) {
      to.write(static_cast<const char*>(from), static_cast<std::streamsize>(bytes));
    };
    for (std::string line; std::getline(poses, line);) {
      if (line.empty() || line.front() == '#') continue;
      std::istringstream numbers(line);
      double stamp_s = 0, pose[7] = {};
      numbers >> stamp_s;
      for (double& value : pose) numbers >> value;
      ASSERT_TRUE(numbers) << line;
      const std::int64_t stamp_ns = kFirst_ns + static_cast<std::int64_t>(std::llround(stamp_s * 1e9));
      write(odometry, &stamp_ns, sizeof stamp_ns);
      write(odometry, pose, sizeof pose);
    }
    for (int n = 0; n < scans; ++n) {
      char file[40];
      std::snprintf(file, sizeof file, "flight/scans/%06d.pcd", n);
      const std::string bytes = readText(file);
      const std::size_t head = bytes.find("DATA binary\n") + 12;
      const auto count = static_cast<std::uint32_t>((bytes.size() - head) / 16);  // x y z as floats, t as uint32
      ASSERT_NE(bytes.find("FIELDS x y z t\n"), std::string::npos);
      const std::int64_t stamp_ns = kFirst_ns + n * std::int64_t{100'000'000};
      const double unused[7] = {};
      write(stream, &stamp_ns, sizeof stamp_ns);
      write(stream, unused, sizeof unused);
      write(stream, &count, sizeof count);
      for (std::uint32_t i = 0; i < count; ++i) write(stream, bytes.data() + head + 16 * i, 12);
      for (std::uint32_t i = 0; i < count; ++i) write(stream, bytes.data() + head + 16 * i + 12, 4);
    }
    count_ = static_cast<std::uint64_t>(scans);
  }
  ProgramResult hear(const std::string& how, const std::vector<std::string>& more = {}) {
    peer_codes_.clear();
    ProgramResult result = live({peer("rate=5 odometry='" + path("odometry") + "' " + how)}, more);
    EXPECT_EQ(result.exit_code, 128 + SIGINT) << result.err;
    expectPeersEndedWell();
    EXPECT_EQ(report_["live"]["taken"], count_) << report_["live"];
    expectAllAccountedFor(count_);
    return result;
  }
  double accessible() const { return report_["counts"]["accessible"].get<double>(); }
  double points() const { return report_["live"]["surface_points"].get<double>(); }

  std::uint64_t count_ = 0;
};

TEST_F(LiveDdsMotion, IsRemovedFromWhatADriverSends) {
  fly(8);
  const ProgramResult livox = hear("times=1 livox=1 frame=livox_frame", {"--extrinsic", "0,0,0"});
  EXPECT_NE(livox.err.find("(livox_ros_driver2/CustomMsg, reliable)"), std::string::npos) << livox.err;
  EXPECT_NE(
      livox.err.find("points: each point is placed by the pose at its own time ('times', ns since the scan's stamp"),
      std::string::npos)
      << livox.err;
  EXPECT_EQ(report_["live"]["by_times"], count_);
  const std::string of_livox = readText("out/points.ply");
  hear("times=1 frame=lidar", {"--extrinsic", "0,0,0"});
  EXPECT_EQ(report_["live"]["by_times"], count_);
  EXPECT_EQ(readText("out/points.ply"), of_livox) << "the same points and times in another type of message";
  const double removed = points();
  const ProgramResult off = hear("times=1 livox=1", {"--deskew", "off"});
  EXPECT_EQ(report_["live"]["by_times"], 0);
  EXPECT_GT(points(), 1.1 * removed);
}

/// Transforms come once, after the first scan, and say the same as --extrinsic; garbage beside them changes nothing.
TEST_F(LiveDdsMotion, TransformsSayWhereTheSensorIs) {
  fly(6);
  hear("times=1 frame=lidar", {"--extrinsic", "0.25,0,-0.5,0.6,0,0,0.8"});
  const std::string expected = readText("out/points.ply");
  writeText("transforms", "body mast 0.25 0 -0.5 0 0 0 1\nmast lidar 0 0 0 0.6 0 0 0.8\n");
  const ProgramResult result = hear("times=1 frame=lidar static_tf='" + path("transforms") + "'");
  EXPECT_NE(result.err.find("matching: clouds are posed by /Odometry and transforms (odom -> body -> mast -> lidar)"),
            std::string::npos)
      << result.err;
  EXPECT_EQ(report_["live"]["sensor_chain"], "odom -> body -> mast -> lidar");
  EXPECT_EQ(readText("out/points.ply"), expected);

  peer_codes_.clear();
  const ProgramResult beside = live(
      {garbage("topic=tf count=300") + " & " +
       peer("rate=5 odometry='" + path("odometry") + "' times=1 frame=lidar static_tf='" + path("transforms") + "'") +
       "; wait"});
  expectPeersEndedWell();
  EXPECT_EQ(report_["live"]["taken"], count_) << beside.err;
  EXPECT_GT(report_["live"]["malformed"], 100);
  EXPECT_NE(beside.err.find("transforms from /tf ("), std::string::npos) << beside.err;
  EXPECT_EQ(readText("out/points.ply"), expected);

  // Nothing says where the sensor is, or it is far away: a warning with a cure.
  peer_codes_.clear();
  const ProgramResult none = live({peer("rate=20 odometry='" + path("odometry") + "' times=1 frame=lidar")});
  EXPECT_EQ(report_["live"]["taken"], 0);
  EXPECT_NE(none.err.find("warning[live.frames] clouds in frame lidar are dropped"), std::string::npos) << none.err;
  writeText("transforms", "body lidar 250 0 -500 0 0 0 1\n");
  EXPECT_NE(hear("times=1 frame=lidar static_tf='" + path("transforms") + "'").err.find("warning[poses.extrinsic]"),
            std::string::npos);
}

}  // namespace
}  // namespace accessvdb::live_test

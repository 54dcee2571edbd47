// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The program's results from recordings are those from files: byte for byte, point for point.
#include <fstream>
#include <nlohmann/json.hpp>

#include "accessvdb/scan_io.h"
#include "cli/program_run.h"
#include "recordings/writers.h"
#include "unit/io/input_fixture.h"

namespace accessvdb::recordings_test {
namespace {

using cli_test::ProgramResult;
using cli_test::runLab;
using cli_test::runProgram;

class RecordingLabels : public cli_test::ProgramTest {
 protected:
  void simulate(const std::string& more = "") {
    std::vector<std::string> arguments = {"simulate",      "--scene", "torus", "--frames",    "4",
                                          "--range-noise", "0.001",   "--out", path("flight")};
    if (!more.empty()) arguments.push_back(more);
    const ProgramResult result = runLab(arguments);
    ASSERT_EQ(result.exit_code, 0) << result.err;
  }

  ProgramResult map(const std::string& out, std::vector<std::string> more) {
    std::vector<std::string> arguments = {"map",      "--tool", "builtin:pencil", "--voxel", "0.005",
                                          "--device", "cpu",    "--range-noise",  "0.002",   "--tiles",
                                          "off",      "--out",  path(out)};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return runProgram(arguments);
  }
  std::string labels(const std::string& out, const std::vector<std::string>& more) {
    const ProgramResult result = map(out, more);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return readText(out + "/points.ply");
  }
  std::string fromFiles() {
    return labels("files", {"--scans", path("flight/scans"), "--poses", path("flight/poses.txt")});
  }
  std::string write(const std::string& name, const std::string& options) {
    return writeRecording(path("flight"), path(name), options).string();
  }
};

TEST_F(RecordingLabels, OfRos2EqualThoseOfFiles) {
  ACCESSVDB_NEED_ROS2_WRITER();
  simulate();
  const std::string expected = fromFiles();
  const auto report = nlohmann::json::parse(readText("files/report.json"));
  ASSERT_GT(report["counts"]["accessible"], 20);
  ASSERT_GT(report["counts"]["blocked"], 20);
  int n = 0;
  for (const auto& [name, options] : {std::pair("zstd.mcap", ""),
                                      {"pose.mcap", "poses=pose clouds=livox compression=lz4"},
                                      {"transforms.db3", "poses=tf"}}) {
    const std::string bag = write(name, options);
    EXPECT_TRUE(labels("bag" + std::to_string(n++), {"--scans", bag}) == expected) << name << " " << options;
  }
}

TEST_F(RecordingLabels, OfRos1EqualThoseOfFiles) {
  ACCESSVDB_NEED_ROS1_WRITER();
  simulate();
  const std::string expected = fromFiles();
  int n = 0;
  for (const auto& [name, options] :
       {std::pair("lz4.bag", "compression=lz4 clouds=livox"), {"bz2.bag", "compression=bz2 poses=tf chunk=400000"}}) {
    const std::string bag = write(name, options);
    EXPECT_TRUE(labels("bag" + std::to_string(n++), {"--scans", bag}) == expected) << name << " " << options;
  }
}

/// The same rays as files: a cloud in the world frame for each scan, and a list of where the sensor stood.
TEST_F(RecordingLabels, OfRegisteredCloudsEqualThoseOfStations) {
  ACCESSVDB_NEED_ROS2_WRITER();
  simulate();
  const std::string bag = write("registered.mcap", "clouds=world");
  io::ScanSequence scans = io::ScanSequence::open({.scans = bag});
  std::filesystem::create_directories(path("world"));
  std::string stations;
  for (std::size_t step = 0; step < scans.size(); ++step) {
    const io::ScanRecord record = scans.read(step);
    std::string text;
    char line[200];
    for (const Eigen::Vector3d& p : record.points_W) {
      std::snprintf(line, sizeof line, "%.17g %.17g %.17g\n", p[0], p[1], p[2]);
      if (p.allFinite()) text += line;
    }
    const std::string name = std::to_string(step) + ".xyz";
    writeText("world/" + name, text);
    const Eigen::Vector3d q = record.origins_W.at(0);
    std::snprintf(line, sizeof line, "%s %.17g %.17g %.17g\n", name.c_str(), q[0], q[1], q[2]);
    stations += line;
  }
  writeText("world/stations.txt", stations);
  // Where the sensor stood is also in the poses that the recording was made of.
  std::ifstream poses(path("flight/poses.txt"));
  std::string comment;
  std::getline(poses, comment);
  for (std::size_t step = 0; step < scans.size(); ++step) {
    double stamp_s = 0, q[4];
    Eigen::Vector3d t;
    poses >> stamp_s >> t[0] >> t[1] >> t[2] >> q[0] >> q[1] >> q[2] >> q[3];
    EXPECT_EQ(scans.read(step).origins_W.at(0), t);
  }
  EXPECT_TRUE(labels("bag", {"--scans", bag}) ==
              labels("stations", {"--scans", path("world"), "--stations", path("world/stations.txt")}));
}

TEST_F(RecordingLabels, OfRecordedScansEqualThoseOfFiles) {
  ACCESSVDB_NEED_ROS2_WRITER();
  ACCESSVDB_NEED_DATA(data, "scans_poses_balm");
  io::ScanSequence scans = io::ScanSequence::open({.scans = data, .poses = data / "alidarPose.csv", .every = 3});
  ASSERT_GE(scans.size(), 4U);
  std::filesystem::create_directories(path("flight/scans"));
  std::string poses;
  for (std::size_t step = 0; step < scans.size(); ++step) {
    const io::ScanRecord record = scans.read(step);
    char text[300];
    std::snprintf(text, sizeof text, "%06zu.pcd", step);
    std::filesystem::copy_file(record.path, folder_ / "flight" / "scans" / text);
    const Eigen::Quaterniond q(record.T_W_S.linear());
    const Eigen::Vector3d t = record.T_W_S.translation();
    std::snprintf(text, sizeof text, "%.1f %.17g %.17g %.17g %.17g %.17g %.17g %.17g\n", static_cast<double>(step) / 10,
                  t[0], t[1], t[2], q.x(), q.y(), q.z(), q.w());
    poses += text;
  }
  writeText("flight/poses.txt", poses);
  const std::vector<std::string> coarse = {"--voxel", "0.4", "--tool", "builtin:pruner", "--allow-hidden-tool"};
  const std::vector<std::string> files = {"--scans", path("flight/scans"), "--poses", path("flight/poses.txt")};
  const auto run = [&](const std::string& out, const std::vector<std::string>& inputs) {
    std::vector<std::string> arguments = {"map", "--device", "cpu", "--tiles", "off", "--out", path(out)};
    for (const auto& part : {inputs, coarse}) arguments.insert(arguments.end(), part.begin(), part.end());
    const ProgramResult result = runProgram(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return readText(out + "/points.ply");
  };
  const std::string expected = run("files", files);
  ASSERT_GT(expected.size(), 10000U);
  EXPECT_TRUE(run("mcap", {"--scans", write("flight.mcap", "")}) == expected);
  if (hasRos1Writer()) {
    EXPECT_TRUE(run("bag", {"--scans", write("flight.bag", "compression=lz4")}) == expected);
  }
}

TEST_F(RecordingLabels, AreNotNeededToSeeWhatIsInside) {
  ACCESSVDB_NEED_ROS2_WRITER();
  simulate();
  const std::string bag = write("flight.mcap", "poses=tf");
  const ProgramResult words = runProgram({"info", bag});
  EXPECT_EQ(words.exit_code, 0) << words.err;
  for (const char* const line :
       {"/points: sensor_msgs/PointCloud2 (cdr), 4 messages from 0.000 to 0.300 s, clouds in frame body",
        "/chatter: std_msgs/String (cdr), 1 messages\n", "camera_init -> base"})
    EXPECT_NE(words.out.find(line), std::string::npos) << line << " is not in: " << words.out;
  const ProgramResult text = runProgram({"info", bag, "--json"});
  const auto json = nlohmann::json::parse(text.out);
  EXPECT_EQ(json["messages"], 10);
  EXPECT_EQ(json["first_s"], 1.7e9);
  EXPECT_EQ(json["topics"].size(), 4);
  EXPECT_EQ(json["transforms"], nlohmann::json({"camera_init -> base", "base -> body"}));
}

/// In tiles, stopped and resumed, with a pose file, and every second scan: as the files.
TEST_F(RecordingLabels, WorkWithTheRestOfTheProgram) {
  ACCESSVDB_NEED_ROS2_WRITER();
  simulate();
  const std::string bag = write("flight.mcap", "");
  const std::string expected = fromFiles();
  EXPECT_EQ(runProgram({"map", "--tool", "builtin:pencil", "--voxel", "0.005", "--device", "cpu", "--range-noise",
                        "0.002", "--scans", bag, "--tiles", "3", "--out", path("tiles")})
                .exit_code,
            0);
  EXPECT_EQ(runProgram({"tile", "merge", path("tiles"), "--points", path("tiles.ply")}).exit_code, 0);
  EXPECT_TRUE(readText("tiles.ply") == expected);
  EXPECT_TRUE(
      labels("every", {"--scans", bag, "--every", "2"}) ==
      labels("every_file", {"--scans", path("flight/scans"), "--poses", path("flight/poses.txt"), "--every", "2"}));
  EXPECT_TRUE(labels("saved", {"--scans", bag, "--checkpoint", path("state")}) == expected);
  EXPECT_TRUE(labels("resumed", {"--scans", bag, "--resume", path("state")}) == expected);

  std::string poses;
  io::ScanSequence scans = io::ScanSequence::open({.scans = bag});
  std::ifstream in(path("flight/poses.txt"));
  for (std::string line; std::getline(in, line);) {
    if (line.front() == '#') continue;
    const auto blank = line.find(' ');
    char stamp[40];
    std::snprintf(stamp, sizeof stamp, "%.6f", 1.7e9 + std::stod(line.substr(0, blank)));
    poses += stamp + line.substr(blank) + "\n";
  }
  writeText("moved.txt", poses);
  const std::string unposed = write("unposed.mcap", "poses=none");
  EXPECT_TRUE(labels("posed", {"--scans", unposed, "--poses", path("moved.txt")}) == expected);
}

}  // namespace
}  // namespace accessvdb::recordings_test

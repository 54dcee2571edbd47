// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb live with peers on loopback (peer/), in a domain of its own.
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/file.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "accessvdb/field_io.h"
#include "accessvdb/scan_io.h"
#include "cli/program_run.h"

namespace accessvdb::live_test {

namespace fs = std::filesystem;
using cli_test::ProgramResult;
using cli_test::runLab;
using cli_test::runProgram;
using nlohmann::json;

inline constexpr std::int64_t kFirst_ns = 1'700'000'000'000'000'000;

inline int scanCount(int otherwise) {
  const char* count = std::getenv("ACCESSVDB_LIVE_SCANS");
  return count != nullptr ? std::atoi(count) : otherwise;
}

/// Cyclone DDS on loopback alone, which often has no multicast: it asks the first participants one by one.
inline void stayOnLoopback() {
  setenv("CYCLONEDDS_URI",
         "<CycloneDDS><Domain><General><Interfaces><NetworkInterface address=\"127.0.0.1\" multicast=\"false\"/>"
         "</Interfaces><AllowMulticast>false</AllowMulticast><MaxMessageSize>65500B</MaxMessageSize></General>"
         "<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>110</MaxAutoParticipantIndex>"
         "<Peers><Peer address=\"127.0.0.1\"/></Peers></Discovery></Domain></CycloneDDS>",
         1);
}

/// A domain of DDS that no other test on this machine uses as long as this object lives.
class OwnDomain {
 public:
  OwnDomain() {
    constexpr int kFirst = 10, kCount = 90;  // ports of higher domains may be taken
    for (int tries = 0; tries < kCount && lock_ < 0; ++tries) {
      number_ = kFirst + (getpid() + tries) % kCount;
      const std::string name = "accessvdb_dds_" + std::to_string(number_);
      const int file = open((fs::temp_directory_path() / name).c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0666);
      if (file >= 0 && flock(file, LOCK_EX | LOCK_NB) == 0) {
        lock_ = file;
      } else if (file >= 0) {
        close(file);
      }
    }
  }
  OwnDomain(const OwnDomain&) = delete;
  OwnDomain& operator=(const OwnDomain&) = delete;
  ~OwnDomain() {
    if (lock_ >= 0) close(lock_);
  }
  [[nodiscard]] bool found() const { return lock_ >= 0; }
  [[nodiscard]] std::string number() const { return std::to_string(number_); }

 private:
  int lock_ = -1;
  int number_ = 0;
};

struct SentScan {
  std::string file;
  std::int64_t stamp_ns = 0;
  double pose[7] = {};  // x y z, qx qy qz qw, as in the file of poses
};

class LiveDds : public cli_test::ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    stayOnLoopback();
    unsetenv("ROS_DOMAIN_ID");
    ASSERT_TRUE(own_domain_.found()) << "all domains are taken";
  }

  /// Simulated scans, and the stream of them that the peer sends.
  void simulate(int scans) {
    const ProgramResult result = runLab({"simulate", "--scene", "pine", "--tree-height",
                                         std::getenv("ACCESSVDB_LIVE_SCANS") != nullptr ? "12" : "4", "--frames",
                                         std::to_string(scans), "--range-noise", "0.01", "--out", path("flight")});
    ASSERT_EQ(result.exit_code, 0) << result.err;
    std::ifstream poses(path("flight/poses.txt"));
    std::ofstream stream(path("stream"), std::ios::binary);
    io::ScanSequence sequence =
        io::ScanSequence::open({.scans = path("flight/scans"), .poses = path("flight/poses.txt")});
    ASSERT_EQ(sequence.size(), static_cast<std::size_t>(scans));
    for (std::string line; std::getline(poses, line);) {
      if (line.empty() || line.front() == '#') continue;
      SentScan scan;
      std::istringstream numbers(line);
      double stamp_s = 0;
      numbers >> stamp_s;
      for (double& value : scan.pose) numbers >> value;
      ASSERT_TRUE(numbers) << line;
      scan.stamp_ns = kFirst_ns + static_cast<std::int64_t>(sent_.size()) * 100'000'000;
      const io::ScanRecord record = sequence.read(sent_.size());
      scan.file = record.path;
      const auto count = static_cast<std::uint32_t>(record.points_S.size());
      const auto write = [&](const void* from, std::size_t bytes) {
        stream.write(static_cast<const char*>(from), static_cast<std::streamsize>(bytes));
      };
      write(&scan.stamp_ns, sizeof scan.stamp_ns);
      write(scan.pose, sizeof scan.pose);
      write(&count, sizeof count);
      write(record.points_S.data(), 12 * record.points_S.size());
      sent_.push_back(scan);
    }
    ASSERT_EQ(sent_.size(), static_cast<std::size_t>(scans));
  }

  static std::vector<std::string> fieldFlags() {
    return {"--tool", "builtin:pruner", "--voxel", "0.05", "--device", "cpu", "--range-noise", "0.01"};
  }

  /// Runs the program, the peers once it is ready, and then stops it.
  ProgramResult live(const std::vector<std::string>& peers, const std::vector<std::string>& more = {},
                     int signal = SIGINT) {
    std::vector<std::string> arguments = {
        "live",           "--cloud", cloud_topic_,     "--odom", "/Odometry",  "--domain",  own_domain_.number(),
        "--points-every", "0.2",     "--status-every", "0.2",    "--scan-log", path("log"), "--out",
        path("out")};
    for (const auto& part : {fieldFlags(), more}) arguments.insert(arguments.end(), part.begin(), part.end());
    cli_test::ProgramSetup setup;
    setup.arguments = arguments;
    setup.signal_after = "waiting for " + cloud_topic_;
    setup.act = [&](pid_t pid) {
      for (const std::string& command : peers) peer_codes_.push_back(std::system(command.c_str()));
      std::ifstream held("/proc/" + std::to_string(pid) + "/status");
      for (std::string word; held >> word;)
        if (word == "VmHWM:") held >> most_resident_KiB_;
      kill(pid, signal);
    };
    ProgramResult result = runProgram(setup);
    if (fs::exists(path("out/report.json"))) report_ = json::parse(readText("out/report.json"));
    return result;
  }
  std::string peer(const std::string& more) const {
    return std::string(ACCESSVDB_LIVE_PEER) + " '" + path("stream") + "' domain=" + own_domain_.number() + " " + more +
           " >>'" + path("peers") + "' 2>&1";
  }
  std::string garbage(const std::string& more) const {
    return std::string(ACCESSVDB_GARBAGE_PEER) + " domain=" + own_domain_.number() + " " + more + " >>'" +
           path("peers") + "' 2>&1";
  }

  void expectPeersEndedWell() {
    for (const int code : peer_codes_) EXPECT_EQ(code, 0) << readText("peers");
  }

  /// The scans that the program says it took.
  std::vector<SentScan> taken() const {
    std::vector<SentScan> scans;
    std::ifstream log(path("log"));
    for (std::string line; std::getline(log, line);) {
      if (line.find(" taken ") == std::string::npos && line.find(" late ") == std::string::npos) continue;
      const std::int64_t stamp_ns = std::stoll(line);
      const auto n = static_cast<std::size_t>((stamp_ns - kFirst_ns) / 100'000'000);
      scans.push_back(sent_.at(n));
      EXPECT_EQ(scans.back().stamp_ns, stamp_ns);
    }
    return scans;
  }

  /// `map --update-every 1` on these scans, from files.
  std::string mapped(const std::vector<SentScan>& scans) const {
    fs::create_directories(path("taken"));
    std::string poses;
    for (std::size_t n = 0; n < scans.size(); ++n) {
      char text[300];
      std::snprintf(text, sizeof text, "%06zu.pcd", n);
      fs::copy_file(scans[n].file, fs::path(path("taken")) / text);
      const double* p = scans[n].pose;
      std::snprintf(text, sizeof text, "%.1f %.17g %.17g %.17g %.17g %.17g %.17g %.17g\n", static_cast<double>(n) / 10,
                    p[0], p[1], p[2], p[3], p[4], p[5], p[6]);
      poses += text;
    }
    writeText("taken.txt", poses);
    std::vector<std::string> arguments = {"map",        "--scans",        path("taken"), "--poses", path("taken.txt"),
                                          "--out",      path("expected"), "--tiles",     "off",     "--update-every",
                                          update_every_};
    for (const std::string& flag : fieldFlags()) arguments.push_back(flag);
    for (const char* flag : {"--change", "full", "--free-for", "60"}) arguments.emplace_back(flag);  // as live does
    arguments.insert(arguments.end(), map_flags_.begin(), map_flags_.end());
    const ProgramResult result = runProgram(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return readText("expected/points.ply");
  }

  /// The labels are those of map, and every scan is accounted for.
  void expectLabelsOfMap() const {
    const std::vector<SentScan> scans = taken();
    EXPECT_EQ(scans.size(), static_cast<std::size_t>(report_["live"]["taken"]));
    ASSERT_FALSE(scans.empty());
    const bool same = readText("out/points.ply") == mapped(scans);
    EXPECT_TRUE(same || report_["live"]["late"] > 0);
    // How often labels were asked for decides what a blocked point came closest with, but no label.
    const FieldSnapshot got = io::readPointsPly(path("out/points.ply")),
                        expected = io::readPointsPly(path("expected/points.ply"));
    ASSERT_EQ(got.points.size(), expected.points.size());
    for (std::size_t n = 0; n < got.points.size(); ++n) {
      ASSERT_EQ(got.points[n].position_W, expected.points[n].position_W);
      ASSERT_EQ(got.points[n].label, expected.points[n].label);
    }
    EXPECT_GT(report_["counts"]["accessible"], 100);
    EXPECT_GT(report_["counts"]["blocked"], 100);
  }
  void expectAllAccountedFor(std::uint64_t published) const {
    const json& live = report_["live"];
    std::uint64_t dropped = 0;
    for (const auto& [reason, count] : live["dropped"].items()) dropped += count.get<std::uint64_t>();
    EXPECT_EQ(live["published"], published);
    EXPECT_EQ(live["taken"].get<std::uint64_t>() + dropped, published);
    EXPECT_EQ(live["waiting"], 0);
  }

  OwnDomain own_domain_;
  std::vector<SentScan> sent_;
  std::vector<int> peer_codes_;
  std::string cloud_topic_ = "/livox/lidar";
  std::string update_every_ = "1";       ///< for mapped()
  std::vector<std::string> map_flags_;   ///< for mapped()
  std::uint64_t most_resident_KiB_ = 0;  ///< before it was stopped: afterwards it makes a picture
  json report_;
};

}  // namespace accessvdb::live_test

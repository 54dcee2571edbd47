// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb live with a peer on loopback that shares no code with it (peer/): labels are those of map on the scans
/// that were taken, every scan is accounted for, and what is published says the same as the files.
///
/// ACCESSVDB_LIVE_SCANS=600 makes the long runs of docs/live.md.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/file.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "accessvdb/field_io.h"
#include "accessvdb/scan_io.h"
#include "cli/program_run.h"

namespace accessvdb::live_test {
namespace {

namespace fs = std::filesystem;
using cli_test::ProgramResult;
using cli_test::runLab;
using cli_test::runProgram;
using nlohmann::json;

constexpr std::int64_t kFirst_ns = 1'700'000'000'000'000'000;

int scanCount(int otherwise) {
  const char* count = std::getenv("ACCESSVDB_LIVE_SCANS");
  return count != nullptr ? std::atoi(count) : otherwise;
}

/// Cyclone DDS on loopback alone, which often has no multicast: it asks the first participants one by one.
void stayOnLoopback() {
  setenv("CYCLONEDDS_URI",
         "<CycloneDDS><Domain><General><Interfaces><NetworkInterface address=\"127.0.0.1\" multicast=\"false\"/>"
         "</Interfaces><AllowMulticast>false</AllowMulticast><MaxMessageSize>65500B</MaxMessageSize></General>"
         "<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>30</MaxAutoParticipantIndex>"
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
        "live",           "--cloud", "/livox/lidar",   "--odom", "/Odometry",  "--domain",  own_domain_.number(),
        "--points-every", "0.2",     "--status-every", "0.2",    "--scan-log", path("log"), "--out",
        path("out")};
    for (const auto& part : {fieldFlags(), more}) arguments.insert(arguments.end(), part.begin(), part.end());
    cli_test::ProgramSetup setup;
    setup.arguments = arguments;
    setup.signal_after = "waiting for /livox/lidar";
    setup.act = [&](pid_t pid) {
      for (const std::string& command : peers) peer_codes_.push_back(std::system(command.c_str()));
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
    std::vector<std::string> arguments = {"map",   "--scans",        path("taken"), "--poses", path("taken.txt"),
                                          "--out", path("expected"), "--tiles",     "off",     "--update-every",
                                          "1"};
    for (const std::string& flag : fieldFlags()) arguments.push_back(flag);
    for (const char* flag : {"--change", "full", "--free-for", "60"}) arguments.emplace_back(flag);  // as live does
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
  json report_;
};

/// One point as the peer received it.
struct ReceivedPoint {
  float p[3];
  std::uint32_t rgb, id;
  std::uint8_t label, reason;
  std::uint16_t score;
  float confidence, direction[3];
};
static_assert(sizeof(ReceivedPoint) == 40);

std::vector<ReceivedPoint> receivedIn(const std::string& bytes) {
  std::vector<ReceivedPoint> points(bytes.size() / sizeof(ReceivedPoint));
  std::memcpy(points.data(), bytes.data(), points.size() * sizeof(ReceivedPoint));
  return points;
}

TEST_F(LiveDds, LabelsAtTwoPerSecondAreThoseOfMapAndNoneIsDropped) {
  simulate(scanCount(12));
  const ProgramResult result = live({peer("rate=2 listen='" + path("heard") + "'")});
  EXPECT_EQ(result.exit_code, 128 + SIGINT) << result.err;
  expectPeersEndedWell();
  ASSERT_FALSE(report_.is_null()) << result.err;
  expectAllAccountedFor(sent_.size());
  EXPECT_EQ(report_["live"]["taken"], sent_.size()) << report_["live"];
  EXPECT_EQ(report_["live"]["malformed"], 0);
  EXPECT_EQ(report_["live"]["lost"], 0);
  expectLabelsOfMap();

  // What was published says what the files say.
  const FieldSnapshot stored = io::readPointsPly(path("out/points.ply"));
  const auto expectStored = [&](const ReceivedPoint& got) {
    const SurfacePoint& point = stored.points.at(got.id);
    EXPECT_EQ(got.label, static_cast<std::uint8_t>(point.label));
    EXPECT_EQ(got.reason, static_cast<std::uint8_t>(point.reason));
    EXPECT_LT((Eigen::Vector3f(got.p) - point.position_W.cast<float>()).norm(), 1e-6);  // one of the two is rounded
    EXPECT_LT((Eigen::Vector3f(got.direction) - point.direction_W).norm(), 1e-6);       // files hold the yaw
  };
  const std::vector<ReceivedPoint> all = receivedIn(readText("heard.points"));
  ASSERT_EQ(all.size(), stored.points.size());
  for (const ReceivedPoint& got : all) {
    expectStored(got);
    EXPECT_EQ(got.score, stored.points[got.id].score);
    EXPECT_EQ(got.confidence, stored.points[got.id].confidence);
  }
  // Who only listens to the changes ends up with the same.
  std::map<std::uint32_t, ReceivedPoint> known;
  for (const ReceivedPoint& got : receivedIn(readText("heard.changes"))) known[got.id] = got;
  ASSERT_EQ(known.size(), stored.points.size());
  for (const auto& [id, got] : known) expectStored(got);
  EXPECT_EQ(readText("heard.layout"),
            "odom 1 x " + std::to_string(all.size()) +
                ", 40 bytes per point: x@0/7 y@4/7 z@8/7 rgb@12/7 id@16/6 label@20/2 reason@21/2 score@22/4 "
                "confidence@24/7 dx@28/7 dy@32/7 dz@36/7");
  const json status = json::parse(readText("heard.status"));
  EXPECT_EQ(status["taken"], sent_.size());
  EXPECT_EQ(status["frame"], "odom");
}

TEST_F(LiveDds, EveryScanIsAccountedForAtTenPerSecond) {
  simulate(scanCount(30));
  const ProgramResult result = live({peer("rate=10 listen='" + path("heard") + "'")}, {}, SIGTERM);
  EXPECT_EQ(result.exit_code, 128 + SIGTERM) << result.err;
  expectPeersEndedWell();
  expectAllAccountedFor(sent_.size());
  expectLabelsOfMap();
}

TEST_F(LiveDds, ScansThatComeMuchTooFastAreFusedAndCounted) {
  simulate(scanCount(40));
  const ProgramResult result = live({peer("rate=0")}, {"--queue", "2"});
  EXPECT_EQ(result.exit_code, 128 + SIGINT) << result.err;
  expectPeersEndedWell();
  expectAllAccountedFor(sent_.size());
  EXPECT_GT(report_["live"]["late"], 0);
  expectLabelsOfMap();
}

TEST_F(LiveDds, APeerThatDiesAndOneThatTakesOver) {
  simulate(12);
  const ProgramResult result = live({peer("rate=10 die=5"), peer("rate=10 first=5")});
  EXPECT_EQ(result.exit_code, 128 + SIGINT) << result.err;
  ASSERT_EQ(peer_codes_.size(), 2U);
  EXPECT_NE(peer_codes_[0], 0);
  EXPECT_EQ(peer_codes_[1], 0) << readText("peers");
  // The last scan of the one that died may have died with it.
  EXPECT_GE(report_["live"]["published"], 11);
  expectAllAccountedFor(report_["live"]["published"]);
  expectLabelsOfMap();
}

TEST_F(LiveDds, GarbageIsCountedAndChangesNothing) {
  simulate(10);
  const ProgramResult result =
      live({garbage("topic=cloud count=150"), garbage("topic=odom count=100"), peer("rate=10 count=5"),
            garbage("topic=cloud count=150"), garbage("topic=odom count=100"), peer("rate=10 first=5")});
  EXPECT_EQ(result.exit_code, 128 + SIGINT) << result.err;
  expectPeersEndedWell();
  const json& live = report_["live"];
  // Odometry has no size of its own, so random bytes may pass as a pose, which is then invalid.
  const auto malformed = live["malformed"].get<std::uint64_t>();
  EXPECT_GE(malformed, 300U);
  EXPECT_LE(malformed, 500U);
  EXPECT_EQ(malformed + live["poses"]["invalid"].get<std::uint64_t>() +
                live["poses"]["other_frame"].get<std::uint64_t>() + live["published"].get<std::uint64_t>() - 10,
            500U)
      << live;
  EXPECT_EQ(live["taken"], 10);
  expectLabelsOfMap();
}

/// A cloud above --max-message is never allocated, and does not stop those after it.
TEST_F(LiveDds, CloudsThatAreTooLargeDoNotStopTheOthers) {
  simulate(10);
  for (const char* reliable : {"1", "0"}) {
    SCOPED_TRACE(reliable);
    peer_codes_.clear();
    const std::string qos = std::string(" reliable=") + reliable;
    const ProgramResult result =
        live({peer("rate=10 count=5" + qos), garbage("count=3 bytes=3000000" + qos), peer("rate=10 first=5" + qos)},
             {"--max-message", "1M"});
    EXPECT_EQ(result.exit_code, 128 + SIGINT) << result.err;
    expectPeersEndedWell();
    EXPECT_EQ(report_["live"]["malformed"], 0);
    if (*reliable == '0') continue;  // best effort may lose some
    EXPECT_EQ(report_["live"]["taken"], 10) << report_["live"];
    expectLabelsOfMap();
    fs::remove_all(path("taken"));
  }
}

TEST_F(LiveDds, BestEffortSendersAreHeardToo) {
  simulate(8);
  const ProgramResult result = live({peer("rate=10 reliable=0 listen='" + path("heard") + "'")});
  EXPECT_EQ(result.exit_code, 128 + SIGINT) << result.err;
  EXPECT_NE(result.err.find("clouds from /livox/lidar (sensor_msgs/PointCloud2, best effort)"), std::string::npos)
      << result.err;
  EXPECT_GE(report_["live"]["taken"], 4);
  expectAllAccountedFor(report_["live"]["published"]);
  expectLabelsOfMap();
}

TEST_F(LiveDds, AMemoryLimitIsSaidAndKept) {
  simulate(8);
  const ProgramResult result = live({peer("rate=10 listen='" + path("heard") + "'")}, {"--max-memory", "1M"});
  EXPECT_EQ(result.exit_code, 128 + SIGINT) << result.err;
  EXPECT_NE(result.err.find("live.memory_full"), std::string::npos) << result.err;
  EXPECT_EQ(report_["live"]["memory"]["full"], true);
  EXPECT_EQ(json::parse(readText("heard.status"))["memory"]["full"], true);
}

TEST_F(LiveDds, NobodySendsAndNothingIsSaved) {
  const ProgramResult result = live({"sleep 0.3"});
  EXPECT_EQ(result.exit_code, 128 + SIGINT) << result.err;
  EXPECT_EQ(listing("out"), std::vector<std::string>{"report.json"});
  EXPECT_EQ(report_["live"]["published"], 0);
}

TEST_F(LiveDds, BadOptionsAreRefused) {
  const auto refusal = [&](std::vector<std::string> more) {
    std::vector<std::string> arguments = {"live",           "--tool", "builtin:pencil", "--out", path("out"),
                                          "--error-format", "json"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const ProgramResult result = runProgram(arguments);
    EXPECT_EQ(result.exit_code, 2) << result.err;
    return json::parse(result.err.substr(0, result.err.find('\n')))["id"].get<std::string>();
  };
  EXPECT_EQ(refusal({}), "usage.missing");
  EXPECT_EQ(refusal({"--cloud", "/a"}), "usage.missing");
  EXPECT_EQ(refusal({"--cloud", "/a", "--odom", "/a"}), "usage.topic");
  EXPECT_EQ(refusal({"--cloud", "a", "--odom", "/b"}), "usage.topic");
  EXPECT_EQ(refusal({"--cloud", "/a;b", "--odom", "/b"}), "usage.topic");
  EXPECT_EQ(refusal({"--cloud", "/a", "--odom", "/b", "--domain", "233"}), "usage.domain");
  EXPECT_EQ(refusal({"--cloud", "/a", "--odom", "/b", "--domain", "x"}), "usage.domain");
  EXPECT_EQ(refusal({"--cloud", "/a", "--odom", "/b", "--queue", "0"}), "usage.queue");
  EXPECT_EQ(refusal({"--cloud", "/a", "--odom", "/b", "--max-message", "2G"}), "usage.max_message");
  EXPECT_EQ(refusal({"--cloud", "/a", "--odom", "/b", "--points-every", "-1"}), "usage.interval");
  EXPECT_EQ(refusal({"--cloud", "/a", "--odom", "/b", "--level", "imu"}), "usage.option");  // only for files
  setenv("ROS_DOMAIN_ID", "many", 1);
  EXPECT_EQ(refusal({"--cloud", "/a", "--odom", "/b"}), "usage.domain");
  unsetenv("ROS_DOMAIN_ID");
}

TEST_F(LiveDds, AToolThatVanishesIsRefused) {
  const ProgramResult result = runProgram({"live", "--cloud", "/a", "--odom", "/b", "--tool", "builtin:pencil",
                                           "--voxel", "0.05", "--device", "cpu", "--out", path("out")});
  EXPECT_EQ(result.exit_code, 4) << result.err;
  EXPECT_NE(result.err.find("error[tool.hidden]"), std::string::npos) << result.err;
}

TEST_F(LiveDds, TheEffectiveConfigurationIsReadBack) {
  const ProgramResult printed = runProgram({"live", "--cloud", "/a", "--odom", "/b", "--tool", "builtin:pencil",
                                            "--out", path("out"), "--queue", "7", "--print-config"});
  ASSERT_EQ(printed.exit_code, 0) << printed.err;
  writeText("live.toml", printed.out);
  const ProgramResult again = runProgram({"live", "--config", path("live.toml"), "--print-config"});
  EXPECT_EQ(again.exit_code, 0) << again.err;
  EXPECT_NE(again.out.find("queue = 7"), std::string::npos) << again.out;
}

}  // namespace
}  // namespace accessvdb::live_test

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb live with a peer on loopback that shares no code with it (peer/): labels are those of map on the scans
/// that were taken, every scan is accounted for, and what is published says the same as the files.
///
/// ACCESSVDB_LIVE_SCANS=600 makes the long runs of docs/live.md.
#include <cstring>
#include <map>

#include "live/dds_world.h"

namespace accessvdb::live_test {
namespace {

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

/// Two tools, one of them in all directions, and labels after each scan: the files are those of map.
TEST_F(LiveDds, SeveralToolsHaveTheFilesOfMap) {
  simulate(scanCount(8));
  map_flags_ = {
      "--tool",      "builtin:pruner", "--orientations", "yaw", "--orientations", "sphere:60", "--tool-name", "flat",
      "--tool-name", "ball",           "--rolls",        "-",   "--rolls",        "2"};
  const ProgramResult result = live({peer("rate=1 listen='" + path("heard") + "'")}, map_flags_);
  EXPECT_EQ(result.exit_code, 128 + SIGINT) << result.err;
  expectPeersEndedWell();
  EXPECT_EQ(report_["live"]["taken"], sent_.size()) << report_["live"];
  EXPECT_EQ(report_["live"]["late"], 0);
  EXPECT_EQ(readText("out/points.ply"), mapped(taken()));
  EXPECT_EQ(readText("out/field_points.vdb").size(), readText("expected/field_points.vdb").size());
  ASSERT_EQ(report_["tools"].size(), 2U);
  for (const auto& tool : report_["tools"]) EXPECT_GT(tool["accessible"], 50) << tool;
  EXPECT_NE(readText("heard.layout").find(", 44 bytes per point:"), std::string::npos) << readText("heard.layout");
  EXPECT_NE(readText("heard.layout").find(" tools@40/6"), std::string::npos) << readText("heard.layout");
}

/// The last scans are scored when the run ends.
TEST_F(LiveDds, LabelsAfterEveryThreeScansAreThoseOfMap) {
  simulate(scanCount(8));
  const ProgramResult result = live({peer("rate=2")}, {"--update-every", "3"});
  EXPECT_EQ(result.exit_code, 128 + SIGINT) << result.err;
  EXPECT_EQ(report_["live"]["taken"], sent_.size()) << report_["live"];
  update_every_ = "3";
  EXPECT_EQ(readText("out/points.ply"), mapped(taken()));
}

TEST_F(LiveDds, ThirtyTwoToolsAreTakenAndThirtyThreeRefused) {
  const auto run = [&](int tools) {
    std::vector<std::string> more;
    for (int n = 1; n < tools; ++n) more.insert(more.end(), {"--tool", "builtin:pruner"});
    return live({"sleep 0.2"}, more);
  };
  EXPECT_EQ(run(32).exit_code, 128 + SIGINT);
  const ProgramResult many = runProgram([&] {
    std::vector<std::string> arguments = {"live",  "--cloud",   "/a",      "--odom", "/b",
                                          "--out", path("out"), "--voxel", "0.05"};
    for (int n = 0; n < 33; ++n) arguments.insert(arguments.end(), {"--tool", "builtin:pruner"});
    return arguments;
  }());
  EXPECT_EQ(many.exit_code, 2) << many.err;
  EXPECT_NE(many.err.find("tool.count"), std::string::npos) << many.err;
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
  EXPECT_EQ(refusal({"--cloud", "/a", "--odom", "/b", "--level", "imu"}), "usage.missing");
  EXPECT_EQ(refusal({"--cloud", "/a", "--odom", "/b", "--imu", "/c"}), "usage.imu");
  EXPECT_EQ(refusal({"--cloud", "/a", "--odom", "/b", "--update-every", "0"}), "usage.update_every");
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

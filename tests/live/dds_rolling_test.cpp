// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb live --rolling: tiles in a folder, checkpoints, commands that are not for tiles, and the result.
#include "live/dds_world.h"

namespace accessvdb::live_test {
namespace {

class LiveRollingDds : public LiveDds {
 protected:
  std::vector<std::string> rolling(const std::vector<std::string>& more = {}) const {
    std::vector<std::string> flags = {"--rolling", path("tiles")};
    flags.insert(flags.end(), more.begin(), more.end());
    return flags;
  }
  std::string commands(const std::string& lines) const {
    writeText("commands", lines);
    return std::string(ACCESSVDB_COMMAND_PEER) + " domain=" + own_domain_.number() + " commands='" + path("commands") +
           "' answers='" + path("answers") + "' rate=10 wait_s=4 >>'" + path("peers") + "' 2>&1";
  }
  FieldSnapshot merged() const {
    const ProgramResult result = runProgram({"tile", "merge", path("out"), "--points", path("merged.ply")});
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return io::readPointsPly(path("merged.ply"));
  }
};

TEST_F(LiveRollingDds, EndsInTheFolderOfATiledMap) {
  simulate(scanCount(8));
  const ProgramResult result = live({peer("rate=1 listen='" + path("heard") + "'")}, rolling());
  EXPECT_EQ(result.exit_code, 128 + SIGINT) << result.err;
  expectPeersEndedWell();
  expectAllAccountedFor(sent_.size());
  EXPECT_EQ(report_["live"]["taken"], sent_.size()) << report_["live"] << result.err;
  const json& tiles = report_["live"]["rolling"];
  EXPECT_GT(tiles["tiles"], 1) << tiles;
  EXPECT_EQ(json::parse(readText("heard.status"))["rolling"]["tiles"], tiles["tiles"]);
  EXPECT_GT(report_["tiles"]["done"], 1) << report_["tiles"];

  fs::create_directories(path("taken"));
  std::vector<std::string> arguments = {"map",
                                        "--scans",
                                        path("flight/scans"),
                                        "--poses",
                                        path("flight/poses.txt"),
                                        "--out",
                                        path("expected"),
                                        "--tiles",
                                        "off",
                                        "--change",
                                        "full",
                                        "--free-for",
                                        "60"};
  for (const std::string& flag : fieldFlags()) arguments.push_back(flag);
  ASSERT_EQ(runProgram(arguments).exit_code, 0);
  const FieldSnapshot got = merged(), expected = io::readPointsPly(path("expected/points.ply"));
  EXPECT_EQ(report_["live"]["memory"]["left_out_returns"], 0);
  ASSERT_EQ(got.points.size(), expected.points.size());
  for (std::size_t n = 0; n < got.points.size(); ++n) {
    ASSERT_EQ(got.points[n].position_W, expected.points[n].position_W) << n;
    ASSERT_EQ(got.points[n].label, expected.points[n].label) << n;
  }
  EXPECT_GT(got.count(PointLabel::Accessible), 100U);
}

/// What is far has no place, and the program says with which range everything would have one.
TEST_F(LiveRollingDds, MemoryThatIsShortIsSaid) {
  simulate(4);
  const ProgramResult result = live({peer("rate=2")}, rolling({"--max-memory", "3M"}));
  EXPECT_EQ(result.exit_code, 128 + SIGINT) << result.err;
  EXPECT_NE(result.err.find("warning[rolling.short]"), std::string::npos) << result.err;
  EXPECT_EQ(report_["live"]["rolling"]["memory_short"], true);
  EXPECT_GT(report_["live"]["memory"]["left_out_returns"], 0);
}

TEST_F(LiveRollingDds, GoesOnAfterItsCheckpointAndAnswersCommands) {
  simulate(4);
  const std::string ask = commands(R"({"command":"pause"}
{"id":%d,"command":"checkpoint"}
{"id":%d,"command":"save"}
{"id":%d,"command":"reset"}
{"id":%d,"command":"remove","box":[0,0,0,1,1,1]}
{"command":"resume"}
)");
  const ProgramResult first = live({peer("rate=4"), ask}, rolling());
  EXPECT_EQ(first.exit_code, 128 + SIGINT) << first.err;
  const std::string answers = readText("answers");
  EXPECT_NE(answers.find("checkpoint after 4 scans"), std::string::npos) << answers << first.err;
  EXPECT_NE(answers.find("--rolling writes the files when the run ends"), std::string::npos) << answers;
  EXPECT_NE(answers.find("start again with another folder"), std::string::npos) << answers;
  EXPECT_TRUE(fs::exists(path("tiles/rolling.json")));
  const std::size_t points = merged().points.size();
  EXPECT_GT(points, 100U);

  // Neither over what is there, nor with what belongs to others.
  const ProgramResult again = live({"true"}, rolling());
  EXPECT_EQ(again.exit_code, 7) << again.err;
  EXPECT_NE(again.err.find("output.foreign"), std::string::npos) << again.err;
  std::vector<std::string> of_map = {
      "map",   "--scans",      path("flight/scans"), "--poses",  path("flight/poses.txt"),
      "--out", path("of_map"), "--change",           "full",     "--free-for",
      "60",    "--rolling",    path("tiles"),        "--resume", path("tiles")};
  for (const std::string& flag : fieldFlags()) of_map.push_back(flag);
  const ProgramResult other = runProgram(of_map);
  EXPECT_NE(other.exit_code, 0);
  EXPECT_NE(other.err.find("error["), std::string::npos) << other.err;
  EXPECT_FALSE(fs::exists(path("of_map/plan.json")));

  fs::rename(path("out"), path("first"));
  const ProgramResult level = live({"true"}, rolling({"--resume", path("tiles"), "--level", "2,0"}));
  EXPECT_EQ(level.exit_code, 4) << level.err;
  EXPECT_NE(level.err.find("was made with no level instead of level "), std::string::npos) << level.err;
  const ProgramResult second = live({peer("rate=4")}, rolling({"--resume", path("tiles")}));
  EXPECT_EQ(second.exit_code, 128 + SIGINT) << second.err;
  EXPECT_NE(second.err.find("going on after 4 scans"), std::string::npos) << second.err;
  EXPECT_EQ(report_["resumed_after_scans"], 4) << report_;
  EXPECT_EQ(report_["counts"]["scans"], 8);
  EXPECT_EQ(merged().points.size(), points) << "the same scans have come again";
  EXPECT_EQ(second.err.find("rolling.frame"), std::string::npos) << second.err;

  // An odometry in another frame: what was mapped before lies elsewhere.
  fs::rename(path("out"), path("second"));
  const ProgramResult elsewhere = live({peer("rate=4 world=map")}, rolling({"--resume", path("tiles")}));
  EXPECT_EQ(elsewhere.exit_code, 128 + SIGINT) << elsewhere.err;
  EXPECT_NE(elsewhere.err.find("warning[rolling.frame] poses are in frame map now, and were in frame odom"),
            std::string::npos)
      << elsewhere.err;
}

/// Restarted in flight, where nothing rests: up is what the IMU felt when the map was begun.
TEST_F(LiveRollingDds, WhatIsLevelIsNotMeasuredAgain) {
  simulate(16);
  const std::vector<std::string> level = {"--level", "imu", "--imu", "/imu"};
  const ProgramResult first = live({peer("rate=10 imu=1")}, rolling(level));
  EXPECT_EQ(first.exit_code, 128 + SIGINT) << first.err;
  expectPeersEndedWell();
  EXPECT_EQ(report_["counts"]["scans"], 16) << first.err;
  const std::size_t points = merged().points.size();
  EXPECT_GT(points, 100U);

  fs::rename(path("out"), path("first"));
  std::vector<std::string> again = level;
  again.insert(again.end(), {"--resume", path("tiles")});
  const ProgramResult second = live({peer("rate=4 count=4")}, rolling(again));
  EXPECT_EQ(second.exit_code, 128 + SIGINT) << second.err;
  EXPECT_EQ(report_["counts"]["scans"], 20) << second.err;
  EXPECT_EQ(merged().points.size(), points) << "the same scans have come again";
}

TEST_F(LiveRollingDds, WhatDoesNotGoTogetherIsRefused) {
  const auto refusal = [&](std::vector<std::string> more) {
    std::vector<std::string> arguments = {"live",      "--cloud",        "/a",  "--odom", "/b", "--out",
                                          path("out"), "--error-format", "json"};
    for (const std::string& flag : fieldFlags()) arguments.push_back(flag);
    arguments.insert(arguments.end(), more.begin(), more.end());
    const ProgramResult result = runProgram(arguments);
    EXPECT_FALSE(fs::exists(path("tiles"))) << result.err;
    return json::parse(result.err.substr(0, result.err.find('\n')))["id"].get<std::string>();
  };
  EXPECT_EQ(refusal({"--resume", path("tiles")}), "usage.rolling");
  EXPECT_EQ(refusal(rolling({"--resume", path("others")})), "usage.rolling");
  EXPECT_EQ(refusal(rolling({"--checkpoint", path("state")})), "usage.rolling");
  EXPECT_EQ(refusal(rolling({"--checkpoint-every", "often"})), "usage.duration");
  EXPECT_EQ(refusal({"--rolling", path("out")}), "usage.rolling");
  writeText("mine", "");
  fs::create_directories(path("out/tiles"));
  writeText("out/tiles/notes.txt", "mine");
  EXPECT_EQ(refusal(rolling()), "output.foreign");
  EXPECT_EQ(readText("out/tiles/notes.txt"), "mine");
}

}  // namespace
}  // namespace accessvdb::live_test

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Scans of a sensor that moved: the program's other ways give the bytes of one piece, and other settings are refused.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "program_run.h"

namespace accessvdb::cli_test {
namespace {

class DeskewRuns : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    const ProgramResult result = runLab({"simulate", "--scene", "box", "--trajectory", "walk", "--begin=-0.5,-0.8,-0.2",
                                         "--end=0.5,-0.8,-0.2", "--frames", "5", "--moving", "--out", path("flight")});
    ASSERT_EQ(result.exit_code, 0) << result.err;
  }
  ProgramResult map(const std::string& out, const std::vector<std::string>& more) {
    std::vector<std::string> arguments = {"map",
                                          "--tool",
                                          "builtin:pencil",
                                          "--voxel",
                                          "0.005",
                                          "--device",
                                          "cpu",
                                          "--scans",
                                          path("flight/scans"),
                                          "--poses",
                                          path("flight/poses.txt"),
                                          "--out",
                                          path(out)};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return runProgram(arguments);
  }
  std::string labels(const std::string& out, const std::vector<std::string>& more) {
    const ProgramResult result = map(out, more);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return readText(out + "/points.ply");
  }
};

TEST_F(DeskewRuns, WorkInTilesAndAfterAResume) {
  const ProgramResult whole = map("whole", {"--tiles", "off"});
  ASSERT_EQ(whole.exit_code, 0) << whole.err;
  EXPECT_NE(whole.err.find("'t', ns since the scan's stamp, 0 to 100 ms) in 5 of 5 scans"), std::string::npos)
      << whole.err;
  const std::string expected = readText("whole/points.ply");
  ASSERT_GT(expected.size(), 10000U);
  EXPECT_TRUE(labels("on", {"--deskew", "on"}) == expected);
  EXPECT_EQ(nlohmann::json::parse(readText("on/report.json"))["parameters"]["deskew"], "on");

  EXPECT_EQ(map("tiles", {"--tiles", "3"}).exit_code, 0);
  EXPECT_EQ(runProgram({"tile", "merge", path("tiles"), "--points", path("tiles.ply")}).exit_code, 0);
  EXPECT_TRUE(readText("tiles.ply") == expected);
  const ProgramResult other = map("tiles", {"--tiles", "3", "--deskew", "off"});
  EXPECT_EQ(other.exit_code, 4) << other.err;
  EXPECT_NE(other.err.find("error[plan.changed]"), std::string::npos) << other.err;

  EXPECT_TRUE(labels("saved", {"--checkpoint", path("state"), "--tiles", "off"}) == expected);
  EXPECT_TRUE(labels("resumed", {"--resume", path("state"), "--tiles", "off"}) == expected);
  const ProgramResult refused = map("refused", {"--resume", path("state"), "--deskew", "off", "--tiles", "off"});
  EXPECT_EQ(refused.exit_code, 4) << refused.err;
  EXPECT_NE(refused.err.find("error[state.params]"), std::string::npos) << refused.err;

  const std::string off = labels("off", {"--deskew", "off"});
  EXPECT_FALSE(off == expected);
}

TEST_F(DeskewRuns, AreLevelledInTilesToo) {
  const std::string expected = labels("whole", {"--tiles", "off", "--level", "5,-3"});
  EXPECT_FALSE(labels("plain", {"--tiles", "off"}) == expected);
  EXPECT_EQ(map("tiles", {"--tiles", "3", "--level", "5,-3"}).exit_code, 0);
  EXPECT_EQ(runProgram({"tile", "merge", path("tiles"), "--points", path("tiles.ply")}).exit_code, 0);
  EXPECT_TRUE(readText("tiles.ply") == expected);
  EXPECT_EQ(map("tiles", {"--tiles", "3", "--level", "5,-2"}).exit_code, 4);
  EXPECT_EQ(map("bad", {"--level", "5"}).exit_code, 2);
  EXPECT_EQ(map("bad", {"--level", "imu"}).exit_code, 2);
  EXPECT_EQ(map("bad", {"--deskew", "maybe"}).exit_code, 2);
  EXPECT_EQ(map("bad", {"--ray", "0,0,-10"}).exit_code, 2);
}

TEST_F(DeskewRuns, OfAssumedRaysWarn) {
  std::string cloud;
  for (int x = 0; x < 60; ++x)
    for (int y = 0; y < 60; ++y) cloud += std::to_string(x / 50.0) + " " + std::to_string(y / 50.0) + " 0\n";
  writeText("ground.xyz", cloud);
  const std::vector<std::string> arguments = {"map", "--tool",  "builtin:pencil",   "--voxel", "0.02",   "--device",
                                              "cpu", "--scans", path("ground.xyz"), "--ray",   "0,0,-3", "--out"};
  auto whole = arguments, tiled = arguments;
  whole.push_back(path("whole"));
  tiled.insert(tiled.end(), {path("tiles"), "--tiles", "10"});
  const ProgramResult result = runProgram(whole);
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.err.find("warning[scans.constant_ray]"), std::string::npos) << result.err;
  EXPECT_EQ(nlohmann::json::parse(readText("whole/report.json"))["parameters"]["ray"], "0,0,-3");
  EXPECT_EQ(runProgram(tiled).exit_code, 0);
  EXPECT_EQ(runProgram({"tile", "merge", path("tiles"), "--points", path("tiles.ply")}).exit_code, 0);
  EXPECT_TRUE(readText("tiles.ply") == readText("whole/points.ply"));
}

}  // namespace
}  // namespace accessvdb::cli_test

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Several tools by repeated flags: what the files and the other verbs say of them, and what is refused.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <sstream>

#include "program_run.h"

namespace accessvdb::cli_test {
namespace {

using nlohmann::json;
using Flags = std::vector<std::string>;

class SeveralToolsInTheProgram : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    writeWallScans();
    writePoses();
  }
  /// Arguments of map without the usual tool.
  Flags mapWith(const Flags& more) const {
    Flags arguments = mapArguments();
    const auto tool = std::find(arguments.begin(), arguments.end(), "--tool");
    arguments.erase(tool, tool + 2);
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }
  Flags with(Flags flags, const Flags& more) const {
    flags.insert(flags.end(), more.begin(), more.end());
    return flags;
  }
  const Flags three_ = {"--tool",           "builtin:pruner",
                        "--tool",           "builtin:pencil",
                        "--tool",           "builtin:pencil",
                        "--tool-name",      "arm",
                        "--tool-name",      "thin",
                        "--tool-name",      "tilted",
                        "--orientations",   "yaw",
                        "--orientations",   "yaw",
                        "--orientations",   "sphere:30",
                        "--max-collisions", "0"};
};

TEST_F(SeveralToolsInTheProgram, AreInEveryResult) {
  const ProgramResult result = runProgram(mapWith(three_));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.err.find("tool thin reaches "), std::string::npos) << result.err;
  const json report = json::parse(readText("out/report.json"));
  ASSERT_EQ(report.at("tools").size(), 3u);
  EXPECT_EQ(report.at("tools")[1].at("name"), "thin");
  EXPECT_EQ(report.at("tools")[1].at("tool"), "builtin:pencil");
  EXPECT_EQ(report.at("tools")[2].at("orientations"), "sphere:30");
  EXPECT_EQ(report.at("tools")[0].at("max_collisions"), -1);
  EXPECT_EQ(report.at("tools")[0].at("collision_limit"), 1);
  EXPECT_GT(report.at("tools")[1].at("accessible"), 0);
  EXPECT_EQ(report.at("parameters").at("tools"), "arm,thin,tilted");
  const std::string ply = readText("out/points.ply");
  EXPECT_NE(ply.find("\ncomment tools arm,thin,tilted\n"), std::string::npos);
  EXPECT_NE(ply.find("\ncomment tool_arm_max_collisions -1\n"), std::string::npos);
  EXPECT_NE(ply.find("property uchar tool\nproperty uint tools\nproperty float access_probability\nend_header\n"),
            std::string::npos);
  const ProgramResult info = runProgram({"info", path("out/field.vdb")});
  for (const char* grid : {"best_tool", "accessible_arm", "accessible_thin", "accessible_tilted"}) {
    EXPECT_NE(info.out.find(grid), std::string::npos) << grid;
  }
  const ProgramResult query = runProgram({"query", "--map", path("out"), "--at", "2,0.1,0", "--json"});
  ASSERT_EQ(query.exit_code, 0) << query.err;
  const json point = json::parse(query.out).at(0).at("point");
  const std::string tool = point.at("tool");
  EXPECT_TRUE(tool == "arm" || tool == "thin" || tool == "tilted") << tool;
  if (point.at("label") == "accessible") {
    EXPECT_EQ(point.at("tools").at(0), tool);
  } else {
    EXPECT_TRUE(point.at("tools").empty());
  }
  EXPECT_EQ(runProgram({"render", "--map", path("out"), "--out", path("out/again.png")}).exit_code, 0);
}

/// Files of one tool are those from before there were several, however it is given.
TEST_F(SeveralToolsInTheProgram, OneLeavesNoTrace) {
  ASSERT_EQ(runProgram(mapWith({"--tool", "builtin:pencil"})).exit_code, 0);
  const std::string ply = readText("out/points.ply"), grids = readText("out/field.vdb");
  ASSERT_EQ(
      runProgram(mapWith({"--tool", "builtin:pencil", "--tool-name", "mine", "--max-collisions", "auto"})).exit_code,
      0);
  EXPECT_EQ(readText("out/points.ply"), ply);
  EXPECT_EQ(readText("out/field.vdb"), grids);
  EXPECT_EQ(ply.find("tools"), std::string::npos);
  EXPECT_FALSE(json::parse(readText("out/report.json")).contains("tools"));
}

TEST_F(SeveralToolsInTheProgram, TheOneThatIsMostlyHiddenIsNamed) {
  Flags arguments = mapWith(with(three_, {"--allow-hidden-tool"}));
  *(std::find(arguments.begin(), arguments.end(), "--voxel") + 1) = "0.05";
  const ProgramResult result = runProgram(arguments);
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.err.find("warning[tool.hidden] tool thin: "), std::string::npos) << result.err;
  EXPECT_EQ(result.err.find("warning[tool.hidden] tool arm: "), std::string::npos) << result.err;
}

TEST_F(SeveralToolsInTheProgram, ComeFromAFileOfSettings) {
  const ProgramResult config = runProgram(mapWith(with(three_, {"--print-config"})));
  ASSERT_EQ(config.exit_code, 0) << config.err;
  writeText("three.toml", config.out);
  ASSERT_EQ(runProgram(mapWith(three_)).exit_code, 0);
  const std::string ply = readText("out/points.ply");
  const ProgramResult again = runProgram(mapWith({"--config", path("three.toml")}));
  ASSERT_EQ(again.exit_code, 0) << again.err;
  EXPECT_EQ(readText("out/points.ply"), ply);
}

TEST_F(SeveralToolsInTheProgram, GoOnFromACheckpointAndSayWhy) {
  const Flags saved = with(three_, {"--checkpoint", path("state")});
  ASSERT_EQ(runProgram(mapWith(saved)).exit_code, 0);
  Flags other = three_;
  std::swap(other[1], other[3]);
  EXPECT_NE(runProgram(mapWith(with(other, {"--resume", path("state")}))).err.find("error[state.tool]"),
            std::string::npos);
  const json plain = json::parse(runProgram({"query", "--map", path("out"), "--at", "2,0.1,0", "--json"}).out);
  const json position = plain.at(0).at("point").at("position");
  const std::string at = std::to_string(position[0].get<double>()) + "," + std::to_string(position[1].get<double>()) +
                         "," + std::to_string(position[2].get<double>());
  for (const auto& [tool, directions] : {std::pair{"thin", 180u}, {"tilted", 54u}}) {
    Flags arguments = {"query", "--map", path("state"), "--device", "cpu", "--at", at, "--json", "--for-tool", tool};
    arguments = with(with(arguments, three_), {"--access-map", path("why.png")});
    const ProgramResult map = runProgram(arguments);
    ASSERT_EQ(map.exit_code, 0) << map.err;
    const json outcome = json::parse(map.out);
    EXPECT_EQ(outcome.at("tool"), tool);
    EXPECT_EQ(outcome.at("directions").size(), directions);
    const auto free = std::count_if(outcome.at("directions").begin(), outcome.at("directions").end(),
                                    [](const json& direction) { return direction.at("outcome") == "free"; });
    const json reach = plain.at(0).at("point").at("tools");
    EXPECT_EQ(free > 0, std::find(reach.begin(), reach.end(), tool) != reach.end()) << tool;
  }
}

TEST_F(SeveralToolsInTheProgram, BadOnesAreRefused) {
  const Flags two = {"--tool", "builtin:pencil", "--tool", "builtin:pruner"};
  const auto expectRefused = [&](const Flags& flags, int code, const std::string& id) {
    SCOPED_TRACE(id);
    const ProgramResult result = runProgram(mapWith(flags));
    EXPECT_EQ(result.exit_code, code) << result.err;
    EXPECT_NE(result.err.find("error[" + id + "]"), std::string::npos) << result.err;
  };
  expectRefused(with(two, {"--tool-name", "a", "--tool-name", "a"}), 2, "tool.name");
  expectRefused(with(two, {"--tool-name", "a", "--tool-name", "b c"}), 2, "tool.name");
  expectRefused(with(two, {"--tool-name", "a", "--tool-name", std::string(33, 'b')}), 2, "tool.name");
  expectRefused(with(two, {"--tool-name", "a"}), 2, "usage.tool");
  expectRefused(with(two, {"--orientations", "yaw", "--orientations", "yaw", "--orientations", "sphere:30"}), 2,
                "usage.tool");
  expectRefused(with(with(two, {"--tool", "builtin:pencil"}), {"--rolls", "1", "--rolls", "2"}), 2, "usage.tool");
  expectRefused({"--tool", "builtin:pencil", "--orientations", "yaw", "--orientations", "yaw"}, 2, "usage.tool");
  writeText("tool.obj", "v 0 0 0\nv 100 0 0\nv 100 10 0\nv 100 0 10\nf 1 2 3\nf 1 3 4\nf 1 4 2\nf 2 4 3\n");
  expectRefused({"--tool", "builtin:pencil", "--tool", path("tool.obj")}, 2, "tool.unit");
  expectRefused({"--tool", path("tool.obj"), "--tool", path("tool.obj"), "--tool-unit", "mm", "--tool-unit", "-"}, 2,
                "tool.unit");
  expectRefused(with(two, {"--profile", "paper"}), 2, "tool.policy");
  expectRefused(with(two, {"--policy", "paper"}), 2, "tool.policy");
  for (const char* limit : {"-1", "1.5", "nan", "inf", "x", "1m", "l", "65001", "1e9l"}) {
    SCOPED_TRACE(limit);
    expectRefused(with(two, {"--max-collisions", limit}), 2, "usage.max_collisions");
  }
  Flags many;
  for (int n = 0; n < 33; ++n) many.insert(many.end(), {"--tool", "builtin:pencil"});
  expectRefused(many, 2, "tool.count");
  // Given once, a unit is that of the meshes, and not of the built-in tools.
  EXPECT_EQ(
      runProgram(mapWith({"--tool", path("tool.obj"), "--tool", "builtin:pencil", "--tool-unit", "mm"})).exit_code, 0);
}

/// Half a litre at this voxel size, written as voxels.
TEST_F(SeveralToolsInTheProgram, LitresAreWholeVoxels) {
  const auto limitOf = [&](const std::string& text) -> json {
    const ProgramResult result = runProgram(mapWith({"--tool", "builtin:pencil", "--max-collisions", text}));
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return json::parse(readText("out/report.json")).at("parameters").at("max_collisions");
  };
  EXPECT_EQ(limitOf("0.5l"), 4);  // 0.0005 / 0.000125
  EXPECT_EQ(limitOf("0.499l"), 3);
  EXPECT_EQ(limitOf("0.1l"), -1);  // less than one voxel: none
  EXPECT_EQ(limitOf("17"), 17);
  EXPECT_EQ(limitOf("auto"), 0);
}

/// The example: a boom that tilts below a level drone.
TEST_F(SeveralToolsInTheProgram, TheExampleOfATiltingBoomRuns) {
  if (std::system("python3 -c '' 2>/dev/null") != 0) GTEST_SKIP() << "no python3";
  const std::string script = std::string(ACCESSVDB_SOURCE_DIR) + "/examples/python/tilting_boom.py";
  ASSERT_EQ(std::system(("python3 " + script + " " + path("booms") + " -45 0 45 > /dev/null").c_str()), 0);
  Flags flags;
  std::istringstream words(readText("booms/flags.txt"));
  for (std::string word; words >> word;) flags.push_back(word);
  const ProgramResult result = runProgram(mapWith(flags));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const json tools = json::parse(readText("out/report.json")).at("tools");
  ASSERT_EQ(tools.size(), 3u);
  EXPECT_EQ(tools[0].at("name"), "boom_down_45");
  EXPECT_EQ(tools[1].at("orientations"), "pitch:0:0:1");
  // In each, the body is level: its corners are as high as those of the others, seen from the joint.
  EXPECT_NE(result.err.find("2 boom_up_45"), std::string::npos) << result.err;
}

}  // namespace
}  // namespace accessvdb::cli_test

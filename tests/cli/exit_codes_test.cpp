// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Every documented exit code at least once: code, shape of the one line, report, and nothing half-written.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <regex>

#include "program_run.h"

namespace accessvdb::cli_test {
namespace {

class ExitCodes : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    writeWallScans();
    writePoses();
  }

  /// The error is the last line, of the documented shape, and is the only one.
  static void expectOneErrorLine(const ProgramResult& result, const std::string& id) {
    std::string last;
    int errors = 0;
    std::istringstream lines(result.err);
    for (std::string line; std::getline(lines, line);) {
      errors += line.find("error[") != std::string::npos;
      last = line;
    }
    EXPECT_EQ(errors, 1) << result.err;
    const std::regex shape(R"(accessvdb: error\[([a-z0-9_]+\.[a-z0-9_]+)\] ([^ ].*: )?[^ ].*\.( .*\.)?)");
    std::smatch match;
    ASSERT_TRUE(std::regex_match(last, match, shape)) << last;
    if (!id.empty()) {
      EXPECT_EQ(match[1], id) << last;
    }
  }

  /// Expects a failure that leaves only report.json, with that code.
  void expectFailure(const std::vector<std::string>& more, int code, const std::string& id = {}) {
    const ProgramResult result = runProgram(mapArguments(more));
    EXPECT_EQ(result.exit_code, code) << result.err;
    expectOneErrorLine(result, id);
    EXPECT_EQ(result.out, "");
    EXPECT_EQ(listing("out"), std::vector<std::string>{"report.json"}) << "only the report, no part of a result";
    const auto report = nlohmann::json::parse(readText("out/report.json"));
    EXPECT_EQ(report.at("exit_code"), code);
    if (!id.empty()) {
      EXPECT_EQ(report.at("error").at("id"), id);
    }
    std::filesystem::remove_all(folder_ / "out");
  }
};

TEST_F(ExitCodes, Usage) {
  for (const char* voxel : {"0", "-1", "nan", "1e-6", "inf"}) {
    SCOPED_TRACE(voxel);
    expectFailure({"--voxel", voxel}, 2);
  }
  expectFailure({"--tau", "4x"}, 2, "usage.length");
  expectFailure({"--tau", "nan"}, 2);
  expectFailure({"--max-memory", "2Q"}, 2, "usage.bytes");
  expectFailure({"--max-device-memory", "2Q"}, 2, "usage.bytes");
  expectFailure({"--max-device-memory", "60M"}, 2, "config.range");
  const ProgramResult small = runProgram(mapArguments({"--max-device-memory", "3"}));
  EXPECT_NE(small.err.find(" 3 is outside 64000000 .. "), std::string::npos) << small.err;
  expectFailure({"--profile", "best"}, 2, "usage.word");
  expectFailure({"--change", "slow"}, 2, "usage.word");
  expectFailure({"--change", "block", "--static"}, 2, "usage.change");
  expectFailure({"--change", "block", "--profile", "paper"}, 2, "usage.change");
  expectFailure({"--directions", "3"}, 2);
  expectFailure({"--every", "0"}, 2, "usage.every");
  expectFailure({"--view", "0,0,0"}, 2, "usage.view");
  expectFailure({"--sensor-at", "1,2"}, 2, "usage.vector");
  expectFailure({"--tool", "builtin:pencil", "--tool-unit", "mm"}, 2, "usage.builtin_pose");
}

TEST_F(ExitCodes, Orientations) {
  for (const char* text : {"all", "sphere", "pitch:0:1", "list:"}) {
    SCOPED_TRACE(text);
    expectFailure({"--orientations", text}, 2, "orientations.text");
  }
  for (const char* text : {"sphere:0", "sphere:-5", "sphere:nan", "pitch:0:10:0", "pitch:0:10:nan", "pitch:20:10:1"}) {
    SCOPED_TRACE(text);
    expectFailure({"--orientations", text}, 2, "orientations.range");
  }
  expectFailure({"--orientations", "sphere:3"}, 5, "orientations.count");
  expectFailure({"--orientations", "pitch:-90:90:5"}, 5, "orientations.count");
  expectFailure({"--orientations", "sphere:15", "--profile", "paper"}, 2, "orientations.policy");
  expectFailure({"--orientations", "sphere:15", "--policy", "paper"}, 2, "orientations.policy");
  expectFailure({"--rolls", "65"}, 2, "config.range");
  expectFailure({"--rolls", "-1"}, 2, "config.range");
  expectFailure({"--rolls", "2", "--profile", "paper"}, 2, "orientations.policy");
  expectFailure({"--rolls", "2", "--policy", "paper"}, 2, "orientations.policy");
  expectFailure({"--orientations", "list:" + path("none.txt")}, 3, "input.missing");
  const std::pair<const char*, const char*> kLists[] = {
      {"empty.txt", ""}, {"numbers.txt", "yaw pitch roll\n1 2\n"}, {"norm.txt", "qw qx qy qz\n1 1 0 0\n"}};
  for (const auto& [name, content] : kLists) {
    SCOPED_TRACE(name);
    writeText(name, content);
    expectFailure({"--orientations", "list:" + path(name)}, 3, "orientations.malformed");
  }
  std::string many = "yaw pitch roll\n";
  for (int n = 0; n < 5000; ++n) many += std::to_string(n * 0.05) + " 0 0\n";
  writeText("many.txt", many);
  expectFailure({"--orientations", "list:" + path("many.txt")}, 5, "orientations.count");
}

TEST_F(ExitCodes, UsageBeforeAnythingIsKnown) {
  const ProgramResult verb = runProgram({"frobnicate"});
  EXPECT_EQ(verb.exit_code, 2);
  expectOneErrorLine(verb, "usage.verb");
  EXPECT_NE(verb.err.find("map, tile, advise, live, consistency, info, query, diff, approaches, views, whatif, render, "
                          "report and export"),
            std::string::npos)
      << verb.err;
  EXPECT_EQ(runProgram(std::vector<std::string>{}).exit_code, 2);
  for (const char* name : {"simulate", "evaluate", "bench"}) {
    for (const char* flag : {"--help", "--out"}) {
      const ProgramResult moved = runProgram({name, flag});
      EXPECT_EQ(moved.exit_code, 2);
      EXPECT_EQ(moved.out, "");
      expectOneErrorLine(moved, "usage.lab");
      EXPECT_NE(moved.err.find("accessvdb-lab " + std::string(name)), std::string::npos) << moved.err;
    }
  }
  const ProgramResult lab = runLab({"map"});
  EXPECT_EQ(lab.exit_code, 2);
  expectOneErrorLine(lab, "usage.verb");
  EXPECT_NE(lab.err.find("simulate, evaluate and bench"), std::string::npos) << lab.err;
  for (const std::vector<std::string>& arguments : {std::vector<std::string>{"map", "--frobnicate"},
                                                    {"map", "--voxel", "abc"},
                                                    {"map", "--voxel"},
                                                    {"map"},
                                                    {"query", "--map", "x"},
                                                    {"info"},
                                                    {"render", "--out", "x.png"}}) {
    SCOPED_TRACE(arguments.back());
    const ProgramResult result = runProgram(arguments);
    EXPECT_EQ(result.exit_code, 2);
    expectOneErrorLine(result, {});
  }
}

TEST_F(ExitCodes, ConfigurationFiles) {
  writeText("bad.toml", "[map]\nvoxle = 0.1\n");
  expectOneErrorLine(runProgram({"map", "--config", path("bad.toml")}), "config.key");
  writeText("broken.toml", "voxel = = 1\n");
  const ProgramResult broken = runProgram({"map", "--config", path("broken.toml")});
  EXPECT_EQ(broken.exit_code, 2);
  expectOneErrorLine(broken, "config.syntax");
  const ProgramResult missing = runProgram({"map", "--config", path("none.toml")});
  EXPECT_EQ(missing.exit_code, 3);
  expectOneErrorLine(missing, "config.unreadable");
}

TEST_F(ExitCodes, UnreadableInput) {
  expectFailure({"--scans", path("nowhere")}, 3);
  expectFailure({"--poses", path("nowhere.txt")}, 3);
  expectFailure({"--tool", path("nowhere.stl"), "--tool-unit", "m"}, 3);
  writeText("empty/000100.000000.pcd", "");
  expectFailure({"--scans", path("empty")}, 3);
  writeText("text.txt", "these are\nnot poses\n");
  expectFailure({"--poses", path("text.txt")}, 3);
}

TEST_F(ExitCodes, ToolWithoutFaces) {
  writeText("points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n");
  expectFailure({"--tool", path("points.obj"), "--tool-unit", "m"}, 4, "tool.no_faces");
}

TEST_F(ExitCodes, UnusableInput) {
  writePoses(7, 5000);
  expectFailure({}, 4);
  writeText("poses.txt", "100 0 0 0 0 0 0 0\n101 0 0 0 0 0 0 0\n102 0 0 0 0 0 0 1\n103 0 0 0 0 0 0 1\n");
  expectFailure({}, 4);
  writeText("poses.txt", "100 0 0 0 0 0 0 2\n101 0 0 0 0 0 0 1\n102 0 0 0 0 0 0 1\n103 0 0 0 0 0 0 1\n");
  expectFailure({}, 4);
  writeText("poses.txt", "103 0 .3 0 0 0 0 1\n102 0 .2 0 0 0 0 1\n101 0 .1 0 0 0 0 1\n100 0 0 0 0 0 0 1\n");
  expectFailure({}, 4);
  EXPECT_EQ(runProgram(mapArguments({"--sort-poses"})).exit_code, 0);
}

TEST_F(ExitCodes, ToolOutsideAllSizes) {
  writeBoxTool(150, 20);
  expectFailure({"--tool", path("tool.obj"), "--tool-unit", "m"}, 4);
}

TEST_F(ExitCodes, NoReturnAtAll) {
  writeText(
      "origin/000100.000000.pcd",
      "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 3\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n"
      "POINTS 3\nDATA ascii\n0 0 0\n0 0 0\n0 0 0\n");
  writePoses(1);
  expectFailure({"--scans", path("origin")}, 4, "scans.no_returns");
}

TEST_F(ExitCodes, MemoryLimitNamesAVoxelThatFits) {
  // 183 MiB are for the program, buffers and the picture, the rest is for the map: too little at 5 mm, enough at a few
  // centimetres.
  const std::vector<std::string> limit = {"--voxel", "0.005", "--max-memory", "193M", "--tiles", "off"};
  const ProgramResult result = runProgram(mapArguments(limit));
  EXPECT_EQ(result.exit_code, 5) << result.err;
  expectOneErrorLine(result, "limit.memory");
  std::smatch voxel;
  ASSERT_TRUE(std::regex_search(result.err, voxel, std::regex("--voxel ([0-9.]+) or larger"))) << result.err;
  EXPECT_GT(std::stod(voxel[1]), 0.005);
  EXPECT_EQ(runProgram(mapArguments({"--max-memory", "193M", "--voxel", voxel[1]})).exit_code, 0);
  std::filesystem::remove_all(folder_ / "out");
  expectFailure(limit, 5, "limit.memory");
}

/// Of a sphere also the STEP, at the same voxel size; the advice is followed.
TEST_F(ExitCodes, MemoryLimitNamesAStepThatFits) {
  const auto run = [&](const std::string& orientations) {
    std::vector<std::string> arguments = mapArguments({"--voxel", "0.05", "--max-memory", "215M", "--tiles", "off",
                                                       "--device", "cpu", "--orientations", orientations});
    *(std::find(arguments.begin(), arguments.end(), "--tool") + 1) = "builtin:pruner";
    return runProgram(arguments);
  };
  const ProgramResult result = run("sphere:3.8");
  EXPECT_EQ(result.exit_code, 5) << result.err;
  expectOneErrorLine(result, "limit.memory");
  std::smatch step;
  ASSERT_TRUE(std::regex_search(result.err, step, std::regex("a STEP of ([0-9.]+) degrees in --orientations sphere")))
      << result.err;
  EXPECT_GT(std::stod(step[1]), 3.8);
  const ProgramResult fitting = run("sphere:" + step[1].str());
  EXPECT_EQ(fitting.exit_code, 0) << fitting.err;
}

TEST_F(ExitCodes, DeviceThatIsNotThere) {
  setenv("CUDA_VISIBLE_DEVICES", "-1", 1);  // also on a machine that has one
  expectFailure({"--device", "cuda"}, 6);
  expectFailure({"--device", "cuda", "--scans", path("nowhere")}, 6);  // said before the scans are looked at
  unsetenv("CUDA_VISIBLE_DEVICES");
}

TEST_F(ExitCodes, UnwritableFolder) {
  writeText("file", "a regular file");
  const ProgramResult result = runProgram(mapArguments({"--out", path("file/below")}));
  EXPECT_EQ(result.exit_code, 7) << result.err;
  expectOneErrorLine(result, {});
  EXPECT_EQ(readText("file"), "a regular file");
  // Detected before the scans are listed, let alone read.
  const ProgramResult first = runProgram(mapArguments({"--out", path("file/below"), "--scans", path("nowhere")}));
  EXPECT_EQ(first.exit_code, 7) << first.err;
}

TEST_F(ExitCodes, FullDisk) {
  ProgramSetup setup;
  setup.arguments = mapArguments();
  setup.file_size_limit = 16384;  // room for the report, not for the field
  const ProgramResult result = runProgram(setup);
  EXPECT_EQ(result.exit_code, 7) << result.err << " signal " << result.signal;
  expectOneErrorLine(result, {});
  EXPECT_EQ(listing("out"), std::vector<std::string>{"report.json"});
  EXPECT_EQ(nlohmann::json::parse(readText("out/report.json")).at("exit_code"), 7);
}

TEST_F(ExitCodes, NoClobber) {
  writeText("out/points.ply", "mine");
  const ProgramResult result = runProgram(mapArguments({"--no-clobber"}));
  EXPECT_EQ(result.exit_code, 7);
  expectOneErrorLine(result, "output.exists");
  EXPECT_EQ(listing("out"), std::vector<std::string>{"points.ply"});
  EXPECT_EQ(readText("out/points.ply"), "mine");
}

TEST_F(ExitCodes, OtherVerbs) {
  writeText("not.vdb", "not a vdb file");
  for (const std::vector<std::string>& arguments : {std::vector<std::string>{"info", path("not.vdb")},
                                                    {"info", path("nowhere.vdb")},
                                                    {"info", path("scans")},
                                                    {"query", "--map", path("scans"), "--at", "0,0,0"},
                                                    {"render", "--map", path("scans"), "--out", path("x.png")}}) {
    const ProgramResult result = runProgram(arguments);
    EXPECT_EQ(result.exit_code, 3) << arguments[1] << result.err;
    expectOneErrorLine(result, {});
    EXPECT_EQ(result.out, "");
  }
  EXPECT_FALSE(std::filesystem::exists(path("x.png")));
  EXPECT_EQ(runProgram({"render", "--tool", "builtin:pencil", "--out", path("not.vdb/x.png")}).exit_code, 7);
}

}  // namespace
}  // namespace accessvdb::cli_test

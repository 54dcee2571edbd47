// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// map --rolling: the merged result has the bytes of one piece, whatever left memory and whenever the run was stopped.
#include <gtest/gtest.h>
#include <signal.h>

#include <cstdlib>

#include "cli/checkpoint_world.h"
#include "cli/program_run.h"
#include "cli/rolling_world.h"

namespace accessvdb::cli_test {
namespace {

namespace fs = std::filesystem;

class RollingMap : public ProgramTest {
 protected:
  [[nodiscard]] std::vector<std::string> arguments(std::vector<std::string> more) const {
    more.insert(more.begin(), {"--threads", "2", "--width", "160", "--height", "120"});
    return mapOfRollingWorld(folder_, more);
  }
  [[nodiscard]] std::vector<std::string> rolling(std::vector<std::string> more) const {
    more.insert(more.begin(), {"--rolling", path("roll")});
    return arguments(more);
  }
  /// Little more than the least --max-memory that a run names: its tiles get about 80 MB.
  [[nodiscard]] std::string littleMemory() const {
    const ProgramResult refused = runProgram(rolling({"--out", path("none"), "--max-memory", "1M"}));
    EXPECT_EQ(refused.exit_code, 5) << refused.err;
    const std::string key = "Use --max-memory ";
    const std::size_t at = refused.err.find(key);
    EXPECT_NE(at, std::string::npos) << refused.err;
    if (at == std::string::npos) return "1G";
    return std::to_string(std::atoi(refused.err.c_str() + at + key.size()) + 48) + "M";
  }
  void expectOnePiece(const std::string& out, std::vector<std::string> more = {}) const {
    more.insert(more.end(), {"--tiles", "off", "--out", path("one")});
    ASSERT_EQ(runProgram(arguments(more)).exit_code, 0);
    ASSERT_NE(readText("one/report.json").find("\"accessible\": "), std::string::npos);
    const ProgramResult merged =
        runProgram({"tile", "merge", path(out), "--points", path("all.ply"), "--vdb", path("all.vdb")});
    ASSERT_EQ(merged.exit_code, 0) << merged.err;
    EXPECT_TRUE(contentOf(folder_ / "one/points.ply") == contentOf(folder_ / "all.ply"));
    EXPECT_TRUE(contentOf(folder_ / "one/field.vdb") == contentOf(folder_ / "all.vdb"));
  }
  /// "N left it" of the notice.
  static int saved(const std::string& err) {
    const std::size_t at = err.find(" left it, ");
    const std::size_t from = err.rfind(' ', at - 1);
    return at == std::string::npos ? -1 : std::atoi(err.c_str() + from);
  }
};

TEST_F(RollingMap, TilesThatLeaveGiveTheBytesOfOnePiece) {
  writeRollingWorld({.scans = 60, .step_m = 4, .returns_home = true}, folder_);
  const ProgramResult run = runProgram(rolling({"--out", path("out"), "--max-memory", littleMemory()}));
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_GT(saved(run.err), 3) << run.err;
  EXPECT_EQ(run.err.find("rolling.short"), std::string::npos) << run.err;
  expectOnePiece("out");
  // Points of all labels, or the comparison says little.
  const std::string report = readText("one/report.json");
  EXPECT_EQ(report.find("\"accessible\": 0,"), std::string::npos);
  EXPECT_EQ(report.find("\"blocked\": 0,"), std::string::npos);
}

/// Rays are evidence in each tile that they cross.
TEST_F(RollingMap, WhatHasGoneHasGoneInTilesToo) {
  writeRollingWorld({.scans = 140, .step_m = 1.6, .returns = 8000, .returns_home = true, .boards_go = true}, folder_);
  const std::vector<std::string> full = {"--change", "full", "--free-for", "20"};
  std::vector<std::string> more = full;
  more.insert(more.end(), {"--out", path("out"), "--max-memory", littleMemory()});
  const ProgramResult run = runProgram(rolling(more));
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_GT(saved(run.err), 3) << run.err;
  EXPECT_EQ(run.err.find("rolling.short"), std::string::npos) << run.err;
  expectOnePiece("out", full);
  EXPECT_NE(readText("one/report.json").find("\"changed\": "), std::string::npos);
  EXPECT_EQ(readText("one/report.json").find("\"changed\": 0"), std::string::npos);
}

TEST_F(RollingMap, AStoppedRunGoesOn) {
  writeRollingWorld({.scans = 40}, folder_);
  ProgramSetup setup;
  setup.arguments = rolling({"--out", path("out"), "--checkpoint-every", "1ms"});
  setup.signal_after = "fusing scans";
  setup.act = [](pid_t process) { kill(process, SIGTERM); };
  const ProgramResult stopped = runProgram(setup);
  ASSERT_EQ(stopped.exit_code, 128 + SIGTERM) << stopped.err;
  EXPECT_FALSE(fs::exists(folder_ / "out/plan.json"));
  // Without --resume it is somebody's work.
  const ProgramResult again = runProgram(rolling({"--out", path("out")}));
  EXPECT_EQ(again.exit_code, 7) << again.err;
  EXPECT_NE(again.err.find("--resume"), std::string::npos) << again.err;
  const ProgramResult resumed = runProgram(rolling({"--out", path("out"), "--resume", path("roll")}));
  ASSERT_EQ(resumed.exit_code, 0) << resumed.err;
  EXPECT_NE(resumed.err.find("going on after "), std::string::npos) << resumed.err;
  EXPECT_NE(readText("out/report.json").find("\"points_in\": 160000"), std::string::npos);
  expectOnePiece("out");
}

TEST_F(RollingMap, RefusesWhatItCannotGoOnWith) {
  writeRollingWorld({.scans = 6}, folder_);
  ASSERT_EQ(runProgram(rolling({"--out", path("out")})).exit_code, 0);
  const auto resumed = [&](std::vector<std::string> more) {
    more.insert(more.end(), {"--out", path("out2"), "--resume", path("roll")});
    return runProgram(rolling(more));
  };
  const auto expect = [](const ProgramResult& result, int code, const std::string& id) {
    EXPECT_EQ(result.exit_code, code) << result.err;
    EXPECT_NE(result.err.find(id), std::string::npos) << result.err;
  };
  expect(resumed({"--knn", "9"}), 4, "rolling.changed");
  expect(resumed({"--every", "2"}), 4, "state.params");
  const std::string scan = contentOf(folder_ / "scans/000002.pcd");
  std::ofstream(folder_ / "scans/000002.pcd", std::ios::binary) << contentOf(folder_ / "scans/000001.pcd");
  expect(resumed({}), 4, "state.scans");
  std::ofstream(folder_ / "scans/000002.pcd", std::ios::binary) << scan;
  const ProgramResult unchanged = resumed({});
  EXPECT_EQ(unchanged.exit_code, 0) << unchanged.err;
  EXPECT_TRUE(contentOf(folder_ / "out/field.json") == contentOf(folder_ / "out2/field.json"));
}

TEST_F(RollingMap, LeavesForeignFoldersAlone) {
  writeRollingWorld({.scans = 3}, folder_);
  fs::create_directories(folder_ / "roll");
  writeText("roll/mine.txt", "mine");
  const ProgramResult foreign = runProgram(rolling({"--out", path("out")}));
  EXPECT_EQ(foreign.exit_code, 7) << foreign.err;
  EXPECT_EQ(readText("roll/mine.txt"), "mine");
  fs::remove_all(folder_ / "roll");
  ASSERT_EQ(runProgram(arguments({"--tiles", "12.8", "--out", path("out")})).exit_code, 0);
  const std::string plan = readText("out/plan.json");
  const ProgramResult other = runProgram(rolling({"--out", path("out")}));
  EXPECT_EQ(other.exit_code, 7) << other.err;
  EXPECT_EQ(readText("out/plan.json"), plan);
  EXPECT_FALSE(fs::exists(folder_ / "roll")) << "nothing was begun";
}

TEST_F(RollingMap, OptionsThatContradictItAreNamed) {
  writeRollingWorld({.scans = 2}, folder_);
  const std::vector<std::vector<std::string>> contradictions = {
      {"--change", "full"}, {"--policy", "paper"},           {"--tiles", "12.8"},        {"--surface"},
      {"--sequence", "1"},  {"--remove", "box:0,0,0,1,1,1"}, {"--resume", path("else")}, {"--checkpoint", path("cp")}};
  for (const std::vector<std::string>& more : contradictions) {
    std::vector<std::string> all = more;
    all.insert(all.end(), {"--out", path("out")});
    const ProgramResult refused = runProgram(rolling(all));
    EXPECT_EQ(refused.exit_code, 2) << more.front() << refused.err;
    EXPECT_NE(refused.err.find("usage.rolling"), std::string::npos) << more.front() << refused.err;
  }
  EXPECT_FALSE(fs::exists(folder_ / "roll"));
  EXPECT_EQ(runProgram(rolling({"--out", path("roll")})).exit_code, 2);
}

}  // namespace
}  // namespace accessvdb::cli_test

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is refused, stopped or too large: the documented code in one line, and what was finished is still good
/// (docs/large_maps.md, "If something goes wrong").
#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <fstream>
#include <future>
#include <nlohmann/json.hpp>
#include <thread>

#include "large/tiled_test.h"
#include "large/walk_scans.h"

namespace accessvdb::large_test {
namespace {

namespace fs = std::filesystem;

class TileRefusal : public TiledTest {
 protected:
  void planAndBin(const Flags& more = {"--tiles", "6.4"}) const {
    succeed(plan(more));
    succeed(step("bin"));
  }
  static bool has(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }
};

TEST_F(TileRefusal, TilesSmallerThanTwoMarginsNameTheSmallestThatWorks) {
  for (const std::string tool : {"builtin:pencil", "builtin:pruner"}) {
    what_[1] = tool;
    const std::string line = refuse(map({"--tiles", "0.5"}), 2, "usage.tiles");
    const std::string before = "Use --tiles ";
    ASSERT_TRUE(has(line, before)) << line;
    const std::string least = std::to_string(std::stod(line.substr(line.find(before) + before.size())));
    refuse(map({"--tiles", std::to_string(std::stod(least) * 0.99)}), 2, "usage.tiles");
    EXPECT_FALSE(fs::exists(path("out/plan.json")));
    succeed(map({"--tiles", least}, "out_" + tool));
  }
}

TEST_F(TileRefusal, LengthsThatAreNone) {
  for (const char* text : {"0", "-6.4", "nan", "inf", "6.4m", "six", "1e999"}) {
    refuse(map({"--tiles", text}), 2, "usage.tiles");
  }
  refuse(map({"--tiles", ""}), 2, "usage.option");
  EXPECT_FALSE(fs::exists(path("out/plan.json")));
}

TEST_F(TileRefusal, WhatNeedsTheWholeMap) {
  for (const Flags& flags : {Flags{"--surface"}, Flags{"--sequence", "2"}, Flags{"--policy", "paper"}}) {
    refuse(map(plus({"--tiles", "6.4"}, flags)), 2, "usage.tiles");
    refuse(plan(plus({"--tiles", "6.4"}, flags)), 2, "usage.tiles");
  }
}

TEST_F(TileRefusal, AnotherRunInTheSameFolderIsNamed) {
  const Flags tiles = {"--tiles", "6.4"};
  succeed(map(tiles));
  const std::string all = readText("out/field.json");
  const auto refused = [&](const Flags& changed, const std::string& named) {
    const std::string line = refuse(changed, 4, "plan.changed");
    EXPECT_TRUE(has(line, named)) << "\"" << named << "\" in: " << line;
  };
  const Flags what = what_;
  what_[3] = "0.04";
  refused(map(tiles), "voxel");
  what_ = what;
  what_[1] = "builtin:pruner";
  refused(map(tiles), "tool");
  what_ = what;
  refused(map(plus(tiles, {"--origin", "0,0,5"})), "origin");
  refused(map(plus(tiles, {"--half"})), "half");
  refused(map(plus(tiles, {"--compression", "zip"})), "compression");
  refused(map(plus(tiles, {"--every", "2"})), "every");
  refused(map(plus(tiles, {"--corridor", "0.3"})), "corridor");
  refused(map({"--tiles", "12.8"}), "another size");
  refused(plan({"--tiles", "12.8"}), "another size");
  refused(map({"--tiles", "off"}), "tiles");
  fs::remove(path("scans/000005.pcd"));
  writeWalk(folder_, {.scans = 5});
  refused(map(tiles), "7 input files instead of 6");
  writeWalk(folder_, {.step_m = 1.5});
  refused(map(tiles), "poses.txt has changed");
  writeWalk(folder_, {.seed = 2});
  refused(map(tiles), "000000.pcd has changed");
  // Everything that was there still is.
  EXPECT_EQ(readText("out/field.json"), all);
  succeed(map(plus(tiles, {"--fresh"})));
  expectOnePiece();
}

TEST_F(TileRefusal, TheSameRunElsewhereAndAgainIsTheSame) {
  fs::current_path(folder_);
  scans_ = {"--scans", "scans", "--poses", "./poses.txt"};
  planAndBin();  // with relative paths, from the folder
  fs::current_path("/");
  succeed(step("run"));
  scans_ = {"--scans", path("scans"), "--poses", path("poses.txt")};
  EXPECT_TRUE(has(succeed(map({"--tiles", "6.4", "--threads", "1", "--host-fusion", "--max-device-memory", "1G"})),
                  "going on"));
  EXPECT_TRUE(has(succeed(map({"--max-memory", "2G"})), "going on"));
  expectOnePiece();
}

TEST_F(TileRefusal, TheOriginOfAResultThatIsGone) {
  what_ = plus(what_, {"--origin", "1,2,3"});
  succeed(map({"--tiles", "off"}, "earlier"));
  what_.back() = path("earlier");
  succeed(plan({"--tiles", "6.4"}));
  fs::rename(path("earlier"), path("moved"));
  succeed(step("bin"));
  succeed(step("run"));
  what_.back() = path("moved");
  expectOnePiece();
}

TEST_F(TileRefusal, AScanThatChangedBetweenPlanAndBin) {
  succeed(plan({"--tiles", "6.4"}));
  std::ofstream(path("scans/000003.pcd"), std::ios::app) << "more";
  EXPECT_TRUE(has(refuse(step("bin"), 4, "plan.changed"), "000003.pcd"));
  fs::remove(path("scans/000003.pcd"));
  EXPECT_EQ(runProgram(step("bin")).exit_code, 4);
  refuse(step("run"), 3, "rays.missing");
  writeWalk(folder_, {});
  succeed(step("bin"));
  succeed(step("run"));
  expectOnePiece();
}

/// A shard is made again, and the scan that it needs has other bytes of the same size than at first.
TEST_F(TileRefusal, AScanThatChangedAfterItWasSorted) {
  planAndBin();
  fs::remove(path("out/rays/shard-000000.rays"));
  const std::string scan = readText("scans/000003.pcd");
  flipByte("scans/000003.pcd", sizeOf("scans/000003.pcd") - 7);
  EXPECT_TRUE(has(refuse(step("bin"), 4, "plan.changed"), "000003.pcd"));
  std::ofstream(path("scans/000003.pcd"), std::ios::binary) << scan;
  fs::remove(path("out/rays/shard-000000.rays"));
  succeed(step("bin"));
  succeed(step("run"));
  expectOnePiece();
}

TEST_F(TileRefusal, TheToolThatChangedAfterThePlan) {
  writeBoxTool(0.3, 0.1);
  what_ = {"--tool", path("tool.obj"), "--tool-unit", "m", "--tool-tip", "0,0,0", "--voxel", "0.05", "--device", "cpu"};
  planAndBin();
  const std::string tool = readText("tool.obj");
  writeBoxTool(0.3, 0.12);
  EXPECT_TRUE(has(refuse(step("run"), 4, "plan.changed"), "tool"));
  refuse(map({"--tiles", "6.4"}), 4, "plan.changed");
  writeText("tool.obj", tool);
  succeed(step("run"));
  expectOnePiece();
}

TEST_F(TileRefusal, NamesThatAreNoTiles) {
  planAndBin();
  for (const char* name : {"99_99", "../x", "1_1.9", "0_0.0", "0_0.000000000000000000000000000000000000", "0_0/..",
                           "2147483647_0", "0_0.", "tiles/0_0"}) {
    SCOPED_TRACE(name);
    refuse(step("run", {"--tile", name}), 2, "usage.tile");
  }
  refuse(step("run", {"--tile", ""}), 2, "usage.option");
  // Nothing was marked as to be run in quarters that are too small.
  for (const std::string& name : tilesOf()) EXPECT_FALSE(has(name, ".")) << name;
  succeed(step("run"));
  expectOnePiece();
}

TEST_F(TileRefusal, StepsOutOfOrder) {
  for (const char* name : {"bin", "run", "list", "status", "merge"}) {
    fs::create_directories(path("empty"));
    refuse(step(name, {}, "empty"), 3, "plan.missing");
    EXPECT_EQ(runProgram({"tile", name}).exit_code, 2) << "without OUT";
  }
  EXPECT_EQ(runProgram({"tile", "plan"}).exit_code, 2);
  EXPECT_EQ(runProgram({"tile", "fold"}).exit_code, 2);
  EXPECT_EQ(runProgram({"tile"}).exit_code, 2);
  succeed(plan({"--tiles", "6.4"}));
  EXPECT_TRUE(has(succeed(step("status")), "tile bin"));
  refuse(step("run"), 3, "rays.missing");
  succeed(step("bin"));
  refuse(step("merge"), 4, "tile.unfinished");
  succeed(step("run", {"--tile", tilesOf().front()}));
  EXPECT_TRUE(has(succeed(step("status")), "1 of "));
  refuse(step("merge", {"--points", path("all.ply")}), 4, "tile.unfinished");
  EXPECT_FALSE(fs::exists(path("all.ply")));
}

/// As accessvdb.tiles leaves them: tiles that were given up are named, and the rest is usable.
TEST_F(TileRefusal, TilesThatWereGivenUp) {
  planAndBin();
  const std::vector<std::string> names = tilesOf();
  const std::string bad = names.at(1), other = names.back();
  for (const std::string& name : names) {
    if (name != bad && name != other) succeed(step("run", {"--tile", name, "--threads", "1"}));
  }
  writeText("out/tiles/" + bad + ".poison.json", R"({"tile": "any", "exit_code": 70, "reason": "killed by SIGSEGV"})");
  const std::string status = succeed(step("status"));
  EXPECT_TRUE(has(status, "given up: " + bad + ", code 70: killed by SIGSEGV")) << status;
  EXPECT_TRUE(has(refuse(step("merge"), 4, "tile.unfinished"), "--partial"));
  EXPECT_FALSE(fs::exists(path("out/report.json")));

  EXPECT_TRUE(has(succeed(step("merge", {"--partial", "--points", path("some.ply")})), "2 tiles are not finished"));
  nlohmann::json report = nlohmann::json::parse(readText("out/report.json"));
  EXPECT_EQ(report.at("partial"), true);
  const nlohmann::json poison = {{{"tile", bad}, {"exit_code", 70}, {"reason", "killed by SIGSEGV"}}};
  EXPECT_EQ(report.at("tiles").at("poison"), poison);
  EXPECT_EQ(report.at("tiles").at("todo"), 2);
  nlohmann::json index = nlohmann::json::parse(readText("out/field.json"));
  EXPECT_EQ(index.at("complete"), false);
  EXPECT_EQ(index.at("missing").size(), 2u);
  EXPECT_TRUE(fs::exists(path("out/rays"))) << "the tiles that are left need them";
  EXPECT_GT(sizeOf("some.ply"), 100'000u);
  EXPECT_TRUE(has(succeed({"query", "--map", path("out"), "--at", "3,0,0"}), "not all tiles"));

  // Finished after all, as a whole or in quarters, it is not named any more.
  succeed(step("run"));
  succeed(step("merge"));
  report = nlohmann::json::parse(readText("out/report.json"));
  EXPECT_EQ(report.at("partial"), false);
  EXPECT_TRUE(report.at("tiles").at("poison").empty());
  index = nlohmann::json::parse(readText("out/field.json"));
  EXPECT_TRUE(index.at("missing").empty());
  EXPECT_FALSE(fs::exists(path("out/tiles/" + bad + ".poison.json")));
  expectOnePiece();
  expectNoLeftovers();
  writeText("out/tiles/" + bad + ".poison.json", "{");
  succeed(step("status"));  // of a finished tile, so nobody reads it
  fs::remove_all(path("out/tiles/" + bad));
  refuse(step("status"), 3, "tile.damaged");
}

TEST_F(TileRefusal, FullDisk) {
  succeed(plan({"--tiles", "6.4"}));
  cli_test::ProgramSetup full;
  for (const char* name : {"bin", "run", "merge"}) {
    SCOPED_TRACE(name);
    full.arguments = step(name, std::string(name) == "merge" ? Flags{"--points", path("all.ply")} : Flags{});
    full.file_size_limit = 30000;
    const ProgramResult result = runProgram(full);
    EXPECT_EQ(result.exit_code, 7) << result.err;
    EXPECT_TRUE(has(result.err, "error[output.too_large]")) << result.err;
    succeed(step(name, {"--quiet"}));
  }
  EXPECT_FALSE(fs::exists(path("all.ply")));
  // The rays are there until the merge has succeeded.
  succeed(map({"--tiles", "6.4"}));
  expectOnePiece();
  expectNoLeftovers();
}

TEST_F(TileRefusal, StoppedInTheMiddleAndGoingOn) {
  cli_test::ProgramSetup stopped;
  stopped.arguments = map({"--tiles", "6.4", "--threads", "1"});
  stopped.signal_after = "tile ";
  for (const char* after : {"sorting returns", ": tile "}) {
    stopped.signal_after = after;
    stopped.act = [](pid_t program) { kill(program, SIGTERM); };
    const ProgramResult result = runProgram(stopped);
    EXPECT_EQ(result.exit_code, 143) << result.err;
    EXPECT_TRUE(has(result.err, "stopped after")) << result.err;
    EXPECT_EQ(nlohmann::json::parse(readText("out/report.json")).at("exit_code"), 143);
  }
  const auto before = tilesOf();
  EXPECT_GE(before.size(), 4u);
  EXPECT_TRUE(has(runProgram(step("status")).out, "next: accessvdb tile run"));
  succeed(map({"--tiles", "6.4"}));
  expectOnePiece();
  expectNoLeftovers();
}

/// Standard input of the programs that are run: a pipe that the test writes.
class StandardInput {
 public:
  StandardInput() : own_(dup(STDIN_FILENO)) {
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) throw std::runtime_error("no pipe");
    dup2(ends[0], STDIN_FILENO);
    ::close(ends[0]);
    write_ = ends[1];
  }
  ~StandardInput() {
    close();
    dup2(own_, STDIN_FILENO);
    ::close(own_);
  }
  StandardInput(const StandardInput&) = delete;
  StandardInput& operator=(const StandardInput&) = delete;
  void write(const std::string& text) const {
    EXPECT_EQ(::write(write_, text.data(), text.size()), static_cast<ssize_t>(text.size()));
  }
  void close() {
    if (write_ >= 0) ::close(write_);
    write_ = -1;
  }

 private:
  int own_, write_ = -1;
};

TEST_F(TileRefusal, AWorkerStopsWithItsParent) {
  planAndBin();
  const std::string names = runProgram(step("list")).out;
  StandardInput input;
  input.write(names);
  cli_test::ProgramSetup worker;
  worker.arguments = step("run", {"--worker", "--threads", "1"});
  worker.signal_after = ": tile ";
  worker.act = [&](pid_t) { input.close(); };
  const ProgramResult result = runProgram(worker);
  EXPECT_EQ(result.exit_code, 143) << result.err;
  EXPECT_TRUE(has(runProgram(step("status")).out, "next: accessvdb tile run"));
  succeed(step("run"));
  expectOnePiece();
  expectNoLeftovers();
}

TEST_F(TileRefusal, AWorkerMapsWhatItIsGivenAndEndsWhenNothingComes) {
  planAndBin();
  const std::string names = runProgram(step("list")).out;
  StandardInput input;
  input.write(names);
  const ProgramResult result = runProgram(step("run", {"--worker"}));
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(result.out, names);
  EXPECT_TRUE(has(runProgram(step("status")).out, "next: accessvdb tile merge"));
  expectOnePiece();
}

/// Names that nobody waits for are not passed over in silence: whole ones, and one without its end.
TEST_F(TileRefusal, AWorkerWhoseNamesEndTooSoonSaysSo) {
  planAndBin();
  const std::string names = runProgram(step("list")).out;
  for (const std::string& given : {names.substr(0, names.find('\n')), std::string(5000, '1')}) {
    StandardInput input;
    input.write(given);
    input.close();
    const ProgramResult result = runProgram(step("run", {"--worker"}));
    EXPECT_EQ(result.exit_code, 2) << result.err;
    EXPECT_TRUE(has(result.err, "error[usage.worker]")) << result.err;
    EXPECT_EQ(result.out, "");
  }
  StandardInput input;
  input.close();
  EXPECT_EQ(runProgram(step("run", {"--worker"})).exit_code, 0);
}

TEST_F(TileRefusal, AWorkerEndsWithATileThatFails) {
  planAndBin();
  const std::string names = runProgram(step("list")).out;
  StandardInput input;
  input.write(names.substr(0, names.find('\n') + 1) + "1000_1000\n" + names);
  const ProgramResult result = runProgram(step("run", {"--worker"}));
  EXPECT_EQ(result.exit_code, 2) << result.err;
  EXPECT_EQ(result.out, names.substr(0, names.find('\n') + 1));
  refuse(step("run", {"--worker", "--tile", "0_0"}), 2, "usage.conflict");
}

TEST_F(TileRefusal, TwoDriversOfOneFolder) {
  std::string second;
  cli_test::ProgramSetup first;
  first.arguments = map({"--tiles", "6.4", "--threads", "1"});
  first.signal_after = "sorting returns";
  first.act = [&](pid_t program) {
    kill(program, SIGSTOP);
    for (const Flags& arguments : {map({"--tiles", "6.4"}), step("bin"), step("merge")}) {
      refuse(arguments, 7, "output.locked");
    }
    kill(program, SIGCONT);
  };
  EXPECT_EQ(runProgram(first).exit_code, 0);
  expectOnePiece();
}

TEST_F(TileRefusal, NothingIsOverwrittenWithNoClobber) {
  succeed(map({"--tiles", "6.4"}));
  const std::string report = readText("out/report.json");
  refuse(map({"--tiles", "6.4", "--no-clobber"}), 7, "output.exists");
  refuse(map({"--tiles", "6.4", "--no-clobber", "--fresh"}), 7, "output.exists");
  EXPECT_EQ(readText("out/report.json"), report);
  fs::remove(path("out/report.json"));
  fs::remove(path("out/preview.png"));
  refuse(map({"--tiles", "6.4", "--no-clobber", "--fresh"}), 7, "output.exists");
  expectOnePiece();
}

TEST_F(TileRefusal, FilesMergedIntoTheFolderStay) {
  succeed(map({"--tiles", "6.4"}));
  succeed(step("merge", {"--points", path("out/points.ply"), "--vdb", path("out/field.vdb")}));
  const std::string points = readText("out/points.ply");
  succeed(map({"--tiles", "6.4"}));
  EXPECT_EQ(readText("out/points.ply"), points);
  expectOnePiece();
}

TEST_F(TileRefusal, FilesOfAnEarlierMapInOnePieceGo) {
  succeed(map({"--tiles", "off"}));
  EXPECT_TRUE(fs::exists(path("out/points.ply")));
  succeed(map({"--tiles", "6.4"}));
  for (const char* name : {"points.ply", "field.vdb", "field_points.vdb"}) {
    EXPECT_FALSE(fs::exists(path(std::string("out/") + name))) << name;
  }
}

TEST_F(TileRefusal, TooLittleMemoryForTheToolSplitsNothing) {
  planAndBin({"--tiles", "12.8"});
  refuse(step("run", {"--max-memory", "50M"}), 5, "limit.memory");
  refuse(step("run", {"--max-device-memory", "1G"}), 2, "usage.option");  // no GPU fuses in tiles
  for (const std::string& name : tilesOf()) EXPECT_FALSE(has(name, ".")) << name;
  succeed(step("run"));
  succeed(step("merge", {"--vdb", path("all.vdb"), "--keep-rays"}));
  refuse(step("merge", {"--vdb", path("small.vdb"), "--max-memory", "50M"}), 5, "limit.memory");
  EXPECT_FALSE(fs::exists(path("small.vdb")));
  expectOnePiece();
  expectNoLeftovers();
}

}  // namespace
}  // namespace accessvdb::large_test

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A map in tiles has the bytes of one in one piece: points.ply and field.vdb, whatever the tiles, the order in which
/// they are run, and by whom. The oracle is `map --tiles off`.
#include <algorithm>
#include <fstream>
#include <future>
#include <random>

#include "accessvdb/tiles.h"
#include "large/tiled_test.h"
#include "large/walk_scans.h"

namespace accessvdb::large_test {
namespace {

using TileBytes = TiledTest;

TEST_F(TileBytes, OneCommandWithEveryToolTileSizeAndThreadCount) {
  for (const auto& [tool, edge_m, threads] :
       {std::tuple{"builtin:pencil", "6.4", "1"}, {"builtin:pencil", "12.8", "2"}, {"builtin:pruner", "6.4", "2"}}) {
    SCOPED_TRACE(std::string(tool) + " " + edge_m + " " + threads);
    what_[1] = tool;
    succeed(map({"--tiles", "off"}, "one"));
    succeed(map({"--tiles", edge_m, "--threads", threads, "--fresh"}));
    succeed(step("merge", {"--points", path("all.ply"), "--vdb", path("all.vdb")}));
    EXPECT_GE(tilesOf().size(), 4u);
    expectSameFiles("all.ply", "one/points.ply");
    expectSameFiles("all.vdb", "one/field.vdb");
    expectNoLeftovers();
  }
}

TEST_F(TileBytes, SeveralTools) {
  what_ = {"--tool",           "builtin:pencil",
           "--tool",           "builtin:pruner",
           "--tool",           "builtin:pencil",
           "--tool-name",      "thin",
           "--tool-name",      "arm",
           "--tool-name",      "tilted",
           "--orientations",   "yaw",
           "--orientations",   "yaw",
           "--orientations",   "sphere:30",
           "--max-collisions", "0",
           "--max-collisions", "auto",
           "--max-collisions", "0.5l",
           "--voxel",          "0.05",
           "--device",         "cpu",
           "--width",          "200",
           "--height",         "100",
           "--directions",     "36"};
  what_.emplace_back("--allow-hidden-tool");
  succeed(map({"--tiles", "off"}, "one"));
  succeed(plan({"--tiles", "6.4"}));
  succeed(step("bin"));
  succeed(step("run"));
  succeed(step("merge", {"--points", path("all.ply"), "--vdb", path("all.vdb")}));
  EXPECT_GE(tilesOf().size(), 4u);
  expectSameFiles("all.ply", "one/points.ply");
  expectSameFiles("all.vdb", "one/field.vdb");
  const std::string grids = succeed({"info", path("one/field.vdb")});
  for (const char* grid : {"best_tool", "accessible_thin", "accessible_arm", "accessible_tilted"}) {
    EXPECT_NE(grids.find(grid), std::string::npos) << grid;
  }
  // Another order is another plan.
  std::swap(what_[1], what_[3]);
  refuse(plan({"--tiles", "6.4"}), 4, "plan.changed");
}

TEST_F(TileBytes, AnotherVoxelAndCorridor) {
  what_[1] = "builtin:pruner";
  what_[3] = "0.07";
  what_ = plus(what_, {"--corridor", "0.5", "--directions", "24"});
  succeed(map({"--tiles", "9"}));
  expectOnePiece();
}

TEST_F(TileBytes, Orientations) {
  what_[1] = "builtin:pruner";
  what_ = plus(what_, {"--orientations", "sphere:30"});
  succeed(map({"--tiles", "9"}));
  expectOnePiece();
}

/// A list is compared by its content, wherever it is read from.
TEST_F(TileBytes, AListOfOrientations) {
  what_[1] = "builtin:pruner";
  const auto write = [&](const char* text) { std::ofstream(path("list.txt")) << "yaw pitch roll\n" << text; };
  write("0 0 0\n90 45 10\n180 -30 0\n270 90 0\n");
  what_ = plus(what_, {"--orientations", "list:" + path("list.txt")});
  succeed(plan({"--tiles", "9"}));
  succeed(step("bin"));
  write("# the same\n0 0 0\n90 45 10\n180 -30 0\n270 90 0\n0 0 0\n");
  succeed(step("run"));
  expectOnePiece();
  write("0 0 0\n90 45 10\n180 -30 0\n270 80 0\n");
  const ProgramResult changed = runProgram(step("run"));
  EXPECT_EQ(changed.exit_code, 4) << changed.err;
  EXPECT_NE(changed.err.find("plan.changed"), std::string::npos) << changed.err;
}

TEST_F(TileBytes, TilesOneByOneInAnyOrder) {
  succeed(plan({"--tiles", "6.4"}));
  succeed(step("bin"));
  std::vector<std::string> names = tilesOf();
  ASSERT_GE(names.size(), 6u);
  std::shuffle(names.begin(), names.end(), std::mt19937(7));
  for (const std::string& name : names) succeed(step("run", {"--tile", name, "--threads", "1"}));
  EXPECT_TRUE(runProgram(step("list", {"--todo"})).out.empty());
  expectOnePiece();
  expectNoLeftovers();
}

TEST_F(TileBytes, ThreeProcessesAtOnceOnTheSameTiles) {
  succeed(plan({"--tiles", "6.4"}));
  succeed(step("bin"));
  std::vector<std::future<ProgramResult>> processes;
  for (int n = 0; n < 3; ++n) {
    processes.push_back(std::async(std::launch::async, [&] { return runProgram(step("run", {"--threads", "1"})); }));
  }
  for (auto& process : processes) {
    const ProgramResult result = process.get();
    EXPECT_EQ(result.exit_code, 0) << result.err;
  }
  expectOnePiece();
  expectNoLeftovers();
}

/// The plan's file is replaced by one that sorts fewer returns at a time than the program would.
TEST_F(TileBytes, OneShardPerScan) {
  succeed(plan({"--tiles", "6.4"}));
  tiles::Plan plan = tiles::readPlan(path("out"));
  plan.bin_bytes = 1;
  tiles::writePlan(path("out"), plan);
  succeed(step("bin"));
  EXPECT_EQ(listing("out/rays").size(), 6u);
  succeed(step("run"));
  expectOnePiece();
}

TEST_F(TileBytes, QuartersThatWereAskedFor) {
  succeed(plan({"--tiles", "12.8"}));
  succeed(step("bin"));
  const std::string name = tilesOf().front();
  succeed(step("run", {"--tile", name + ".2"}));
  const std::vector<std::string> names = tilesOf();
  for (const char* quarter : {".0", ".1", ".2", ".3"}) {
    EXPECT_TRUE(std::find(names.begin(), names.end(), name + quarter) != names.end()) << quarter;
  }
  succeed(step("run"));
  expectOnePiece();
  EXPECT_FALSE(std::filesystem::exists(path("out/tiles/" + name)));
}

TEST_F(TileBytes, QuartersBecauseMemoryIsShort) {
  writeWalk(folder_, {.rays = 20000});
  what_[1] = "builtin:pruner";
  succeed(plan({"--tiles", "12.8"}));
  succeed(step("bin"));
  const std::string name = tilesOf().front();
  bool split = false;
  for (int limit_mb = 200; !split && limit_mb > 120; limit_mb -= 10) {
    std::filesystem::remove_all(path("out/tiles"));
    (void)runProgram(step("run", {"--tile", name, "--max-memory", std::to_string(limit_mb) + "M"}));
    const std::vector<std::string> names = tilesOf();
    split = std::find(names.begin(), names.end(), name + ".3") != names.end();
  }
  EXPECT_TRUE(split);
  succeed(step("run"));
  expectOnePiece();
  expectNoLeftovers();
}

TEST_F(TileBytes, FilesAsTheFlagsSay) {
  what_ = plus(what_, {"--half", "--compression", "zip", "--up-axis", "y", "--points-format", "las"});
  succeed(map({"--tiles", "6.4"}));
  expectOnePiece();
  succeed(step("merge", {"--points", path("all.las")}));
  expectSameFiles("all.las", "one_piece/points.las");
}

TEST_F(TileBytes, RayCloudWithASensorPerReturn) {
  writeRayCloud(path("rays.ply"), {.rays = 20000});
  scans_ = {"--scans", path("rays.ply")};
  succeed(map({"--tiles", "6.4"}));
  expectOnePiece();
}

TEST_F(TileBytes, OneCloudSeenFromOnePlace) {
  writeCloud(path("cloud.ply"), {.rays = 60000, .max_range_m = 20});
  scans_ = {"--scans", path("cloud.ply"), "--sensor-at", kFirstSensor};
  succeed(map({"--tiles", "6.4"}));
  expectOnePiece();
}

TEST_F(TileBytes, GivenOriginAndThatOfAnEarlierMap) {
  what_ = plus(what_, {"--origin", "1.234,-5.6,0.7"});
  succeed(map({"--tiles", "6.4"}));
  expectOnePiece();
  what_.back() = path("out");
  succeed(map({"--tiles", "6.4"}, "again"));
  succeed(step("merge", {"--points", path("again.ply")}, "again"));
  expectSameFiles("again.ply", "one_piece/points.ply");
}

TEST_F(TileBytes, EveryThirdRecordedScan) {
  const auto scans = balmScans();
  if (!scans) GTEST_SKIP() << "no test data: scans_poses_balm";
  scans_ = {"--scans", *scans, "--poses", *scans + "/alidarPose.csv", "--every", "3"};
  what_[1] = "builtin:pruner";
  succeed(map({"--tiles", "12.8"}));
  expectOnePiece();
}

}  // namespace
}  // namespace accessvdb::large_test

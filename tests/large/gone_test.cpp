// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Maps in tiles with --change full: what has gone is what has gone in one piece, to the byte, whichever process maps
/// which tile, and whatever was killed, short of memory or damaged on the way. ACCESSVDB_GONE_WORLDS sets how many
/// random worlds are tried, ACCESSVDB_KILLS how many kills.
#include <signal.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <nlohmann/json.hpp>
#include <random>
#include <sstream>

#include "cli/rolling_world.h"
#include "large/tiled_test.h"
#include "property/rolling_walks.h"

namespace accessvdb::large_test {
namespace {

namespace fs = std::filesystem;

class TilesOfWhatGoes : public TiledTest {
 protected:
  /// A wall along y with boards before it, seen on the way there; when the sensor comes back, they have gone. Tiles are
  /// 6.4 m, and the sensor stands up to 20 m from y = 0: boards stand across borders.
  void SetUp() override {
    TiledTest::SetUp();
    fs::remove_all(path("scans"));
    cli_test::writeRollingWorld({.scans = 40, .returns_home = true, .boards_go = true}, folder_);
    what_ = {"--tool",   "builtin:pruner", "--voxel", "0.05",    "--range-noise", "0.01",     "--max-range",
             "8",        "--device",       "cpu",     "--width", "200",           "--height", "100",
             "--change", "full",           "--quiet"};
  }
  Flags tiled(const Flags& more = {}) const { return plus({"--tiles", "6.4"}, more); }

  void writeScan(int scan, const std::vector<Eigen::Vector3f>& points_S) const {
    char name[32];
    std::snprintf(name, sizeof name, "%06d.pcd", scan);
    const std::string count = std::to_string(points_S.size());
    std::ofstream file(folder_ / "scans" / name, std::ios::binary);
    file << "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH " << count
         << "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " << count << "\nDATA binary\n";
    for (const Eigen::Vector3f& p_S : points_S)
      file.write(reinterpret_cast<const char*>(p_S.data()), sizeof(float) * 3);
  }
  [[nodiscard]] std::uint64_t reasons(const std::string& report, const std::string& reason) const {
    return nlohmann::json::parse(readText(report)).at("counts").at("reasons").value(reason, std::uint64_t{0});
  }
  void expectSomethingHasGone(const std::string& out = "out") const {
    EXPECT_GT(reasons(out + "/report.json", "changed"), 100U);
    EXPECT_EQ(reasons(out + "/report.json", "changed"), reasons("one_piece/report.json", "changed"));
  }
  void expectNext(const std::string& name) const {
    const std::string status = runProgram(step("status")).out;
    EXPECT_NE(status.find("next: accessvdb tile " + name + "\n"), std::string::npos) << status;
  }
  [[nodiscard]] fs::path anyState() const {
    for (const auto& entry : fs::directory_iterator(path("out/rays")))
      if (entry.path().extension() == ".state") return entry.path();
    ADD_FAILURE() << "no state";
    return {};
  }
};

TEST_F(TilesOfWhatGoes, OneCommand) {
  succeed(map(tiled()));
  EXPECT_GE(tilesOf().size(), 4U);
  expectNoLeftovers();
  expectOnePiece();
  expectSomethingHasGone();
  // Nothing is done again.
  const auto written = fs::last_write_time(path("out/tiles/" + tilesOf().front() + "/points.ply"));
  succeed(map(tiled()));
  EXPECT_EQ(fs::last_write_time(path("out/tiles/" + tilesOf().front() + "/points.ply")), written);
  expectSomethingHasGone();
}

TEST_F(TilesOfWhatGoes, FreeSpaceThatAges) {
  what_ = plus(what_, {"--free-for", "6"});
  succeed(map(tiled()));
  expectOnePiece();
  expectSomethingHasGone();
}

TEST_F(TilesOfWhatGoes, SeveralToolsAndOrientations) {
  what_ = plus(what_, {"--tool", "builtin:pruner", "--orientations", "yaw", "--orientations", "sphere:30",
                       "--tool-name", "level", "--tool-name", "free"});
  succeed(map(tiled()));
  expectOnePiece();
  expectSomethingHasGone();
}

/// What returns carry goes to the points also through tiles that only their rays come near.
TEST_F(TilesOfWhatGoes, WhatReturnsCarry) {
  std::mt19937_64 random(5);
  for (int scan = 0; scan < 40; ++scan) {
    char name[32];
    std::snprintf(name, sizeof name, "scans/%06d.pcd", scan);
    const std::string whole = readText(name), before = "DATA binary\n";
    const std::size_t data = whole.find(before) + before.size(), count = (whole.size() - data) / 12;
    std::vector<float> xyz(3 * count);
    std::memcpy(xyz.data(), whole.data() + data, 12 * count);
    std::ostringstream text;
    text << "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z tree_id\nSIZE 4 4 4 4\nTYPE F F F I\nCOUNT 1 1 1 1\nWIDTH " << count
         << "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " << count << "\nDATA ascii\n"
         << std::setprecision(9);
    for (std::size_t n = 0; n < count; ++n)
      text << xyz[3 * n] << " " << xyz[3 * n + 1] << " " << xyz[3 * n + 2] << " " << random() % 5 << "\n";
    writeText(name, text.str());
  }
  what_ = plus(what_, {"--carry", "tree_id", "--index"});
  succeed(map(tiled()));
  expectOnePiece();
  expectSomethingHasGone();
  EXPECT_NE(readText("all.ply").substr(0, 2000).find("tree_id"), std::string::npos);
}

/// A tile after the other, each by a process of its own, and not in the order of the list.
TEST_F(TilesOfWhatGoes, StepByStep) {
  succeed(plan(tiled()));
  succeed(step("bin"));
  std::vector<std::string> tiles = tilesOf();
  ASSERT_GE(tiles.size(), 4U);
  std::ranges::reverse(tiles);
  refuse(step("run", {"--tile", tiles.front() + ".0"}), 2, "usage.tile");
  for (const std::string& tile : tiles) succeed(step("run", {"--tile", tile}));
  succeed(step("merge", {"--keep-rays"}));
  EXPECT_TRUE(fs::exists(path("out/rays/rolling.json")));
  expectOnePiece();
  expectSomethingHasGone();
  expectNoLeftovers();
  // A tile that is damaged afterwards is made again from the scans.
  flipByte("out/tiles/" + tiles.front() + "/points.ply", sizeOf("out/tiles/" + tiles.front() + "/points.ply") / 2);
  refuse(step("merge", {"--points", path("all.ply")}), 3, "output.changed");
  refuse(step("run", {"--tile", tiles.front()}), 3, "rays.missing");
  expectNext("bin");
  succeed(step("bin"));
  expectNext("run");
  succeed(step("run", {"--tile", tiles.front()}));
  expectOnePiece();
}

TEST_F(TilesOfWhatGoes, WithoutATileSize) {
  succeed(plan({}));
  succeed(step("bin"));
  succeed(step("run"));
  expectOnePiece();
}

TEST_F(TilesOfWhatGoes, AnotherFlight) {
  // The way back is a flight of its own.
  const fs::path back = folder_ / "back";
  fs::create_directories(back);
  std::ifstream all(path("poses.txt"));
  std::ofstream there_poses(path("there.txt")), back_poses(path("back.txt"));
  fs::create_directories(path("there"));
  int scan = 0;
  for (std::string line; std::getline(all, line); ++scan) {
    char name[32];
    std::snprintf(name, sizeof name, "%06d.pcd", scan);
    fs::copy_file(folder_ / "scans" / name, (scan < 20 ? folder_ / "there" : back) / name);
    (scan < 20 ? there_poses : back_poses) << line << "\n";
  }
  there_poses.close();
  back_poses.close();
  const Flags both = scans_;
  scans_ = {"--scans", path("there"), "--poses", path("there.txt")};
  succeed(plan(tiled()));
  succeed(step("bin"));
  succeed(step("run"));
  succeed(step("merge", {"--keep-rays"}));
  EXPECT_EQ(reasons("out/report.json", "changed"), 0U);
  succeed({"tile", "plan", path("out"), "--append", "--scans", back.string(), "--poses", path("back.txt")});
  const std::string before = readText("out/rays/rolling.json");
  succeed(step("bin"));
  EXPECT_NE(readText("out/rays/rolling.json"), before);
  succeed(step("run"));
  scans_ = both;
  expectOnePiece();
  expectSomethingHasGone();
}

/// Tiles leave memory and come back; where not even those that one scan's rays come near fit, nothing is left out.
TEST_F(TilesOfWhatGoes, LittleMemory) {
  const std::string refused = refuse(map(tiled({"--max-memory", "1M"})), 5, "limit.memory");
  EXPECT_NE(refused.find("--max-memory "), std::string::npos) << refused;
  std::string least;
  for (int megabytes = 16; megabytes <= 2048 && least.empty(); megabytes += megabytes / 4) {
    const ProgramResult run =
        runProgram(plus(map(tiled()), {"--keep-rays", "--max-memory", std::to_string(megabytes) + "M"}));
    ASSERT_TRUE(run.exit_code == 0 || run.exit_code == 5) << run.err;
    EXPECT_EQ(run.err.find("error[limit.memory]") != std::string::npos, run.exit_code == 5) << run.err;
    if (run.exit_code == 0) least = std::to_string(megabytes) + "M";
  }
  std::cout << "least --max-memory " << least << "\n";
  // Each file has a number of its own: tiles were saved before the end.
  std::size_t states = 0;
  std::uint64_t highest = 0;
  for (const auto& entry : fs::directory_iterator(path("out/rays"))) {
    const std::string name = entry.path().stem().string();
    if (entry.path().extension() != ".state") continue;
    ++states;
    highest = std::max<std::uint64_t>(highest, std::stoull(name.substr(name.find('.') + 1)));
  }
  EXPECT_GT(highest, states);
  expectOnePiece();
  expectSomethingHasGone();
}

TEST_F(TilesOfWhatGoes, GoOnAfterASignal) {
  cli_test::ProgramSetup stopped;
  stopped.arguments = map(tiled());
  std::erase(stopped.arguments, "--quiet");
  stopped.signal_after = "with a margin";
  stopped.act = [](pid_t process) { kill(process, SIGTERM); };
  const ProgramResult result = runProgram(stopped);
  EXPECT_EQ(result.exit_code, 128 + SIGTERM) << result.err;
  EXPECT_NE(result.err.find("goes on from here"), std::string::npos) << result.err;
  // Other parameters are not mixed in, by whatever command.
  const Flags full = what_;
  std::ranges::replace(what_, "full", "block");
  const std::string line = refuse(map(tiled()), 4, "plan.changed");
  EXPECT_NE(line.find("change"), std::string::npos) << line;
  what_ = full;
  refuse(step("run"), 3, "rays.missing");
  succeed(map(tiled()));
  expectNoLeftovers();
  expectOnePiece();
  expectSomethingHasGone();
}

TEST_F(TilesOfWhatGoes, KillsAtAnyTime) {
  const int kills = countFrom("ACCESSVDB_KILLS", 4), seed = countFrom("ACCESSVDB_SEED", 1);
  std::mt19937_64 random(static_cast<std::uint64_t>(seed));
  const double seconds = runToItsEnd(map(tiled())).seconds;
  int hits = 0;
  for (int n = 0; n < kills && !HasFailure(); ++n) {
    SCOPED_TRACE("kill " + std::to_string(n) + " of seed " + std::to_string(seed));
    fs::remove_all(path("out"));
    for (int more = 0; more < 2; ++more)  // also while it goes on
      hits +=
          runToItsEnd(map(tiled()), std::uniform_real_distribution<double>(0, 0.9)(random) * seconds).killed ? 1 : 0;
    succeed(map(tiled()));
    expectNoLeftovers();
    expectOnePiece();
  }
  std::cout << hits << " of " << 2 * kills << " killed a running process\n";
  EXPECT_GE(hits, kills);
}

TEST_F(TilesOfWhatGoes, OfBlockAreAnotherPlan) {
  Flags block = what_;
  std::ranges::replace(block, "full", "block");
  std::swap(block, what_);
  succeed(map(tiled()));
  std::swap(block, what_);
  const std::string before = readText("out/field.json");
  refuse(map(tiled()), 4, "plan.changed");
  EXPECT_EQ(readText("out/field.json"), before);
  succeed(map(tiled({"--fresh"})));
  expectOnePiece();
}

TEST_F(TilesOfWhatGoes, DamageIsNamed) {
  succeed(plan(tiled()));
  succeed(step("bin"));
  const fs::path state = anyState();
  const std::string tile = state.filename().string().substr(0, state.filename().string().find('.'));
  const std::string name = "out/rays/" + state.filename().string();
  for (const std::string& file : {name, name.substr(0, name.size() - 5) + "ids"}) {
    SCOPED_TRACE(file);
    const std::string whole = readText(file);
    for (const std::uint64_t place : {std::uint64_t{3}, sizeOf(file) / 2, sizeOf(file) - 3}) {
      flipByte(file, place);
      const std::string line = refuse(step("run", {"--tile", tile}), 3, "rays.damaged");
      EXPECT_NE(line.find(fs::path(file).filename().string()), std::string::npos) << line;
      EXPECT_FALSE(fs::exists(path("out/tiles/" + tile)));
      std::ofstream(folder_ / file, std::ios::binary) << whole;
    }
    fs::remove(folder_ / file);
    refuse(step("run", {"--tile", tile}), 3, "rays.damaged");
    std::ofstream(folder_ / file, std::ios::binary) << whole;
  }
  for (const std::string& text : {std::string("{}"), std::string("no"), std::string()}) {
    const std::string whole = readText("out/rays/rolling.json");
    writeText("out/rays/rolling.json", text);
    refuse(step("run"), 3, "rays.damaged");
    writeText("out/rays/rolling.json", whole);
  }
  // As the line advises.
  flipByte(name, sizeOf(name) / 2);
  fs::remove(folder_ / name);
  succeed(step("bin"));
  succeed(step("run"));
  expectOnePiece();
  expectNoLeftovers();
}

TEST_F(TilesOfWhatGoes, FilesOfOthersStay) {
  succeed(plan(tiled()));
  succeed(step("bin"));
  writeText("out/rays/thesis.txt", "not ours");
  for (const Flags& each : {step("bin"), map(tiled({"--fresh"}))}) {
    EXPECT_NE(refuse(each, 7, "output.foreign").find("thesis.txt"), std::string::npos);
  }
  succeed(step("run"));
  succeed(step("merge"));
  EXPECT_EQ(readText("out/rays/thesis.txt"), "not ours");
  EXPECT_FALSE(fs::exists(path("out/rays/rolling.json")));
}

TEST_F(TilesOfWhatGoes, ScansThatChangedAreRefused) {
  succeed(plan(tiled()));
  succeed(step("bin"));
  fs::remove_all(path("out/rays"));
  expectNext("bin");
  const std::string whole = readText("scans/000007.pcd"), other = readText("scans/000008.pcd");
  writeText("scans/000007.pcd", other);
  refuse(step("bin"), 4, "plan.changed");
  writeText("scans/000007.pcd", whole + "x");
  refuse(step("bin"), 4, "plan.changed");
  expectNext("bin");
  writeText("scans/000007.pcd", whole);
  succeed(step("bin"));
  expectNext("run");
  succeed(step("run"));
  expectOnePiece();
}

TEST_F(TilesOfWhatGoes, NeedTimesWhereFreeSpaceAges) {
  std::ifstream poses(path("poses.txt"));
  std::ofstream kitti(path("kitti.txt"));
  double stamp = 0, x = 0, y = 0, z = 0;
  for (std::string rest; poses >> stamp >> x >> y >> z && std::getline(poses, rest);)
    kitti << "1 0 0 " << x << " 0 1 0 " << y << " 0 0 1 " << z << "\n";
  kitti.close();
  scans_ = {"--scans", path("scans"), "--poses", path("kitti.txt"), "--pose-format", "kitti"};
  for (const Flags& each : {plan(tiled({"--free-for", "6"})), map(tiled({"--free-for", "6"}))})
    refuse(each, 4, "stamp.missing");
}

/// A wall on one side of the border, and a board in its tool's way, 0.8 m beyond it, that goes: the wall's tile has to
/// be told what opens there.
TEST_F(TilesOfWhatGoes, BeyondABorder) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> along(-2, 2), up(-1.2, 1.2);
  fs::remove_all(path("scans"));
  fs::create_directories(path("scans"));
  std::ofstream poses(path("poses.txt"));
  constexpr double kWall_m = 6.2, kBoard_m = 7.2, kSensor_m = 10;  // the border is at 6.4
  for (int scan = 0; scan < 40; ++scan) {
    const double sensor_x = 0.15 * (scan % 20) - 1.5;
    std::vector<Eigen::Vector3f> points_S;
    for (int n = 0; n < 4000; ++n) {
      const Eigen::Vector3d way(along(random) - sensor_x, kWall_m - kSensor_m, up(random));
      const double at_board = (kBoard_m - kSensor_m) / way.y(), x = sensor_x + at_board * way.x();
      const bool stops = scan < 20 && std::abs(x) < 0.3 && std::abs(at_board * way.z()) < 0.3;
      points_S.push_back(((stops ? at_board : 1.0) * way).cast<float>());
    }
    writeScan(scan, points_S);
    poses << scan << " " << sensor_x << " " << kSensor_m << " 0 0 0 0 1\n";
  }
  poses.close();
  what_ = plus(what_, {"--origin", "0,0,0", "--directions", "36"});
  succeed(map(tiled()));
  expectOnePiece();
  expectSomethingHasGone();
}

/// Worlds at random: boards that go, while they are seen or between two visits, and others that come.
TEST_F(TilesOfWhatGoes, RandomWorlds) {
  for (int world = 1; world <= countFrom("ACCESSVDB_GONE_WORLDS", 2) && !HasFailure(); ++world) {
    SCOPED_TRACE("world " + std::to_string(world));
    for (const char* old : {"scans", "out", "one"}) fs::remove_all(path(old));
    fs::create_directories(path("scans"));
    std::ofstream poses(path("poses.txt"));
    int scan = 0;
    for (const test::Step& each :
         test::walkPastWhatGoes({.name = "gone", .seed = static_cast<std::uint64_t>(world)}, 50)) {
      const Eigen::Vector3d sensor_W = each.sensors_W.front();
      std::vector<Eigen::Vector3f> points_S;
      for (const Eigen::Vector3d& p_W : each.points_W) points_S.push_back((p_W - sensor_W).cast<float>());
      writeScan(scan, points_S);
      poses << scan++ << " " << std::setprecision(17) << sensor_W.x() << " " << sensor_W.y() << " " << sensor_W.z()
            << " 0 0 0 1\n";
    }
    poses.close();
    std::ranges::replace(what_, "8", "11");  // --max-range
    const Flags more = world % 2 == 0 ? Flags{"--free-for", "9"} : Flags();
    succeed(map(plus({"--tiles", "off"}, more), "one"));
    EXPECT_GT(reasons("one/report.json", "changed"), 20U);
    succeed(plan(tiled(more)));
    succeed(step("bin", world % 2 == 0 ? Flags{} : Flags{"--threads", "1"}));
    std::vector<std::string> tiles = tilesOf();
    std::shuffle(tiles.begin(), tiles.end(), std::mt19937_64(static_cast<std::uint64_t>(world)));
    EXPECT_GE(tiles.size(), 6U);
    for (const std::string& tile : tiles) succeed(step("run", {"--tile", tile}));
    succeed(step("merge", {"--points", path("all.ply"), "--vdb", path("all.vdb")}));
    expectSameFiles("all.ply", "one/points.ply");
    expectSameFiles("all.vdb", "one/field.vdb");
  }
}

}  // namespace
}  // namespace accessvdb::large_test

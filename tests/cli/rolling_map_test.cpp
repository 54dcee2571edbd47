// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// map --rolling: the merged result has the bytes of one piece, whatever left memory and whenever the run was stopped.
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <random>

#include "accessvdb/field_io.h"
#include "accessvdb/scan_io.h"
#include "cli/checkpoint_world.h"
#include "cli/file_snapshot.h"
#include "cli/program_run.h"
#include "cli/rolling_world.h"

namespace accessvdb::cli_test {
namespace {

namespace fs = std::filesystem;

class RollingMap : public ProgramTest {
 protected:
  [[nodiscard]] std::vector<std::string> arguments(std::vector<std::string> more) const {
    more.insert(more.begin(), {"--threads", "2", "--width", "160", "--height", "120"});
    std::vector<std::string> all = mapOfRollingWorld(folder_, more);
    // What a test says itself comes last and stands.
    for (const std::string flag : {"--scans", "--poses"}) {
      const auto first = std::ranges::find(all, flag);
      if (std::ranges::count(all, flag) > 1) all.erase(first, first + 2);
    }
    if (const auto none = std::ranges::find(all, std::string()); none != all.end()) all.erase(none - 1, none + 1);
    return all;
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
  // A tile is made again after all have gone through the scans once more.
  const std::string tile = fs::directory_iterator(folder_ / "out/tiles")->path().filename().string();
  fs::remove_all(folder_ / "out/tiles" / tile);
  for (const std::vector<std::string>& again :
       {std::vector<std::string>{"tile", "bin", path("out")}, {"tile", "run", "--tile", tile, path("out")}}) {
    const ProgramResult made = runProgram(again);
    EXPECT_EQ(made.exit_code, 0) << made.err;
  }
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
  // Stopped once more, while it reads what it has already.
  setup.arguments = rolling({"--out", path("out"), "--resume", path("roll")});
  setup.signal_after = "tiles of ";
  const ProgramResult twice = runProgram(setup);
  EXPECT_EQ(twice.exit_code, 128 + SIGTERM) << twice.err;
  const ProgramResult resumed = runProgram(rolling({"--out", path("out"), "--resume", path("roll")}));
  ASSERT_EQ(resumed.exit_code, 0) << resumed.err;
  EXPECT_NE(resumed.err.find("going on after "), std::string::npos) << resumed.err;
  EXPECT_NE(readText("out/report.json").find("\"points_in\": 160000"), std::string::npos);
  expectOnePiece("out");
}

/// A flight that goes on: the same scans first, and then more, with their poses in the same file.
TEST_F(RollingMap, TakesOnScansThatFollow) {
  writeRollingWorld({.scans = 40, .returns_home = true}, folder_);
  const std::string poses = readText("poses.txt");
  std::size_t end = 0;
  for (int line = 0; line < 25; ++line) end = poses.find('\n', end) + 1;
  fs::create_directories(folder_ / "later");
  const auto move = [&](const char* from, const char* to) {
    for (int scan = 25; scan < 40; ++scan) {
      const std::string name = "0000" + std::to_string(scan) + ".pcd";
      fs::rename(folder_ / from / name, folder_ / to / name);
    }
  };
  move("scans", "later");
  writeText("poses.txt", poses.substr(0, end));
  ASSERT_EQ(runProgram(rolling({"--out", path("first")})).exit_code, 0);

  move("later", "scans");
  const auto resumed = [&](const std::string& out) {
    return runProgram(rolling({"--out", path(out), "--resume", path("roll")}));
  };
  std::string moved = poses;
  moved.replace(moved.find("\n3 0 ") + 5, 1, "9");
  writeText("poses.txt", moved);
  const ProgramResult refused = resumed("out");
  EXPECT_EQ(refused.exit_code, 4) << refused.err;
  EXPECT_NE(refused.err.find("its 25 scans have other poses or times now"), std::string::npos) << refused.err;
  writeText("poses.txt", poses);
  const ProgramResult replaces = resumed("first");
  EXPECT_EQ(replaces.exit_code, 7) << replaces.err;
  const ProgramResult run = resumed("out");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NE(run.err.find("going on after 25 of 40 scans"), std::string::npos) << run.err;
  EXPECT_NE(readText("out/report.json").find("\"points_in\": 160000"), std::string::npos);
  EXPECT_NE(readText("out/report.json").find("\"resumed_after_scans\": 25"), std::string::npos);

  // What a blocked point came closest with depends on when it was looked at.
  ASSERT_EQ(runProgram(arguments({"--tiles", "off", "--out", path("one")})).exit_code, 0);
  ASSERT_EQ(runProgram({"tile", "merge", path("out"), "--points", path("all.ply")}).exit_code, 0);
  const FieldSnapshot one = io::readPointsPly(path("one/points.ply")), all = io::readPointsPly(path("all.ply"));
  ASSERT_EQ(all.points.size(), one.points.size());
  for (std::size_t n = 0; n < all.points.size(); ++n) {
    const SurfacePoint &a = all.points[n], &b = one.points[n];
    ASSERT_TRUE(a.position_W == b.position_W && a.label == b.label) << n;
    if (a.label != PointLabel::Accessible) continue;
    ASSERT_TRUE(a.score == b.score && a.direction == b.direction) << n;
  }
  EXPECT_GT(all.count(PointLabel::Accessible), 100U);
  // Without the last ones they are other scans.
  writeText("poses.txt", poses.substr(0, end));
  move("scans", "later");
  EXPECT_EQ(resumed("out2").exit_code, 4);
}

/// Where each run has scans and poses of its own, an earlier result can be repaired after the flight went on.
TEST_F(RollingMap, AnEarlierResultIsRepairedFromFilesOfItsOwn) {
  writeRollingWorld({.scans = 12, .step_m = 4}, folder_);
  const std::string poses = readText("poses.txt");
  std::size_t end = 0;
  for (int line = 0; line < 8; ++line) end = poses.find('\n', end) + 1;
  writeText("first.txt", poses.substr(0, end));
  fs::create_directories(folder_ / "first_scans");
  for (int scan = 0; scan < 8; ++scan) {
    const std::string name = "00000" + std::to_string(scan) + ".pcd";
    fs::create_hard_link(folder_ / "scans" / name, folder_ / "first_scans" / name);
  }
  const std::vector<std::string> of_first = {"--scans", path("first_scans"), "--poses", path("first.txt")};
  std::vector<std::string> more = of_first;
  more.insert(more.end(), {"--out", path("first")});
  ASSERT_EQ(runProgram(rolling(more)).exit_code, 0);
  const ProgramResult later = runProgram(rolling({"--out", path("out"), "--resume", path("roll")}));
  ASSERT_EQ(later.exit_code, 0) << later.err;
  const std::string tile = fs::directory_iterator(folder_ / "first/tiles")->path().filename().string();
  fs::remove_all(folder_ / "first/tiles" / tile);
  for (const std::vector<std::string>& again :
       {std::vector<std::string>{"tile", "bin", path("first")}, {"tile", "run", "--tile", tile, path("first")}}) {
    const ProgramResult made = runProgram(again);
    EXPECT_EQ(made.exit_code, 0) << made.err;
  }
  expectOnePiece("first", of_first);
}

/// A flight in one file, which grows: what counts is what it begins with.
TEST_F(RollingMap, TakesOnWhatFollowsInTheSameFile) {
  constexpr int kOfAStep = 20'000;
  const auto write = [&](int steps, float shift_m) {
    std::mt19937_64 random(3);
    std::uniform_real_distribution<float> along(-5, 5), up(-1.5, 1.5);
    const std::string count = std::to_string(steps * kOfAStep);
    std::ofstream file(folder_ / "flight.pcd", std::ios::binary);
    file << "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH " << count
         << "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " << count << "\nDATA binary\n";
    for (int n = 0; n < steps * kOfAStep; ++n) {
      const float y = along(random), z = up(random);
      const std::array<float, 3> p = {3 + 0.05F * std::sin(7 * y + 5 * z) + shift_m, y, z};
      file.write(reinterpret_cast<const char*>(p.data()), sizeof p);
    }
  };
  const auto map = [&](const std::string& out, std::vector<std::string> more) {
    more.insert(more.end(), {"--scans", path("flight.pcd"), "--poses", "", "--sensor-at", "0,0,0",
                             "--allow-disagreement", "--out", path(out)});
    return runProgram(arguments(more));
  };
  write(2, 0);
  const ProgramResult first = map("first", {"--rolling", path("roll")});
  ASSERT_EQ(first.exit_code, 0) << first.err;
  write(3, 0.01F);
  const ProgramResult other = map("out", {"--rolling", path("roll"), "--resume", path("roll")});
  EXPECT_EQ(other.exit_code, 4) << other.err;
  EXPECT_NE(other.err.find("state.scans"), std::string::npos) << other.err;
  write(3, 0);
  const ProgramResult more = map("out", {"--rolling", path("roll"), "--resume", path("roll")});
  ASSERT_EQ(more.exit_code, 0) << more.err;
  EXPECT_NE(more.err.find("going on after 2 of 3 scans"), std::string::npos) << more.err;
  ASSERT_EQ(map("one", {"--tiles", "off"}).exit_code, 0);
  ASSERT_EQ(runProgram({"tile", "merge", path("out"), "--points", path("all.ply")}).exit_code, 0);
  const FieldSnapshot one = io::readPointsPly(path("one/points.ply")), all = io::readPointsPly(path("all.ply"));
  ASSERT_EQ(all.points.size(), one.points.size());
  EXPECT_EQ(all.count(PointLabel::Accessible), one.count(PointLabel::Accessible));
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
  expect(resumed({"--level", "2,0"}), 4, "level was \"\" and is now \"2,0\"");
  const std::string scan = contentOf(folder_ / "scans/000002.pcd");
  std::ofstream(folder_ / "scans/000002.pcd", std::ios::binary) << contentOf(folder_ / "scans/000001.pcd");
  expect(resumed({}), 4, "state.scans");
  std::ofstream(folder_ / "scans/000002.pcd", std::ios::binary) << scan;
  // A note that is not whole, of whatever program.
  const std::string manifest = readText("roll/rolling.json");
  nlohmann::ordered_json json = nlohmann::ordered_json::parse(manifest);
  nlohmann::ordered_json note = nlohmann::ordered_json::parse(json["note"].get<std::string>());
  note.erase("taken_sha256");
  json["note"] = note.dump();
  json.erase("sha256");
  writeText("hashed.json", json.dump());
  json["sha256"] = io::sha256OfFile(path("hashed.json"));
  writeText("roll/rolling.json", json.dump(2));
  expect(resumed({}), 4, "was not made by map");
  writeText("roll/rolling.json", manifest);
  const ProgramResult unchanged = resumed({});
  EXPECT_EQ(unchanged.exit_code, 0) << unchanged.err;
  EXPECT_TRUE(contentOf(folder_ / "out/field.json") == contentOf(folder_ / "out2/field.json"));
}

/// What another run is about to replace is not read.
TEST_F(RollingMap, WaitsForTheFolderBeforeItReads) {
  writeRollingWorld({.scans = 2}, folder_);
  fs::create_directories(folder_ / "roll");
  writeText("roll/rolling.json", "[]");
  const std::vector<std::string> resumed = rolling({"--out", path("out"), "--resume", path("roll")});
  {
    const FolderOfAnother another(folder_ / "roll");
    const ProgramResult locked = runProgram(resumed);
    EXPECT_EQ(locked.exit_code, 7) << locked.err;
    EXPECT_NE(locked.err.find("output.locked"), std::string::npos) << locked.err;
  }
  const ProgramResult damaged = runProgram(resumed);
  EXPECT_EQ(damaged.exit_code, 3) << damaged.err;
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
  const std::vector<std::vector<std::string>> contradictions = {{"--policy", "paper"},
                                                                {"--tiles", "12.8"},
                                                                {"--surface"},
                                                                {"--sequence", "1"},
                                                                {"--remove", "box:0,0,0,1,1,1"},
                                                                {"--resume", path("else")},
                                                                {"--fresh", "--resume", path("roll")},
                                                                {"--checkpoint", path("cp")},
                                                                {"--keep-rays"},
                                                                {"--bin-memory", "64M"},
                                                                {"--mirror-distance"},
                                                                {"--removed-as", "free"}};
  for (const std::vector<std::string>& more : contradictions) {
    std::vector<std::string> all = more;
    all.insert(all.end(), {"--out", path("out")});
    const ProgramResult refused = runProgram(rolling(all));
    EXPECT_EQ(refused.exit_code, 2) << more.front() << refused.err;
    EXPECT_NE(refused.err.find("usage.rolling"), std::string::npos) << more.front() << refused.err;
  }
  EXPECT_FALSE(fs::exists(folder_ / "roll"));
  // However they are written, and whether they are there or not.
  for (const std::string out : {"roll", "roll/", "roll/../roll", "roll/sub", "."}) {
    const ProgramResult refused = runProgram(rolling({"--out", path(out)}));
    EXPECT_EQ(refused.exit_code, 2) << out << refused.err;
    EXPECT_FALSE(fs::exists(folder_ / "roll")) << out;
  }
  ASSERT_EQ(runProgram(rolling({"--out", path("out"), "--resume", path("roll/")})).exit_code, 0);
  // What the result would replace, and what it was made from.
  const ProgramResult kept = runProgram(rolling({"--out", path("out"), "--resume", path("roll"), "--no-clobber"}));
  EXPECT_EQ(kept.exit_code, 7) << kept.err;
  const std::string plan = readText("out/plan.json");
  EXPECT_EQ(runProgram(rolling({"--out", path("out"), "--fresh"})).exit_code, 7);
  EXPECT_EQ(runProgram(rolling({"--out", path("out"), "--fresh", "--resume", path("roll")})).exit_code, 2);
  EXPECT_EQ(readText("out/plan.json"), plan) << "nothing is deleted for a run that is refused";
  for (const char* flag : {"--resume", "--checkpoint"}) {
    const ProgramResult other = runProgram(arguments({"--out", path("one"), flag, path("roll")}));
    EXPECT_EQ(other.exit_code, 4) << other.err;
    EXPECT_NE(other.err.find("--rolling"), std::string::npos) << other.err;
  }
}

/// The cure that is printed for a damaged tile makes it again from the scans, and never an empty one.
TEST_F(RollingMap, ATileOfTheResultIsMadeAgainFromTheScans) {
  writeRollingWorld({.scans = 8, .step_m = 4}, folder_);
  ASSERT_EQ(runProgram(rolling({"--out", path("out")})).exit_code, 0);
  std::string tile;
  for (const auto& entry : fs::directory_iterator(folder_ / "out/tiles"))
    if (fs::is_directory(entry)) tile = entry.path().filename().string();
  for (const bool damaged : {true, false}) {
    const fs::path points = folder_ / "out/tiles" / tile / "points.ply";
    std::string bytes = contentOf(points);
    bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 1);
    std::ofstream(points, std::ios::binary) << bytes;
    if (!damaged) fs::remove_all(points.parent_path());
    EXPECT_NE(runProgram({"tile", "merge", path("out"), "--points", path("bad.ply")}).exit_code, 0);
    const std::vector<std::string> again = {"tile", "run", "--tile", tile, path("out")};
    const ProgramResult without = runProgram(again);
    EXPECT_EQ(without.exit_code, 3) << without.err;
    EXPECT_NE(without.err.find("rays.missing"), std::string::npos) << without.err;
    const ProgramResult binned = runProgram({"tile", "bin", path("out")});
    ASSERT_EQ(binned.exit_code, 0) << binned.err;
    const ProgramResult made = runProgram(again);
    ASSERT_EQ(made.exit_code, 0) << made.err;
    expectOnePiece("out");
  }
}

/// A run that was killed while it wrote, and then scans that were corrected: none of the old tiles is in the result.
TEST_F(RollingMap, TilesOfARunThatWasCutOffAreNotTaken) {
  writeRollingWorld({.scans = 8, .step_m = 4}, folder_);
  ASSERT_EQ(runProgram(rolling({"--out", path("out")})).exit_code, 0);
  const std::string before = contentOf(folder_ / "out/field.json");
  fs::remove(folder_ / "out/plan.json");  // it comes last
  fs::remove_all(folder_ / "roll");
  const std::string other = contentOf(folder_ / "scans/000005.pcd");
  std::ofstream(folder_ / "scans/000003.pcd", std::ios::binary) << other;
  const ProgramResult run = runProgram(rolling({"--out", path("out")}));
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NE(contentOf(folder_ / "out/field.json"), before);
  expectOnePiece("out");
  // The same command repairs what was damaged since.
  for (const auto& entry : fs::recursive_directory_iterator(folder_ / "out/tiles"))
    if (entry.path().filename() == "points.ply") std::ofstream(entry.path(), std::ios::binary) << "ply";
  const ProgramResult repaired = runProgram(rolling({"--out", path("out"), "--resume", path("roll")}));
  ASSERT_EQ(repaired.exit_code, 0) << repaired.err;
  expectOnePiece("out");
}

/// Neither a disk that is full nor a state that is damaged since costs a result that is there.
TEST_F(RollingMap, TheSameCommandLeavesAGoodResult) {
  writeRollingWorld({.scans = 8, .step_m = 4}, folder_);
  ASSERT_EQ(runProgram(rolling({"--out", path("out")})).exit_code, 0);
  const auto result = [&] {
    std::map<std::string, std::string> files = snapshotOf(folder_ / "out/tiles");
    for (const char* name : {"out/plan.json", "out/rays.json", "out/field.json"}) files[name] = readText(name);
    return files;
  };
  const std::map<std::string, std::string> good = result();
  const std::vector<std::string> again = rolling({"--out", path("out"), "--resume", path("roll")});
  ASSERT_EQ(runProgram(again).exit_code, 0);
  EXPECT_EQ(result(), good) << "repeated";
  ProgramSetup full;
  full.arguments = again;
  full.file_size_limit = 20'000;
  EXPECT_NE(runProgram(full).exit_code, 0);
  EXPECT_EQ(result(), good) << "a full disk";

  std::vector<fs::path> states;
  for (const auto& entry : fs::directory_iterator(folder_ / "roll"))
    if (entry.path().extension() == ".state") states.push_back(entry.path());
  std::sort(states.begin(), states.end());
  ASSERT_GT(states.size(), 1U);
  std::string bad = contentOf(states.front());
  bad[bad.size() / 2] = static_cast<char>(bad[bad.size() / 2] ^ 1);
  std::ofstream(states.front(), std::ios::binary) << bad;
  const ProgramResult lost = runProgram(again);
  EXPECT_EQ(lost.exit_code, 3) << lost.err;
  EXPECT_NE(lost.err.find("rolling.damaged"), std::string::npos) << lost.err;
  EXPECT_EQ(result(), good) << "a damaged state";
}

TEST_F(RollingMap, AnotherOriginIsRefusedAndDamageIsSaid) {
  writeRollingWorld({.scans = 8, .step_m = 4}, folder_);
  ASSERT_EQ(runProgram(rolling({"--out", path("out")})).exit_code, 0);
  const ProgramResult moved =
      runProgram(rolling({"--out", path("out2"), "--resume", path("roll"), "--origin", "1,0,0"}));
  EXPECT_EQ(moved.exit_code, 4) << moved.err;
  EXPECT_NE(moved.err.find("rolling.changed"), std::string::npos) << moved.err;
  ASSERT_EQ(runProgram(rolling({"--out", path("out"), "--resume", path("roll")})).exit_code, 0);
  expectOnePiece("out");

  std::vector<fs::path> states;
  for (const auto& entry : fs::directory_iterator(folder_ / "roll"))
    if (entry.path().extension() == ".state") states.push_back(entry.path());
  ASSERT_GT(states.size(), 1U);
  std::sort(states.begin(), states.end());
  const std::string good = contentOf(states.front());
  fs::remove(states.front());
  const ProgramResult missing = runProgram(rolling({"--out", path("out2"), "--resume", path("roll")}));
  EXPECT_EQ(missing.exit_code, 3) << missing.err;
  EXPECT_NE(missing.err.find("rolling.damaged"), std::string::npos) << missing.err;
  std::string bad = good;
  bad[bad.size() / 2] = static_cast<char>(bad[bad.size() / 2] ^ 1);
  std::ofstream(states.front(), std::ios::binary) << bad;
  const ProgramResult damaged = runProgram(rolling({"--out", path("out2"), "--resume", path("roll")}));
  EXPECT_EQ(damaged.exit_code, 0) << damaged.err;
  EXPECT_NE(damaged.err.find("warning[rolling.lost]"), std::string::npos) << damaged.err;
  EXPECT_NE(readText("out2/report.json").find("rolling.lost"), std::string::npos);
}

}  // namespace
}  // namespace accessvdb::cli_test

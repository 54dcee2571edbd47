// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// No command deletes or overwrites a file that it reads or that it did not write; it says so in one line, at once, and
/// leaves everything as it was.
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>

#include "file_snapshot.h"
#include "program_run.h"

namespace accessvdb::cli_test {
namespace {

namespace fs = std::filesystem;
using Flags = std::vector<std::string>;

class KeptFiles : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    writeWallScans(3, 12);
    writePoses(3);
    writeBoxTool(0.9, 0.1);
  }

  [[nodiscard]] Flags tool() const { return {"--tool", path("tool.obj"), "--tool-unit", "m"}; }
  [[nodiscard]] Flags map(const Flags& more = {}) const {
    Flags flags = tool();
    flags.insert(flags.end(), {"--width", "64", "--height", "48", "--device", "cpu"});
    flags.insert(flags.end(), more.begin(), more.end());
    return mapArguments(flags);
  }
  /// tile plan; the other steps need only the folder.
  [[nodiscard]] Flags plan(const Flags& more = {}) const {
    Flags flags = {"tile", "plan", path("out")};
    const Flags as_map = map(more);
    for (std::size_t n = 1; n < as_map.size(); ++n) {
      if (as_map[n] == "--out") {
        ++n;
      } else if (as_map[n] != "--width" && as_map[n] != "--height") {
        flags.push_back(as_map[n]);
      } else {
        ++n;
      }
    }
    return flags;
  }
  [[nodiscard]] static ProgramResult run(const Flags& arguments) {
    const std::string& verb = arguments.front();
    return verb == "simulate" || verb == "evaluate" || verb == "bench" ? runLab(arguments) : runProgram(arguments);
  }
  void succeed(const Flags& arguments) const {
    const ProgramResult result = run(arguments);
    ASSERT_EQ(result.exit_code, 0) << result.err;
  }
  /// Fails with this code and id in one line, quickly, and nothing is written, changed or deleted.
  void expectRefused(const Flags& arguments, int code, const std::string& id) const {
    std::string command;
    for (const std::string& argument : arguments) command += argument + " ";
    SCOPED_TRACE(command);
    const auto before = snapshotOf(folder_);
    const ProgramResult result = run(arguments);
    EXPECT_EQ(result.exit_code, code) << result.err;
    EXPECT_NE(result.err.find("error[" + id + "]"), std::string::npos) << result.err;
    EXPECT_EQ(result.err.find("error["), result.err.rfind("error[")) << result.err;
    EXPECT_TRUE(snapshotOf(folder_) == before) << "something has changed";
  }
  void expectInput(const Flags& arguments) const { expectRefused(arguments, 2, "output.is_input"); }
  [[nodiscard]] std::string firstTile() const { return "out/tiles/" + listing("out/tiles").front(); }
};

TEST_F(KeptFiles, TheOnlyCloudIsNotReplacedByItsMap) {
  writeText(
      "s/points.ply",
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
      "2 0 0\n2 0.1 0\n2 0 0.1\n");
  const auto with = [&](const std::string& scans, const std::string& out) {
    return map({"--scans", scans, "--poses", "", "--sensor-at", "0,0,0", "--out", out});
  };
  expectInput(with(path("s/points.ply"), path("s")));
  expectInput(map({"--scans", path("s/points.ply"), "--poses", "", "--sensor-at", "0,0,0", "--out", path("s"),
                   "--device", "cuda"}));  // also where there is no GPU
  expectInput(with(path("s"), path("s")));
  expectInput(with(path("s/points.ply"), path("scans/../s/.")));
  // The same file by other names.
  fs::create_directories(path("linked"));
  fs::create_symlink(path("s/points.ply"), path("linked/points.ply"));
  expectInput(with(path("s/points.ply"), path("linked")));
  fs::create_directories(path("hard"));
  fs::create_hard_link(path("s/points.ply"), path("hard/points.ply"));
  expectInput(with(path("s/points.ply"), path("hard")));
  fs::create_directory_symlink(path("s"), path("folder"));
  expectInput(with(path("s/points.ply"), path("folder")));
  succeed(with(path("s/points.ply"), path("out")));
}

TEST_F(KeptFiles, AFolderOfScansMayGetTheResults) {
  const auto before = snapshotOf(folder_ / "scans");
  for (int run = 0; run < 2; ++run) {
    succeed(map({"--out", path("scans")}));
    for (const auto& [file, content] : before) EXPECT_EQ(describeFile(file), content) << file;
  }
}

TEST_F(KeptFiles, OtherInputsOfMapAreNotReplacedEither) {
  fs::create_directories(path("out"));
  fs::rename(path("poses.txt"), path("out/report.json"));
  expectInput(map({"--poses", path("out/report.json")}));
  expectInput(map({"--poses", path("out/report.json"), "--tiles", "6.4"}));
  fs::rename(path("out/report.json"), path("poses.txt"));
  fs::copy_file(path("tool.obj"), path("out/points.ply"));
  expectInput(map({"--tool", path("out/points.ply")}));
  fs::remove(path("out/points.ply"));
  writeText("out/preview.png", "[map]\nvoxel = 0.05\n");
  expectInput(map({"--config", path("out/preview.png"), "--voxel", "0.05"}));
  fs::remove(path("out/preview.png"));
  succeed(map());
  expectInput(map({"--origin", path("out")}));
}

TEST_F(KeptFiles, ScansInFoldersThatTilesFillAreFoundFirst) {
  for (const char* folder : {"rays", "tiles", "tiles/0_0"}) {
    SCOPED_TRACE(folder);
    const std::string scans = path(std::string("out/") + folder);
    fs::remove_all(path("out"));
    fs::create_directories(fs::path(scans).parent_path());
    fs::rename(path("scans"), scans);
    expectInput(map({"--scans", scans, "--tiles", "6.4"}));
    expectInput(map({"--scans", scans, "--fresh"}));
    expectInput(plan({"--scans", scans, "--tiles", "6.4"}));
    expectInput(plan({"--scans", scans, "--tiles", "6.4", "--fresh"}));
    // Not read, and still not ours.
    fs::create_directories(path("other"));
    fs::copy_file(scans + "/000100.000000.pcd", path("other/000100.000000.pcd"), fs::copy_options::skip_existing);
    expectRefused(map({"--scans", path("other"), "--tiles", "6.4"}), 7, "output.foreign");
    expectRefused(map({"--scans", path("other"), "--fresh"}), 7, "output.foreign");
    fs::rename(scans, path("scans"));
  }
  // Through a link.
  fs::remove_all(path("out"));
  fs::create_directories(path("out"));
  fs::create_directory_symlink(path("scans"), path("out/rays"));
  expectInput(map({"--tiles", "6.4"}));
  expectRefused(map({"--scans", path("other"), "--fresh"}), 7, "output.foreign");
  expectRefused(map({"--scans", path("other"), "--tiles", "6.4"}), 7, "output.foreign");
}

TEST_F(KeptFiles, ForeignFilesAmongTilesAreKept) {
  succeed(map({"--tiles", "6.4", "--keep-rays"}));
  const std::string tile = firstTile();
  for (const std::string& file :
       {std::string("out/rays/notes.txt"), std::string("out/rays/shard-000007.rays"), tile + "/notes.txt",
        std::string("out/tiles/notes.txt"), std::string("out/tiles/99_99/points.ply"),
        std::string("out/tiles/99_99.split.json")}) {
    SCOPED_TRACE(file);
    writeText(file, "mine");
    expectRefused(map({"--tiles", "6.4", "--fresh"}), 7, "output.foreign");
    expectRefused(plan({"--tiles", "6.4", "--fresh"}), 7, "output.foreign");
    // What goes on and what tidies up leaves it alone.
    for (const char* step : {"bin", "run", "merge"}) (void)runProgram({"tile", step, path("out"), "--keep-rays"});
    succeed({"tile", "merge", path("out")});
    EXPECT_EQ(readText(file), "mine");
    fs::remove(path(file));
    fs::remove(fs::path(path(file)).parent_path().string().ends_with("99_99") ? path("out/tiles/99_99") : path("-"));
    succeed({"tile", "bin", path("out")});
  }
  succeed(map({"--tiles", "6.4", "--fresh", "--keep-rays"}));
}

TEST_F(KeptFiles, OneFileOfAllTilesReplacesNone) {
  succeed(map({"--tiles", "6.4", "--keep-rays"}));
  for (const std::string& file : {path(firstTile() + "/points.ply"), path("out/plan.json"), path("tool.obj"),
                                  path("scans/000100.000000.pcd"), path("poses.txt")}) {
    expectInput({"tile", "merge", path("out"), "--points", file});
    expectInput({"tile", "merge", path("out"), "--vdb", file});
  }
  writeText("out/merged_points.ply", "mine");
  succeed({"tile", "merge", path("out"), "--vdb", path("all.vdb")});
  EXPECT_EQ(readText("out/merged_points.ply"), "mine");
  succeed({"tile", "merge", path("out"), "--points", path("out/points.ply")});
  succeed({"tile", "merge", path("out"), "--points", path("out/points.ply")});
}

TEST_F(KeptFiles, FailedRunsKeepTheReportOfAnEarlierResult) {
  succeed(map());
  const std::string before = readText("out/report.json");
  expectRefused(map({"--voxel", "-1"}), 2, "usage.voxel");
  expectRefused(map({"--scans", path("none.pcd")}), 3, "input.missing");
  expectRefused(map({"--tool", path("none.stl")}), 3, "input.unreadable");
  EXPECT_EQ(readText("out/report.json"), before);
  // Nothing is left that it describes.
  for (const char* name : {"points.ply", "field.vdb", "field_points.vdb", "preview.png"})
    fs::remove(path(std::string("out/") + name));
  EXPECT_EQ(runProgram(map({"--scans", path("none.pcd")})).exit_code, 3);
  EXPECT_NE(readText("out/report.json").find("input.missing"), std::string::npos);
}

TEST_F(KeptFiles, ResultsOfOthersAreNotReplaced) {
  for (const char* name : {"points.ply", "field.vdb", "field_points.vdb", "report.json", "preview.png"}) {
    writeText(std::string("out/") + name, "mine");
    expectRefused(map(), 7, "output.foreign");
    expectRefused(map({"--tiles", "6.4"}), 7, "output.foreign");
    fs::remove(path(std::string("out/") + name));
  }
  writeText("out/report.json", "{\"of\": \"another program\"}");
  expectRefused(map({"--voxel", "-1"}), 2, "usage.voxel");  // whose report of the failure stays away as well
  fs::remove_all(path("out"));
  for (const char* name : {"field.json", "rays.json"}) {
    writeText(std::string("out/") + name, "{}");
    expectRefused(map({"--tiles", "6.4"}), 7, "output.foreign");
    fs::remove(path(std::string("out/") + name));
  }
  succeed(map({"--html"}));
  succeed(map({"--html"}));
  succeed(map({"--tiles", "6.4"}));
}

TEST_F(KeptFiles, ResultsOfOtherVerbsAreReplacedIfTheyAreOurs) {
  succeed(map({"--checkpoint", path("cp")}));
  Flags what_if = {"whatif", path("cp"), "--remove", "box:1.9,-0.1,-0.1,2.1,0.1,0.1", "--out", path("made")};
  Flags consistency = {"consistency", "--scans", path("scans"), "--poses",   path("poses.txt"),
                       "--voxel",     "0.05",    "--out",       path("made")};
  for (const std::string& flag : tool()) {
    what_if.push_back(flag);
    consistency.push_back(flag);
  }
  const Flags diff = {"diff", path("out"), path("out"), "--out", path("made")};
  for (int run = 0; run < 2; ++run) {
    for (const Flags& arguments : {diff, what_if, consistency}) succeed(arguments);
  }
  for (const auto& [name, arguments] : {std::pair{"diff.ply", diff},
                                        {"diff.vdb", diff},
                                        {"diff.json", diff},
                                        {"whatif.ply", what_if},
                                        {"whatif.json", what_if},
                                        {"consistency.json", consistency},
                                        {"consistency.md", consistency}}) {
    const std::string file = std::string("made/") + name, ours = readText(file);
    writeText(file, "mine");
    expectRefused(arguments, 7, "output.foreign");
    writeText(file, ours);
  }
}

TEST_F(KeptFiles, VerbsThatReadAMapDoNotReplaceIt) {
  succeed(map({"--checkpoint", path("cp")}));
  for (const char* name : {"points.ply", "field.vdb", "field_points.vdb", "report.json"}) {
    const std::string file = path(std::string("out/") + name);
    expectInput({"render", "--map", path("out"), "--out", file});
    expectInput({"report", "--map", path("out"), "--out", file});
    fs::create_symlink(file, path("link"));
    expectInput({"render", "--map", path("out"), "--out", path("link")});
    fs::remove(path("link"));
  }
  Flags drawn = tool();
  drawn.insert(drawn.begin(), "render");
  drawn.insert(drawn.end(), {"--out", path("tool.obj")});
  expectInput(drawn);
  drawn.back() = path("tool.png");
  succeed(drawn);
  for (const char* verb : {"render", "report"}) {
    for (const char* name : {"preview.png", "report.html"}) {  // made by us, and read by nobody
      succeed({verb, "--map", path("out"), "--out", path(std::string("out/") + name)});
    }
  }

  const std::string state = path("cp/state-1.avst");
  ASSERT_TRUE(fs::exists(state));
  for (const std::string& file : {state, path("cp/state.json"), path("tool.obj")}) {
    for (const std::string& given : {state, path("cp")}) {
      Flags query = {"query", "--map", given, "--at", "2,0,0", "--access-map", file};
      for (const std::string& flag : tool()) query.push_back(flag);
      expectInput(query);
    }
  }

  fs::create_directories(path("changes"));
  for (const char* name : {"diff.ply", "diff.vdb", "diff.json"}) {
    fs::create_hard_link(path("out/points.ply"), path(std::string("changes/") + name));
    expectInput({"diff", path("out"), path("out"), "--out", path("changes")});
    fs::remove(path(std::string("changes/") + name));
  }
  for (const char* name : {"whatif.ply", "whatif.json"}) {
    fs::create_symlink(state, path(std::string("changes/") + name));
    Flags what_if = {"whatif", path("cp"), "--remove", "box:0,0,0,1,1,1", "--out", path("changes")};
    for (const std::string& flag : tool()) what_if.push_back(flag);
    expectInput(what_if);
    fs::remove(path(std::string("changes/") + name));
  }
}

TEST_F(KeptFiles, VerbsThatReadScansDoNotReplaceThem) {
  for (const std::string& file : {path("scans/000101.000000.pcd"), path("poses.txt"), path("tool.obj")}) {
    Flags advise = {"advise", "--scans", path("scans"), "--poses", path("poses.txt"), "--out", file};
    for (const std::string& flag : tool()) advise.push_back(flag);
    expectInput(advise);
    fs::create_directories(path("tables"));
    fs::create_hard_link(file, path("tables/consistency.md"));
    Flags consistency = {"consistency", "--scans", path("scans"), "--poses",     path("poses.txt"),
                         "--voxel",     "0.05",    "--out",       path("tables")};
    for (const std::string& flag : tool()) consistency.push_back(flag);
    expectInput(consistency);
    fs::remove_all(path("tables"));
  }
  for (const char* flag : {"--out", "--per-frame"}) {
    Flags bench = {"bench", "--frames", "2", "--timed-frames", "1", flag, path("tool.obj")};
    for (const std::string& given : tool()) bench.push_back(given);
    expectInput(bench);
  }
  writeText("scans/config.toml", "[evaluate]\n");
  fs::create_directories(path("tables"));
  fs::create_symlink(path("scans/config.toml"), path("tables/tables.md"));
  expectInput({"evaluate", "--table", "fast", "--config", path("scans/config.toml"), "--out", path("tables")});
}

TEST_F(KeptFiles, ASimulatedRecordingReplacesNoRealOne) {
  const auto simulate = [&](const std::string& scene, const Flags& more = {}) {
    Flags flags = {"simulate", "--scene", scene, "--frames", "2", "--sensor", "mid360", "--out", path("rec")};
    flags.insert(flags.end(), more.begin(), more.end());
    return flags;
  };
  fs::create_directories(path("rec"));
  fs::copy_file(path("tool.obj"), path("rec/scene.ply"));
  expectInput(simulate(path("rec/scene.ply"), {"--mesh-unit", "m"}));
  fs::remove(path("rec/scene.ply"));
  fs::copy_file(path("poses.txt"), path("rec/poses.txt"));
  expectRefused(simulate("sphere"), 7, "output.foreign");
  expectInput(simulate("sphere", {"--trajectory", path("rec/poses.txt")}));
  fs::remove(path("rec/poses.txt"));
  writeText("rec/scans/000000.pcd", "mine");
  expectRefused(simulate("sphere"), 7, "output.foreign");
  fs::remove_all(path("rec"));
  succeed(simulate("sphere"));
  succeed(simulate("sphere"));
}

TEST_F(KeptFiles, ALiveMapReplacesNoInput) {
  Flags live = {"live", "--cloud", "/cloud", "--odom", "/odom", "--out", path("out"), "--scan-log", path("tool.obj")};
  for (const std::string& flag : tool()) live.push_back(flag);
  if (runProgram({"live", "--help"}).exit_code != 0) GTEST_SKIP() << "built without DDS";
  expectInput(live);
  writeText("out/points.ply", "mine");
  live[live.size() - tool().size() - 1] = path("log.txt");
  expectRefused(live, 7, "output.foreign");
}

TEST_F(KeptFiles, ACheckpointOfAnotherRunStays) {
  succeed(map({"--checkpoint", path("cp")}));
  const auto before = snapshotOf(folder_ / "cp");
  for (const char* voxel : {"0.05", "0.04"}) {
    const ProgramResult result =
        runProgram(map({"--out", path("other"), "--voxel", voxel, "--checkpoint", path("cp")}));
    EXPECT_EQ(result.exit_code, 4) << result.err;
    EXPECT_NE(result.err.find("error[state.other]"), std::string::npos) << result.err;
    EXPECT_TRUE(snapshotOf(folder_ / "cp") == before);
  }
  writeText("foreign/state.json", "{}");
  const ProgramResult result = runProgram(map({"--out", path("other"), "--checkpoint", path("foreign")}));
  EXPECT_EQ(result.exit_code, 4) << result.err;
  EXPECT_EQ(readText("foreign/state.json"), "{}");
}

/// As a run leaves them that is killed between its first state and the manifest, and between a later one and its.
TEST_F(KeptFiles, StatesOfKilledRunsAreCleared) {
  succeed(map({"--checkpoint", path("cp")}));
  const std::string state = readText("cp/state-1.avst"), manifest = readText("cp/state.json");
  writeText("cp/state-2.avst", state);
  succeed(map({"--resume", path("cp")}));
  EXPECT_EQ(listing("cp"), (Flags{"state-1.avst", "state.json"}));

  writeText("cp/state.json", R"({"schema": 1, "generation": 0, "next": 1})");
  const ProgramResult none = runProgram(map({"--resume", path("cp")}));
  EXPECT_EQ(none.exit_code, 3) << none.err;
  EXPECT_NE(none.err.find("error[state.missing]"), std::string::npos) << none.err;
  succeed(map({"--resume", path("cp"), "--checkpoint", path("cp")}));
  EXPECT_EQ(listing("cp"), (Flags{"state-1.avst", "state.json"}));
}

TEST_F(KeptFiles, StatesThatNoManifestNamesStay) {
  for (const char* name : {"cp/state-1.avst", "cp/state-2.avst", "cp/state-7.avst"}) writeText(name, "mine");
  succeed(map({"--checkpoint", path("cp")}));
  writeWallScans(4, 12);
  writePoses(4);
  fs::create_directories(path("more"));
  fs::rename(path("scans/000103.000000.pcd"), path("more/000103.000000.pcd"));
  writeText("more/000103.000000.pcd", readText("more/000103.000000.pcd") + "2 0 0\n");
  for (int run = 0; run < 2; ++run) {
    const ProgramResult added = runProgram(map({"--resume", path("cp")}));
    EXPECT_NE(added.exit_code, -1) << added.err;
    for (const char* name : {"cp/state-1.avst", "cp/state-2.avst", "cp/state-7.avst"}) {
      EXPECT_EQ(readText(name), "mine") << name;
    }
  }
}

TEST_F(KeptFiles, PipesDevicesAndFoldersAreNoOutputs) {
  succeed(map());
  ASSERT_EQ(::mkfifo(path("pipe").c_str(), 0600), 0);
  fs::create_directories(path("folder"));
  for (const auto& [target, id] : {std::pair{path("pipe"), "output.not_a_file"},
                                   {std::string("/dev/zero"), "output.not_a_file"},
                                   {path("folder"), "output.is_folder"}}) {
    expectRefused({"render", "--map", path("out"), "--out", target}, 7, id);
    expectRefused({"report", "--map", path("out"), "--out", target}, 7, id);
    expectRefused({"advise", "--scans", path("scans"), "--poses", path("poses.txt"), "--out", target}, 7, id);
    fs::create_directories(path("given"));
    fs::create_symlink(target, path("given/points.ply"));
    const ProgramResult result = runProgram(map({"--out", path("given")}));
    EXPECT_EQ(result.exit_code, 7) << result.err;
    EXPECT_NE(result.err.find(std::string("error[") + id), std::string::npos) << result.err;
    fs::remove_all(path("given"));
  }
  succeed({"render", "--map", path("out"), "--out", "/dev/null"});
  const ProgramResult streamed = runProgram({"render", "--map", path("out"), "--out", "/dev/stdout"});
  EXPECT_EQ(streamed.exit_code, 0) << streamed.err;
  EXPECT_EQ(streamed.out.substr(1, 3), "PNG");
  ProgramSetup into_file;
  into_file.arguments = {"render", "--map", path("out"), "--out", "/dev/stdout"};
  into_file.stdout_path = path("picture.png");
  writeText("picture.png", "");
  EXPECT_EQ(runProgram(into_file).exit_code, 0);
  EXPECT_EQ(readText("picture.png").substr(1, 3), "PNG");
  EXPECT_TRUE(fs::is_symlink("/dev/stdout")) << "the name itself was replaced";
}

/// Only the second one would be left.
TEST_F(KeptFiles, TwoOutputsAreNotOneFile) {
  const auto refuse = [this](const Flags& arguments) { expectRefused(arguments, 2, "output.twice"); };
  refuse({"bench", "--out", path("x"), "--per-frame", path("x")});
  refuse({"bench", "--out", path("x"), "--per-frame", path("./scans/../x")});
  writeText("x", "mine");
  fs::create_hard_link(path("x"), path("hard"));
  fs::create_symlink(path("x"), path("soft"));
  fs::create_directory_symlink(folder_, path("folder"));
  for (const char* other : {"x", "hard", "soft", "folder/x", "folder/soft"}) {
    refuse({"bench", "--out", path("x"), "--per-frame", path(other)});
    refuse({"bench", "--out", path(other), "--per-frame", path("x")});
  }
  succeed(map({"--tiles", "6.4"}));
  for (const char* other : {"all", "./all", "folder/all"}) {
    refuse({"tile", "merge", path("out"), "--points", path("all"), "--vdb", path(other)});
  }
  refuse({"tile", "merge", path("out"), "--points", path("out/preview.png")});
  refuse({"tile", "merge", path("out"), "--vdb", path("folder/out/preview.png")});
  succeed({"tile", "merge", path("out"), "--points", path("all.ply"), "--vdb", path("all.vdb")});
}

TEST_F(KeptFiles, NothingIsMergedIntoTheTiles) {
  succeed(map({"--tiles", "6.4", "--keep-rays"}));
  fs::create_directory_symlink(path("out/tiles"), path("linked"));
  for (const std::string& file : {std::string("out/tiles/all"), firstTile() + "/all", std::string("out/rays/all"),
                                  std::string("linked/all"), std::string("scans/../out/tiles/../tiles/all")}) {
    expectInput({"tile", "merge", path("out"), "--points", path(file + ".ply")});
    expectInput({"tile", "merge", path("out"), "--vdb", path(file + ".vdb")});
  }
  succeed({"tile", "merge", path("out"), "--points", path("out/all.ply")});
}

TEST_F(KeptFiles, AForeignPlanIsNotReplaced) {
  for (const char* content : {"{}", "mine", ""}) {
    writeText("out/plan.json", content);
    for (const char* tiles : {"off", "auto", "6.4"}) {
      expectRefused(map({"--fresh", "--tiles", tiles}), 7, "output.foreign");
    }
    expectRefused(plan({"--fresh", "--tiles", "6.4"}), 7, "output.foreign");
  }
}

/// A pipe that nobody writes into must not be waited for.
TEST_F(KeptFiles, PipesAndDevicesNamedByFlagsAreNoInputs) {
  ASSERT_EQ(::mkfifo(path("pipe").c_str(), 0600), 0);
  fs::copy_file(path("tool.obj"), path("mesh.obj"));
  for (const std::string& file : {path("pipe"), std::string("/dev/zero"), std::string("/dev/null")}) {
    for (const std::string verb : {"map", "advise", "live", "simulate", "evaluate", "bench", "info", "query", "diff",
                                   "render", "report", "whatif", "tile plan"}) {
      const Flags words = verb == "tile plan" ? Flags{"tile", "plan"} : Flags{verb};
      Flags config = words;
      config.insert(config.end(), {"--config", file});
      expectRefused(config, 3, "input.not_a_file");
    }
    for (const Flags& flags :
         {Flags{"--scans", file}, Flags{"--poses", file}, Flags{"--calib", file},
          Flags{"--poses", "", "--trajectory", file}, Flags{"--poses", "", "--stations", file}, Flags{"--tool", file},
          Flags{"--orientations", "list:" + file}, Flags{"--remove", "mesh:" + file}, Flags{"--remove", "ids:" + file},
          Flags{"--resume", file}, Flags{"--origin", file}}) {
      SCOPED_TRACE(file + " " + flags[flags.size() - 2]);
      const ProgramResult result = runProgram(map(flags));
      EXPECT_GT(result.exit_code, 1) << result.err;
      EXPECT_LT(result.exit_code, 5) << result.err;
    }
  }
}

TEST_F(KeptFiles, PipesAreNoInputs) {
  succeed(map());
  fs::remove(path("out/points.ply"));
  ASSERT_EQ(::mkfifo(path("out/points.ply").c_str(), 0600), 0);
  for (const Flags& arguments :
       {Flags{"render", "--map", path("out"), "--out", path("p.png")}, Flags{"diff", path("out"), path("out")},
        Flags{"report", "--map", path("out"), "--out", path("p.html")},
        Flags{"query", "--map", path("out"), "--at", "2,0,0"},
        map({"--out", path("given"), "--origin", path("out")})}) {
    const ProgramResult result = runProgram(arguments);
    EXPECT_EQ(result.exit_code, 3) << arguments.front() << ": " << result.err;
  }
}

/// Results are known by what our writers put where. To speak of accessvdb, or to have keys that many files have, is not
/// enough.
TEST_F(KeptFiles, FilesThatOnlySpeakOfAccessVdbAreKept) {
  const struct {
    const char *name, *content;
    Flags flags;
  } all[] = {{"report.json", "{\"schema\": \"https://my/schema\", \"version\": 3, \"measurements\": [1, 2]}", {}},
             {"report.html", "<html>My site report. Mapping was done with AccessVDB.</html>", {"--html"}},
             {"points.ply", "ply\nformat ascii 1.0\ncomment exported from /home/me/accessvdb/scan1\nend_header\n", {}},
             {"points.ply",
              "ply\nformat ascii 1.0\ncomment exported from /home/me/accessvdb/scan1\nend_header\n",
              {"--tiles", "6.4"}},
             {"preview.png", "\x89PNG\r\n\x1a\n of the AccessVDB stand", {}}};
  for (const auto& [name, content, flags] : all) {
    fs::remove_all(path("out"));
    fs::create_directories(path("out"));
    writeText(std::string("out/") + name, content);
    expectRefused(map(flags), 7, "output.foreign");
  }
  // Ours alone, without the others beside it.
  fs::remove_all(path("out"));
  succeed(map());
  for (const char* name : {"report.json", "points.ply", "field.vdb", "field_points.vdb"})
    fs::remove(path("out") + "/" + name);
  succeed(map());
}

TEST_F(KeptFiles, FilesThatAMeshRefersToAreInputs) {
  succeed(map());
  std::ofstream(path("tool.obj"), std::ios::app) << "\nmtllib tool.mtl\n";
  writeText("tool.mtl", "newmtl steel\n");
  Flags render = {"render", "--out", path("tool.mtl")};
  const Flags of = tool();
  render.insert(render.end(), of.begin(), of.end());
  expectInput(render);
}

TEST_F(KeptFiles, ScansBehindALinkAreNotSimulatedOver) {
  const Flags simulate = {"simulate", "--scene", "box", "--frames", "2", "--out", path("so")};
  succeed(simulate);
  succeed(simulate);
  fs::remove_all(path("so/scans"));
  fs::create_directory_symlink(path("scans"), path("so/scans"));
  expectRefused(simulate, 7, "output.foreign");
  fs::remove(path("so/scans"));
  writeText("so/scene.json", "{\"schema\": 1, \"version\": \"my scene\"}");
  expectRefused(simulate, 7, "output.foreign");
}

}  // namespace
}  // namespace accessvdb::cli_test

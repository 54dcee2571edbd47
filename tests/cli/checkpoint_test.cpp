// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// map --checkpoint and --resume: a run that was stopped gives the files of one that was not, other scans are added,
/// and whatever does not fit to the checkpoint is refused in words.
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <nlohmann/json.hpp>

#include "checkpoint_world.h"
#include "program_run.h"

namespace accessvdb::cli_test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

class CheckpointedRun : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    writePoses(80);
  }

  ProgramResult map(const std::string& out, const std::vector<std::string>& more) const {
    return runProgram(arguments(out, more));
  }
  std::vector<std::string> arguments(const std::string& out, std::vector<std::string> more) const {
    more.insert(more.end(), {"--out", path(out), "--width", "160", "--height", "120", "--allow-disagreement"});
    return mapArguments(more);
  }
  /// A run with checkpoints in "cp" that is stopped once a file is there.
  ProgramResult stop(const std::string& out, int signal, const std::vector<std::string>& more = {},
                     const std::string& awaited = "cp/state.json") const {
    ProgramSetup setup;
    std::vector<std::string> all = more;
    all.insert(all.end(), {"--checkpoint", path("cp"), "--checkpoint-every", "1ms"});
    setup.arguments = arguments(out, all);
    setup.signal_after = "predicted peak memory";
    setup.act = [this, signal, awaited](pid_t process) {
      for (int n = 0; n < 10'000 && !fs::exists(folder_ / awaited); ++n) usleep(1'000);
      kill(process, signal);
    };
    return runProgram(setup);
  }
  void expectSameFiles(const std::string& a, const std::string& b) const {
    for (const std::string& name : comparedOutputs()) {
      const std::string expected = contentOf(folder_ / a / name);
      EXPECT_FALSE(expected.empty()) << name;
      EXPECT_TRUE(expected == contentOf(folder_ / b / name)) << name << " differs";
    }
  }
  json report(const std::string& out) const { return json::parse(readText(out + "/report.json")); }
  json manifest() const { return json::parse(readText("cp/state.json")); }
  fs::path stateFile() const {
    return folder_ / "cp" / ("state-" + std::to_string(manifest().at("generation").get<int>()) + ".avst");
  }
  /// Nothing but the last checkpoint is there.
  void expectOneCheckpoint() const {
    EXPECT_EQ(listing("cp"), (std::vector<std::string>{stateFile().filename().string(), "state.json"}));
  }
  void expectRefused(const std::vector<std::string>& more, int code, const std::string& id, const std::string& words) {
    const ProgramResult result = map("refused", more);
    EXPECT_EQ(result.exit_code, code) << result.err;
    EXPECT_NE(result.err.find("error[" + id + "]"), std::string::npos) << result.err;
    EXPECT_NE(result.err.find(words), std::string::npos) << result.err;
    EXPECT_EQ(listing("refused"), std::vector<std::string>{"report.json"});
    fs::remove_all(folder_ / "refused");
  }

  static constexpr CheckpointWorld kWorld = {};
  static constexpr int kLong = 79;  ///< scans: a signal after the first checkpoint arrives before the last one
};

TEST_F(CheckpointedRun, GoesOnAfterASignal) {
  writeScansOf(kWorld, folder_ / "scans", 0, kLong);
  ASSERT_EQ(map("straight", {}).exit_code, 0);
  for (const int signal : {SIGTERM, SIGINT}) {
    const ProgramResult stopped = stop("out", signal);
    ASSERT_EQ(stopped.exit_code, 128 + signal) << stopped.err;
    EXPECT_NE(stopped.err.find("--resume " + path("cp")), std::string::npos) << stopped.err;
    const int fused = report("out").at("counts").at("scans");
    EXPECT_GT(fused, 0);
    EXPECT_LT(fused, kLong);
    EXPECT_EQ(manifest().at("next_step"), fused) << "the signal must have written one";
    expectOneCheckpoint();

    const ProgramResult resumed = map("out", {"--resume", path("cp")});
    ASSERT_EQ(resumed.exit_code, 0) << resumed.err;
    expectSameFiles("straight", "out");
    EXPECT_EQ(report("out").at("resumed_after_scans"), fused);
    EXPECT_EQ(report("out").at("counts"), report("straight").at("counts"));
    EXPECT_EQ(report("out").at("inputs"), report("straight").at("inputs"));
    EXPECT_EQ(report("out").at("warnings"), report("straight").at("warnings"));
    EXPECT_EQ(manifest().at("next_step"), kLong);
    expectOneCheckpoint();
    fs::remove_all(folder_ / "cp");
  }
}

/// One file that is read in steps.
TEST_F(CheckpointedRun, GoesOnInTheMiddleOfACloud) {
  writeScansOf({.points_a_side = 600}, folder_ / "clouds", 0, 1);
  const std::vector<std::string> cloud = {"--scans", path("clouds/000100.000000.pcd"), "--poses", "", "--sensor-at",
                                          "0,0,0"};
  ASSERT_EQ(map("straight", cloud).exit_code, 0);
  ProgramResult stopped = stop("out", SIGTERM, cloud);
  for (int late = 0; late < 3 && stopped.exit_code == 0; ++late) {  // the signal came after the end
    fs::remove_all(folder_ / "cp");
    stopped = stop("out", SIGTERM, cloud);
  }
  ASSERT_EQ(stopped.exit_code, 128 + SIGTERM) << stopped.err;
  std::vector<std::string> resume = cloud;
  resume.insert(resume.end(), {"--resume", path("cp")});
  const ProgramResult resumed = map("out", resume);
  ASSERT_EQ(resumed.exit_code, 0) << resumed.err;
  EXPECT_EQ(report("out").at("counts").at("scans"), 18) << "360 000 points in steps of 20 000";
  EXPECT_LT(report("out").at("resumed_after_scans"), 18);
  expectSameFiles("straight", "out");
}

/// Labels do not depend on when they were made, and a sequence goes on with its next frame.
TEST_F(CheckpointedRun, GoesOnWithUpdatesInBetween) {
  writeScansOf(kWorld, folder_ / "scans", 0, kLong);
  const std::vector<std::string> often = {"--update-every", "3", "--sequence", "10"};
  ASSERT_EQ(map("straight", often).exit_code, 0);
  ASSERT_EQ(stop("out", SIGTERM, often, "out/field_0002.vdb").exit_code, 128 + SIGTERM);
  std::vector<std::string> resume = often;
  resume.insert(resume.end(), {"--resume", path("cp")});
  const ProgramResult resumed = map("out", resume);
  ASSERT_EQ(resumed.exit_code, 0) << resumed.err;
  EXPECT_EQ(listing("out"), listing("straight")) << "with frames 1 to 8";
  const json counts = report("out").at("counts"), expected = report("straight").at("counts");
  for (const char* count :
       {"scans", "points_in", "points_used", "surface_points", "accessible", "blocked", "unscored"}) {
    EXPECT_EQ(counts.at(count), expected.at(count)) << count;
  }
  EXPECT_GT(counts.at("accessible"), 0);
  EXPECT_GT(counts.at("blocked"), 0);
}

TEST_F(CheckpointedRun, StartsWhereThereIsNoneYet) {
  writeScansOf(kWorld, folder_ / "scans", 0, 4);
  ASSERT_EQ(map("straight", {}).exit_code, 0);
  expectRefused({"--resume", path("cp")}, 3, "state.missing", "holds no checkpoint");
  for (int run = 0; run < 2; ++run) {
    const ProgramResult result = map("out", {"--resume", path("cp"), "--checkpoint", path("cp")});
    ASSERT_EQ(result.exit_code, 0) << result.err;
    EXPECT_EQ(result.err.find("going on after 4 of 4 scans") != std::string::npos, run == 1) << result.err;
    expectSameFiles("straight", "out");
    expectOneCheckpoint();
  }
}

TEST_F(CheckpointedRun, AddsOtherScans) {
  writeScansOf(kWorld, folder_ / "all", 0, 12);
  writeScansOf(kWorld, folder_ / "first", 0, 5);
  writeScansOf(kWorld, folder_ / "second", 5, 4);
  writeScansOf(kWorld, folder_ / "third", 9, 3);
  ASSERT_EQ(map("straight", {"--scans", path("all")}).exit_code, 0);
  ASSERT_EQ(map("out", {"--scans", path("first"), "--checkpoint", path("cp")}).exit_code, 0);
  for (const char* flight : {"second", "second", "third", "third"}) {
    const ProgramResult added = map("out", {"--scans", path(flight), "--resume", path("cp")});
    ASSERT_EQ(added.exit_code, 0) << added.err;
  }
  expectSameFiles("straight", "out");
  expectOneCheckpoint();
  EXPECT_EQ(report("out").at("counts"), report("straight").at("counts"));
  EXPECT_EQ(report("out").at("resumed_after_scans"), 12);
  expectRefused({"--scans", path("second"), "--resume", path("cp")}, 4, "state.scans", "4 of 4 scans are in it");
}

TEST_F(CheckpointedRun, AddsToAnotherFolder) {
  writeScansOf(kWorld, folder_ / "scans", 0, 3);
  ASSERT_EQ(map("out", {"--checkpoint", path("cp")}).exit_code, 0);
  const std::string before = contentOf(stateFile());
  writeScansOf(kWorld, folder_ / "more", 3, 2);
  ASSERT_EQ(map("out", {"--scans", path("more"), "--resume", path("cp"), "--checkpoint", path("cp2")}).exit_code, 0);
  EXPECT_EQ(contentOf(stateFile()), before);
  EXPECT_EQ(json::parse(readText("cp2/state.json")).at("earlier_scans"), 3);
}

TEST_F(CheckpointedRun, RefusesWhatIsNotTheSameRun) {
  writeScansOf(kWorld, folder_ / "scans", 0, kLong);
  ASSERT_EQ(stop("out", SIGTERM).exit_code, 128 + SIGTERM);
  const std::vector<std::string> resume = {"--resume", path("cp")};
  const auto with = [&](std::vector<std::string> more) {
    more.insert(more.end(), resume.begin(), resume.end());
    return more;
  };
  expectRefused(with({"--voxel", "0.04"}), 4, "state.params", "voxel_size_m was 0.05 and is now 0.04");
  expectRefused(with({"--directions", "36"}), 4, "state.params", "and is now 36");
  expectRefused(with({"--origin", "7.25,0,0"}), 4, "state.params", "of the first scan and is now 7.25,0,0");
  expectRefused(with({"--every", "2"}), 4, "state.params", "every was \"1\" and is now \"2\"");
  expectRefused(with({"--tool", "builtin:pruner"}), 4, "state.tool", "for another tool");
  expectRefused(with({"--policy", "paper"}), 2, "usage.checkpoint", "--policy exact");
  expectRefused({"--policy", "paper", "--checkpoint", path("cp")}, 2, "usage.checkpoint", "--policy exact");
  expectRefused({"--profile", "paper", "--checkpoint", path("cp")}, 2, "usage.checkpoint", "--policy exact");
  expectRefused({"--tiles", "12.8", "--checkpoint", path("cp")}, 2, "usage.tiles", "the same command goes on");
  for (const char* duration : {"5", "m", "-1s", "nan", "5 m", "1e999s", "5d"}) {
    expectRefused({"--checkpoint", path("cp"), "--checkpoint-every", duration}, 2, "usage.duration", duration);
  }
  expectRefused({"--checkpoint", path("cp"), "--no-clobber"}, 7, "output.exists", "--no-clobber");

  writePoses(81);
  expectRefused(resume, 4, "state.scans", "pose " + path("poses.txt"));
  writePoses(80);
  writeScansOf(kWorld, folder_ / "scans", kLong, 1);
  expectRefused(resume, 4, "state.scans", "there are now 80 scans to fuse, and were 79");
  fs::remove(folder_ / "scans" / "000179.000000.pcd");
  const fs::path first = folder_ / "scans" / "000100.000000.pcd";
  const std::string good = contentOf(first);
  std::ofstream(first, std::ios::binary) << contentOf(folder_ / "scans" / "000101.000000.pcd");
  expectRefused(resume, 4, "state.scans", "is another one");
  std::ofstream(first, std::ios::binary) << good;
  EXPECT_EQ(map("out", resume).exit_code, 0) << "nothing was lost";
  std::ofstream(folder_ / "scans" / "000103.000000.pcd", std::ios::binary) << good;
  expectRefused(resume, 4, "state.scans", "has different content from");
}

TEST_F(CheckpointedRun, RefusesADamagedCheckpoint) {
  writeScansOf(kWorld, folder_ / "scans", 0, 3);
  ASSERT_EQ(map("out", {"--checkpoint", path("cp")}).exit_code, 0);
  const std::string state = contentOf(stateFile()), text = readText("cp/state.json");
  const std::vector<std::string> resume = {"--resume", path("cp")};
  std::string bad = state;
  bad[bad.size() - 40] ^= 1;
  std::ofstream(stateFile(), std::ios::binary) << bad;
  expectRefused(resume, 3, "state.damaged", "section \"leftout\"");
  std::ofstream(stateFile(), std::ios::binary) << state.substr(0, state.size() / 2);
  expectRefused(resume, 3, "state.damaged", "section \"head\"");
  std::ofstream(stateFile(), std::ios::binary) << state;
  for (const std::string& damaged :
       {std::string(), std::string("[]"), std::string("{}"), text.substr(0, text.size() / 2),
        std::string(text).replace(text.find("\"next_step\": 3"), 14, "\"next_step\": 2"),
        std::string(text).replace(text.find("\"next_step\": 3"), 14, "\"next_step\":-3"),
        std::string(text).replace(text.find("head_sha256\": \"") + 15, 2, "zz"),
        std::string(text).replace(text.find("\"schema\": 1"), 11, "\"schema\": 9")}) {
    writeText("cp/state.json", damaged);
    expectRefused(resume, 3, "state.damaged", "state.json");
  }
  writeText("cp/state.json", text);
  EXPECT_EQ(map("out", resume).exit_code, 0);
}

/// What another run is about to replace is not read.
TEST_F(CheckpointedRun, WaitsForTheFolderBeforeItReads) {
  writeScansOf(kWorld, folder_ / "scans", 0, 3);
  fs::create_directories(folder_ / "cp");
  writeText("cp/state.json", "[]");
  const FolderOfAnother another(folder_ / "cp");
  expectRefused({"--resume", path("cp")}, 7, "output.locked", "another process");
}

TEST_F(CheckpointedRun, GoesOnWithoutCheckpointsIfTheyDoNotFit) {
  writeScansOf({.points_a_side = 150}, folder_ / "scans", 0, 3);
  // Many directions: they are in a state, and in no other file.
  const std::vector<std::string> more = {"--voxel",         "0.02",         "--orientations",
                                         "pitch:-20:20:10", "--checkpoint", path("cp")};
  ASSERT_EQ(map("out", more).exit_code, 0);
  std::uintmax_t largest = 0;
  for (const std::string& name : comparedOutputs()) largest = std::max(largest, fs::file_size(folder_ / "out" / name));
  const std::uintmax_t state = fs::file_size(stateFile());
  ASSERT_GT(state, largest) << "no limit lies between them";
  fs::remove_all(folder_ / "cp");
  ProgramSetup setup;
  setup.arguments = arguments("out", more);
  setup.file_size_limit = static_cast<long>((largest + state) / 2);
  const ProgramResult result = runProgram(setup);
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.err.find("no checkpoint was written"), std::string::npos) << result.err;
  EXPECT_TRUE(listing("cp").empty()) << listing("cp").front();
}

}  // namespace
}  // namespace accessvdb::cli_test

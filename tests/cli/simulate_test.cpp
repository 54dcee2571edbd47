// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// `accessvdb-lab simulate`: its output, that `map` reads it, and its messages about bad input.
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "program_run.h"

namespace accessvdb::cli_test {
namespace {

using nlohmann::json;

class Simulate : public ProgramTest {
 protected:
  [[nodiscard]] ProgramResult simulate(std::vector<std::string> more, const std::string& out = "sim") const {
    std::vector<std::string> arguments = {"simulate", "--out", path(out)};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return runLab(arguments);
  }
  /// A refusal is one line with its code, and leaves nothing that looks like a recording.
  void expectRefused(const std::vector<std::string>& more, int exit_code, const std::string& said) const {
    const ProgramResult result = simulate(more, "refused");
    EXPECT_EQ(result.exit_code, exit_code) << result.err;
    EXPECT_NE(result.err.find(said), std::string::npos) << result.err;
    EXPECT_NE(result.err.find("accessvdb: error["), std::string::npos) << result.err;
    EXPECT_EQ(listing("refused/scans"), std::vector<std::string>());
  }
  /// A box of 0.2 m as an OBJ in millimetres, whole or without its last face.
  void writeBoxMesh(const std::string& name, bool closed) const {
    std::string text =
        "v -100 -100 -100\nv 100 -100 -100\nv -100 100 -100\nv 100 100 -100\n"
        "v -100 -100 100\nv 100 -100 100\nv -100 100 100\nv 100 100 100\n"
        "f 1 5 7 3\nf 2 4 8 6\nf 1 2 6 5\nf 3 7 8 4\nf 1 3 4 2\n";
    if (closed) text += "f 5 6 8 7\n";
    writeText(name, text);
  }
};

TEST_F(Simulate, LeavesARecordingThatMapReads) {
  const ProgramResult made = simulate({"--scene", "torus", "--frames", "60", "--range-noise", "0.0005"});
  ASSERT_EQ(made.exit_code, 0) << made.err;
  EXPECT_EQ(listing("sim"),
            (std::vector<std::string>{"poses.txt", "range_noise.txt", "scans", "scene.json", "scene.ply"}));
  EXPECT_EQ(listing("sim/scans").size(), 60u);
  EXPECT_EQ(listing("sim/scans").front(), "000000.pcd");
  EXPECT_EQ(readText("sim/range_noise.txt"), "0.0005\n");

  const ProgramResult mapped = runProgram({"map", "--scans", path("sim/scans"), "--poses", path("sim/poses.txt"),
                                           "--tool", "builtin:pencil", "--voxel", "0.002", "--out", path("out")});
  ASSERT_EQ(mapped.exit_code, 0) << mapped.err;
  const json report = json::parse(readText("out/report.json"));
  EXPECT_EQ(report["counts"]["scans"], 60);
  EXPECT_EQ(report["counts"]["points_in"], 60 * 20000);
  EXPECT_GT(report["counts"]["surface_points"], 3000);
  EXPECT_GT(report["counts"]["accessible"], 500);
  EXPECT_GT(report["counts"]["blocked"], 500);
  bool noise_read = false;
  for (const auto& [key, value] : report["parameters"].items()) {
    noise_read =
        noise_read || (key.find("noise") != std::string::npos && value.dump().find("0.0005") != std::string::npos);
  }
  EXPECT_TRUE(noise_read) << report["parameters"].dump();
}

TEST_F(Simulate, DescribesEveryParameter) {
  ASSERT_EQ(simulate({"--scene", "ring", "--voxel", "0.004", "--frames", "2", "--seed", "9", "--dropout", "0.25",
                      "--max-range", "0.6", "--sensor", "spinning", "--trajectory", "orbit", "--radius", "0.4"})
                .exit_code,
            0);
  const json scene = json::parse(readText("sim/scene.json"));
  EXPECT_EQ(scene["scene"]["name"], "ring");
  EXPECT_NE(scene["scene"]["description"].get<std::string>().find("minor radius 0.006 m"), std::string::npos);
  EXPECT_EQ(scene["scene"]["distance_known"], true);
  EXPECT_EQ(scene["sensor"]["name"], "spinning");
  EXPECT_EQ(scene["sensor"]["rays_per_frame"], 65536);
  EXPECT_EQ(scene["sensor"]["dropout"], 0.25);
  EXPECT_EQ(scene["sensor"]["max_range_m"], 0.6);
  EXPECT_EQ(scene["trajectory"]["kind"], "orbit");
  EXPECT_EQ(scene["trajectory"]["radius_m"], 0.4);
  EXPECT_EQ(scene["frames"], 2);
  EXPECT_EQ(scene["seed"], 9);
}

TEST_F(Simulate, SameBytesOnAnyNumberOfThreads) {
  const std::vector<std::string> common = {"--scene", "box", "--frames", "20", "--range-noise", "0.01"};
  const auto run = [&](const std::string& out, std::vector<std::string> more) {
    more.insert(more.end(), common.begin(), common.end());
    ASSERT_EQ(simulate(more, out).exit_code, 0);
  };
  run("a", {"--threads", "1"});
  run("b", {"--threads", "3"});
  run("c", {"--seed", "2"});
  for (const char* file : {"scans/000000.pcd", "scans/000019.pcd", "poses.txt", "scene.ply", "scene.json"}) {
    EXPECT_EQ(readText(std::string("a/") + file), readText(std::string("b/") + file)) << file;
  }
  EXPECT_NE(readText("a/scans/000019.pcd"), readText("c/scans/000019.pcd"));
  EXPECT_EQ(readText("a/poses.txt"), readText("c/poses.txt"));
}

TEST_F(Simulate, MeshesAndTrajectoriesFromFiles) {
  writeBoxMesh("box.obj", true);
  writeBoxMesh("open.obj", false);
  writeText("path.txt", "0 1 0 0 0 0 1 0\n0.1 1 0.1 0 0 0 1 0\n0.2 1 0.2 0 0 0 1 0\n");
  const ProgramResult closed = simulate(
      {"--scene", path("box.obj"), "--mesh-unit", "mm", "--trajectory", path("path.txt"), "--frames", "2"}, "closed");
  ASSERT_EQ(closed.exit_code, 0) << closed.err;
  EXPECT_EQ(closed.err.find("warning"), std::string::npos) << closed.err;
  EXPECT_EQ(listing("closed/scans").size(), 2u);
  const ProgramResult open = simulate({"--scene", path("open.obj"), "--mesh-unit", "mm", "--frames", "2"}, "open");
  ASSERT_EQ(open.exit_code, 0) << open.err;
  EXPECT_NE(open.err.find("warning[sim.no_truth]"), std::string::npos) << open.err;
  const json scene = json::parse(readText("open/scene.json"));
  EXPECT_EQ(scene["scene"]["distance_known"], false);
  EXPECT_NE(scene["scene"]["distance_note"].get<std::string>().find("no ground truth"), std::string::npos);
  // The mesh that it writes is the simulated one: 0.2 m, and the same again as a scene.
  const ProgramResult again = simulate(
      {"--scene", path("closed/scene.ply"), "--mesh-unit", "m", "--trajectory", path("path.txt"), "--frames", "2"},
      "again");
  ASSERT_EQ(again.exit_code, 0) << again.err;
  EXPECT_EQ(readText("again/scans/000001.pcd"), readText("closed/scans/000001.pcd"));
}

TEST_F(Simulate, RefusesInOneLine) {
  writeBoxMesh("box.obj", true);
  writeText("inside.txt", "0 1 0 0 0 0 0 1\n0.1 0.05 0 0 0 0 0 1\n");
  writeText("through.txt", "0 1 0 0 0 0 0 1\n0.1 -1 0 0 0 0 0 1\n");
  writeText("bad.txt", "0 1 0 0 0 zero 0 1\n");
  const std::string box = path("box.obj");
  expectRefused({}, 2, "--scene");
  expectRefused({"--scene", "tours"}, 2, "neither a scene nor a mesh file");
  expectRefused({"--scene", path("none.stl")}, 3, "none.stl");
  expectRefused({"--scene", box}, 2, "--mesh-unit");
  expectRefused({"--scene", box, "--mesh-unit", "m"}, 4, "--mesh-unit");
  expectRefused({"--scene", box, "--mesh-unit", "parsec"}, 2, "not a unit");
  expectRefused({"--scene", "torus", "--frames", "0"}, 4, "no frames");
  expectRefused({"--scene", "torus", "--sensor", "mid70"}, 2, "mid360");
  expectRefused({"--scene", "torus", "--range-noise", "-1"}, 2, "--range-noise");
  expectRefused({"--scene", "torus", "--range-noise", "nan"}, 2, "--range-noise");
  expectRefused({"--scene", "torus", "--radius", "0"}, 2, "--radius");
  expectRefused({"--scene", "torus", "--trajectory", "walk", "--turns", "2"}, 2, "--turns");
  for (const char* turns : {"1400", "-1400", "1000.5", "nan", "inf"}) {
    expectRefused({"--scene", "torus", "--trajectory", "helix", "--turns", turns}, 2, "--turns");
  }
  expectRefused({"--scene", "ring", "--voxel", "1"}, 2, "--voxel");
  expectRefused({"--scene", "torus", "--radius", "0.06", "--trajectory", "orbit"}, 4, "inside the torus");
  expectRefused({"--scene", "torus", "--trajectory", "walk", "--begin", "-1,0,0", "--end", "1,0,0", "--frames", "2"}, 4,
                "through the torus");
  expectRefused({"--scene", "torus", "--trajectory", "orbit", "--radius", "0.1", "--height", "0", "--frames", "1",
                 "--max-range", "0.01"},
                2, "--max-range");
  expectRefused({"--scene", box, "--mesh-unit", "mm", "--trajectory", path("inside.txt")}, 4, "inside the mesh");
  expectRefused({"--scene", box, "--mesh-unit", "mm", "--trajectory", path("through.txt")}, 4, "through the mesh");
  expectRefused({"--scene", box, "--mesh-unit", "mm", "--trajectory", path("bad.txt")}, 3, "bad.txt");
  expectRefused({"--scene", box, "--mesh-unit", "mm", "--trajectory", path("through.txt"), "--frames", "3"}, 4,
                "2 poses");
}

TEST_F(Simulate, ReplacesAnEarlierRecordingButNoOtherFiles) {
  ASSERT_EQ(simulate({"--scene", "wall", "--frames", "5"}).exit_code, 0);
  ASSERT_EQ(simulate({"--scene", "wall", "--frames", "8"}).exit_code, 0);
  const std::string poses = readText("sim/poses.txt");
  EXPECT_EQ(listing("sim/scans").size(), 8u);
  const ProgramResult shorter = simulate({"--scene", "wall", "--frames", "3"});
  EXPECT_EQ(shorter.exit_code, 7) << shorter.err;
  EXPECT_NE(shorter.err.find("already contains other files"), std::string::npos) << shorter.err;
  EXPECT_EQ(listing("sim/scans").size(), 8u) << "nothing may be lost";
  EXPECT_EQ(readText("sim/poses.txt"), poses) << "nothing may be lost";
}

TEST_F(Simulate, AStoppedRecordingCanBeUsed) {
  ProgramSetup setup;
  setup.lab = true;
  setup.arguments = {"simulate", "--scene", "torus", "--frames", "5000", "--out", path("sim")};
  setup.signal_after = "scene: torus";
  setup.act = [this](pid_t process) {
    for (int n = 0; n < 3000 && listing("sim/scans").size() < 3; ++n) usleep(10'000);
    kill(process, SIGINT);
  };
  const ProgramResult stopped = runProgram(setup);
  ASSERT_EQ(stopped.exit_code, 130) << stopped.err;
  const std::size_t scans = listing("sim/scans").size();
  EXPECT_GT(scans, 0u);
  EXPECT_LT(scans, 5000u);
  const json scene = json::parse(readText("sim/scene.json"));
  EXPECT_EQ(scene["frames"], 5000);
  EXPECT_EQ(scene["frames_written"], scans);
  const std::string poses = readText("sim/poses.txt");
  EXPECT_EQ(static_cast<std::size_t>(std::count(poses.begin(), poses.end(), '\n')), scans + 1);
}

}  // namespace
}  // namespace accessvdb::cli_test

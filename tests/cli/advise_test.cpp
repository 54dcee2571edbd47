// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb advise: finds the noise that was put into scans, and writes what map reads.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "program_run.h"

namespace accessvdb::cli_test {
namespace {

class Advise : public ProgramTest {
 protected:
  /// Scans from around a closed box of 4 x 4 x 3 m. Their noise is not written beside them.
  void simulate(const std::string& noise_m, const std::string& out) {
    std::string mesh;
    for (const char* const x : {"-2", "2"})
      for (const char* const y : {"-2", "2"})
        for (const char* const z : {"-1.5", "1.5"}) mesh += std::string("v ") + x + " " + y + " " + z + "\n";
    mesh +=
        "f 1 2 4\nf 1 4 3\nf 5 7 8\nf 5 8 6\nf 1 5 6\nf 1 6 2\nf 3 4 8\nf 3 8 7\nf 1 3 7\nf 1 7 5\nf 2 6 8\nf 2 8 4\n";
    writeText("house.obj", mesh);
    const ProgramResult result = runLab({"simulate", "--scene", path("house.obj"), "--mesh-unit", "m", "--trajectory",
                                         "orbit", "--frames", "30", "--range-noise", noise_m, "--out", path(out)});
    ASSERT_EQ(result.exit_code, 0) << result.err;
    std::filesystem::remove(path(out + "/range_noise.txt"));
  }
  [[nodiscard]] static double valueOf(const std::string& toml, const std::string& key) {
    std::istringstream lines(toml);
    for (std::string line; std::getline(lines, line);)
      if (line.starts_with(key + " = ")) return std::stod(line.substr(key.size() + 3));
    ADD_FAILURE() << key << " is not in: " << toml;
    return 0;
  }
};

TEST_F(Advise, FindsTheNoiseAndWritesWhatMapReads) {
  for (const double noise_m : {0.005, 0.02}) {
    const std::string name = std::to_string(noise_m);
    simulate(name, name);
    const ProgramResult result = runProgram({"advise", "--scans", path(name + "/scans"), "--poses",
                                             path(name + "/poses.txt"), "--out", path(name + ".toml")});
    ASSERT_EQ(result.exit_code, 0) << result.err;
    const std::string toml = readText(name + ".toml");
    // A thousand flat pieces of 50 points each tell sigma to a few per cent; pieces that reach over an edge add to it.
    const double found_m = valueOf(toml, "range-noise");
    EXPECT_NEAR(found_m, noise_m, 0.1 * noise_m) << toml;
    const double voxel_m = valueOf(toml, "voxel");
    EXPECT_GE(voxel_m, found_m);
    EXPECT_NEAR(valueOf(toml, "tau"), std::max(4 * voxel_m, 5 * found_m), 1e-9);
    EXPECT_NE(toml.find("# Standard deviation of the ranges"), std::string::npos);
    EXPECT_NE(toml.find("m x"), std::string::npos);

    const ProgramResult mapped = runProgram({"map", "--config", path(name + ".toml"), "--tool", "builtin:pruner",
                                             "--device", "cpu", "--out", path(name + "_out")});
    ASSERT_EQ(mapped.exit_code, 0) << mapped.err;
    const auto parameters = nlohmann::json::parse(readText(name + "_out/report.json"))["parameters"];
    EXPECT_EQ(parameters["range_noise_m"], found_m);
    EXPECT_EQ(parameters["voxel_size_m"], voxel_m);
    EXPECT_EQ(parameters["scans"], path(name + "/scans"));
  }
}

TEST_F(Advise, WritesToStandardOutputAndKeepsWhatWasGiven) {
  writeWallScans();
  writePoses();
  const ProgramResult result = runProgram({"advise", "--scans", path("scans"), "--poses", path("poses.txt"), "--every",
                                           "2", "--allow-truncated", "--range-noise", "0.03", "--min-range", "0.5"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(valueOf(result.out, "range-noise"), 0.03);
  EXPECT_EQ(valueOf(result.out, "every"), 2);
  EXPECT_NE(result.out.find("allow-truncated = true"), std::string::npos) << result.out;
  EXPECT_NE(result.out.find("min-range = 0.5"), std::string::npos) << result.out;
  writeText("again.toml", result.out);
  const ProgramResult config = runProgram({"map", "--config", path("again.toml"), "--print-config"});
  EXPECT_EQ(config.exit_code, 0) << config.err;
  EXPECT_NE(config.out.find("every = 2"), std::string::npos) << config.out;
}

// Damaged numbers. As cells of the survey's grids they would not fit in 64 bits.
TEST_F(Advise, ReturnsThatNoScannerMeasuresDoNotCount) {
  std::string near;
  for (int x = -20; x <= 20; ++x)
    for (int y = -20; y <= 20; ++y) near += std::to_string(0.1 * x) + " " + std::to_string(0.1 * y) + " 0\n";
  writeText("near.xyz", near);
  writeText("far.xyz", near + "1e30 0 0\n0 -3e38 1\n0 0 1e9\n-1e19 1e19 0\n");
  const auto adviceFor = [&](const std::string& name) {
    const ProgramResult result = runProgram({"advise", "--scans", path(name), "--sensor-at", "0,0,1"});
    EXPECT_EQ(result.exit_code, 0) << result.err;
    const std::size_t settings = result.out.find("sensor-at = ");
    return result.out.substr(0, result.out.find("scans = ")) +
           result.out.substr(settings, result.out.find("# In one piece") - settings);
  };
  EXPECT_EQ(adviceFor("far.xyz"), adviceFor("near.xyz"));
}

TEST_F(Advise, WrongUseIsOneLine) {
  EXPECT_EQ(runProgram({"advise"}).exit_code, 2);
  EXPECT_EQ(runProgram({"advise", "--scans", path("missing")}).exit_code, 3);
  writeText("empty.xyz", "0 0 0\nnan 1 2\n");
  const ProgramResult result = runProgram({"advise", "--scans", path("empty.xyz"), "--sensor-at", "0,0,0"});
  EXPECT_EQ(result.exit_code, 4);
  EXPECT_NE(result.err.find("error[scans.no_returns]"), std::string::npos) << result.err;
}

}  // namespace
}  // namespace accessvdb::cli_test

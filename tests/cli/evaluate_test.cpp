// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb evaluate as a user sees it: one-line errors, a stop that keeps finished rows.
#include <gtest/gtest.h>

#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "program_run.h"

namespace accessvdb::cli_test {
namespace {

class Evaluate : public ProgramTest {
 protected:
  static void expectError(const ProgramResult& result, int code, const std::string& id, const std::string& words) {
    EXPECT_EQ(result.exit_code, code) << result.err;
    EXPECT_NE(result.err.find("error[" + id + "]"), std::string::npos) << result.err;
    EXPECT_NE(result.err.find(words), std::string::npos) << result.err;
    EXPECT_EQ(result.out, "");
  }
};

TEST_F(Evaluate, WrongUseIsOneLineAndLeavesNothing) {
  expectError(runProgram({"evaluate", "--table", "orakel", "--out", path("out")}), 2, "evaluate.table", "clamping");
  expectError(runProgram({"evaluate", "--out", path("out")}), 2, "usage.missing", "--table");
  expectError(runProgram({"evaluate", "--table", "fast"}), 2, "usage.missing", "--out");
  EXPECT_FALSE(std::filesystem::exists(path("out")));
  writeText("file", "not a folder");
  const ProgramResult result = runProgram({"evaluate", "--table", "fast", "--out", path("file")});
  EXPECT_EQ(result.exit_code, 7) << result.err;
  EXPECT_EQ(readText("file"), "not a folder");
}

TEST_F(Evaluate, HelpNamesEveryTable) {
  const ProgramResult result = runProgram({"evaluate", "--help"});
  EXPECT_EQ(result.exit_code, 0);
  for (const char* table : {"oracle", "voxel", "projective", "clamping", "hpr", "noise", "frames", "directions",
                            "incremental", "unseen", "ring", "unfiltered", "motion", "pine", "fast", "all"}) {
    EXPECT_NE(result.out.find(table), std::string::npos) << table;
  }
}

TEST_F(Evaluate, ConsistencyPredictsItsMemoryBeforeTheWork) {
  writeWallScans();
  writePoses();
  const ProgramResult result =
      runProgram({"evaluate", "--consistency", "--scans", path("scans"), "--poses", path("poses.txt"), "--tool",
                  "builtin:pencil", "--voxel", "0.05", "--device", "cpu", "--out", path("out")});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  const auto predicted = result.err.find("predicted peak memory: "), mapped = result.err.find("even scans");
  ASSERT_NE(predicted, std::string::npos) << result.err;
  EXPECT_LT(predicted, mapped);
  EXPECT_NE(mapped, std::string::npos) << result.err;
}

TEST_F(Evaluate, AStopKeepsTheRowsThatAreDone) {
  ProgramSetup setup;
  setup.arguments = {"evaluate", "--table", "frames", "--no-pictures", "--device", "auto", "--out", path("out")};
  setup.signal_after = "points, F1";  // the first run is done
  setup.act = [](pid_t process) { kill(process, SIGINT); };
  const ProgramResult result = runProgram(setup);
  EXPECT_EQ(result.exit_code, 130) << result.err;
  EXPECT_NE(result.err.find("stopped by SIGINT"), std::string::npos) << result.err;
  const auto tables = nlohmann::json::parse(readText("out/tables.json"));
  EXPECT_EQ(tables["stopped"], true);
  // The device that was used, not the requested one.
  const std::string device = tables["origin"]["device"];
  EXPECT_TRUE(device == "cpu" || device.rfind("cuda:", 0) == 0) << device;
  EXPECT_NE(readText("out/tables.md").find("- device: " + device + "\n"), std::string::npos);
  ASSERT_GE(tables["rows"].size(), 1u);
  EXPECT_LT(tables["rows"].size(), 8u);
  EXPECT_EQ(tables["rows"][0]["table"], "frames");
  EXPECT_GT(tables["rows"][0]["n"], 10000);
  EXPECT_NE(readText("out/tables.md").find("| torus | 2 mm | 1000 frames |"), std::string::npos);
}

}  // namespace
}  // namespace accessvdb::cli_test

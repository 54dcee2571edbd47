// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb-lab evaluate as a user sees it: one-line errors, a stop that keeps finished rows.
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
  expectError(runLab({"evaluate", "--table", "orakel", "--out", path("out")}), 2, "evaluate.table", "clamping");
  expectError(runLab({"evaluate", "--out", path("out")}), 2, "usage.missing", "--table");
  expectError(runLab({"evaluate", "--table", "fast"}), 2, "usage.missing", "--out");
  EXPECT_FALSE(std::filesystem::exists(path("out")));
  writeText("file", "not a folder");
  const ProgramResult result = runLab({"evaluate", "--table", "fast", "--out", path("file")});
  EXPECT_EQ(result.exit_code, 7) << result.err;
  EXPECT_EQ(readText("file"), "not a folder");
}

TEST_F(Evaluate, HelpNamesEveryTable) {
  const ProgramResult result = runLab({"evaluate", "--help"});
  EXPECT_EQ(result.exit_code, 0);
  for (const char* table : {"oracle", "voxel", "projective", "clamping", "hpr", "noise", "frames", "directions",
                            "incremental", "unseen", "ring", "unfiltered", "motion", "pine", "fast", "all"}) {
    EXPECT_NE(result.out.find(table), std::string::npos) << table;
  }
}

TEST_F(Evaluate, AStopKeepsTheRowsThatAreDone) {
  ProgramSetup setup;
  setup.lab = true;
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

/// A run of an earlier version, when evaluate was a verb of accessvdb.
TEST_F(Evaluate, TablesOfEarlierVersionsAreReplaced) {
  ProgramSetup setup;
  setup.lab = true;
  setup.arguments = {"evaluate", "--table", "frames", "--no-pictures", "--out", path("out")};
  writeText("out/tables.md", "# Tables\n\n- command: some evaluate --table frames\n");
  EXPECT_EQ(runProgram(setup).exit_code, 7);
  writeText("out/tables.md", "# Tables\n\n- command: accessvdb evaluate --table frames\n");
  setup.signal_after = "accessvdb: ";  // the work has begun
  setup.act = [](pid_t process) { kill(process, SIGINT); };
  const ProgramResult result = runProgram(setup);
  EXPECT_EQ(result.exit_code, 130) << result.err;
}

}  // namespace
}  // namespace accessvdb::cli_test

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb-lab evaluate --pseudo-truth as a user sees it.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "program_run.h"

namespace accessvdb::cli_test {
namespace {

class PseudoTruthVerb : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    writeWallScans();
    writePoses();
  }
  [[nodiscard]] std::vector<std::string> arguments(const std::string& scans,
                                                   const std::vector<std::string>& more) const {
    std::vector<std::string> all = {"evaluate", "--pseudo-truth", path(scans), "--tool", "builtin:pruner", "--voxel",
                                    "0.05",     "--device",       "cpu",       "--out",  path("out")};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }
  void expectRefusal(const std::vector<std::string>& all, int code, const std::string& id) const {
    const ProgramResult result = runLab(all);
    EXPECT_EQ(result.exit_code, code) << result.err;
    EXPECT_NE(result.err.find("error[" + id + "]"), std::string::npos) << result.err;
    const auto error = result.err.find("error[");
    EXPECT_EQ(std::count(result.err.begin() + static_cast<std::ptrdiff_t>(error), result.err.end(), '\n'), 1)
        << result.err;
    EXPECT_FALSE(std::filesystem::exists(path("out")));
  }
};

TEST_F(PseudoTruthVerb, WritesARowForEachDensity) {
  const ProgramResult result =
      runLab(arguments("scans", {"--poses", path("poses.txt"), "--densities", "1,0.5", "--range-noise", "0.01"}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const auto tables = nlohmann::json::parse(readText("out/tables.json"));
  ASSERT_EQ(tables["rows"].size(), 2u);
  for (const auto& row : tables["rows"]) {
    EXPECT_EQ(row["table"], "pseudo_truth");
    EXPECT_EQ(row["scene"], "scans");
    EXPECT_GT(row["n"], 0);
    const double judged = row["judged_percent"], no_surface = row["no_surface_percent"],
                 undecided = row["undecided_percent"];
    EXPECT_NEAR(judged + no_surface + undecided, 100, 1e-6);
  }
  EXPECT_EQ(tables["rows"][1]["variant"], "50 % of the sparse half");
  EXPECT_NE(readText("out/tables.md").find("# Evaluation by pseudo ground truth"), std::string::npos);
}

TEST_F(PseudoTruthVerb, WhatCannotBeJudgedIsOneLineAndACode) {
  const std::vector<std::string> poses = {"--poses", path("poses.txt")};
  const auto with = [&](std::vector<std::string> more) {
    more.insert(more.end(), poses.begin(), poses.end());
    return more;
  };
  expectRefusal({"evaluate", "--pseudo-truth", path("scans"), "--out", path("out")}, 2, "usage.missing");
  expectRefusal(arguments("scans", with({"--densities", "0"})), 2, "usage.densities");
  expectRefusal(arguments("scans", with({"--halves", "thirds"})), 2, "usage.word");
  expectRefusal(arguments("scans", with({"--orientations", "sphere:30"})), 2, "usage.orientations");
  expectRefusal(arguments("scans", with(poses)), 2, "usage.poses");
  EXPECT_EQ(runLab(arguments("nowhere", poses)).exit_code, 3);
  expectRefusal(arguments("scans", {"--poses", path("nowhere.txt")}), 3, "input.missing");
  // A single scan has no second half.
  for (const char* name : {"scans/000101.000000.pcd", "scans/000102.000000.pcd", "scans/000103.000000.pcd"}) {
    std::filesystem::remove(path(name));
  }
  expectRefusal(arguments("scans", poses), 4, "pseudo_truth.scans");
  EXPECT_EQ(runLab(arguments("scans", with({"--halves", "returns", "--range-noise", "0.01"}))).exit_code, 0);
}

/// Poses that put every second scan elsewhere: nothing is seen by both halves.
TEST_F(PseudoTruthVerb, HalvesOfDifferentPlacesJudgeNothing) {
  writeText("poses.txt", "100 0 0 0 0 0 0 1\n101 0 0 50 0 0 0 1\n102 0 0.1 0 0 0 0 1\n103 0 0.1 50 0 0 0 1\n");
  expectRefusal(arguments("scans", {"--poses", path("poses.txt")}), 4, "pseudo_truth.nothing");
}

TEST_F(PseudoTruthVerb, HelpSaysWhatItTakes) {
  EXPECT_NE(runLab({"evaluate", "--help"}).out.find("--pseudo-truth"), std::string::npos);
  const std::string help = runLab({"evaluate", "--pseudo-truth", "--help"}).out;
  for (const char* word : {"--pseudo-truth", "--poses", "--halves", "--densities", "--voxel", "--topic"}) {
    EXPECT_NE(help.find(word), std::string::npos) << word << help;
  }
}

}  // namespace
}  // namespace accessvdb::cli_test

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb consistency as a user sees it, by its name and by the one that it had before.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <regex>

#include "program_run.h"

namespace accessvdb::cli_test {
namespace {

class ConsistencyVerb : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    writeWallScans();
    writePoses();
  }
  ProgramResult run(std::vector<std::string> arguments, const std::string& out) const {
    const std::vector<std::string> more = {"--scans",        path("scans"), "--poses", path("poses.txt"), "--tool",
                                           "builtin:pencil", "--voxel",     "0.05",    "--device",        "cpu",
                                           "--out",          path(out)};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return runProgram(arguments);
  }
};

TEST_F(ConsistencyVerb, PredictsItsMemoryBeforeTheWork) {
  const ProgramResult result = run({"consistency"}, "out");
  EXPECT_EQ(result.exit_code, 0) << result.err;
  const auto predicted = result.err.find("predicted peak memory: "), mapped = result.err.find("even scans");
  ASSERT_NE(predicted, std::string::npos) << result.err;
  EXPECT_LT(predicted, mapped);
  EXPECT_NE(mapped, std::string::npos) << result.err;
}

TEST_F(ConsistencyVerb, HasTheSameResultsByItsOldName) {
  ASSERT_EQ(run({"consistency"}, "out").exit_code, 0);
  ASSERT_EQ(run({"evaluate", "--consistency"}, "old").exit_code, 0);
  auto now = nlohmann::ordered_json::parse(readText("out/consistency.json"));
  auto old = nlohmann::ordered_json::parse(readText("old/consistency.json"));
  EXPECT_EQ(now["command"].get<std::string>().rfind("accessvdb consistency --scans ", 0), 0u) << now["command"];
  EXPECT_EQ(old["command"].get<std::string>().rfind("accessvdb evaluate --consistency --scans ", 0), 0u)
      << old["command"];
  EXPECT_GT(now["comparisons"][0]["compared"], 0);
  for (auto* results : {&now, &old}) {
    results->erase("command");
    for (const char* part : {"even", "odd", "all"}) (*results)["maps"][part].erase("seconds");
  }
  EXPECT_EQ(now.dump(), old.dump());
  const std::regex command("`accessvdb [^`]*`");
  const auto markdown = [&](const char* name) { return std::regex_replace(readText(name), command, ""); };
  EXPECT_EQ(markdown("out/consistency.md"), markdown("old/consistency.md"));
  EXPECT_NE(runProgram({"evaluate", "--consistency", "--help"}).out.find("accessvdb evaluate --consistency --scans"),
            std::string::npos);
  const std::string help = runProgram({"consistency", "--help"}).out;
  EXPECT_NE(help.find("accessvdb consistency --scans"), std::string::npos) << help;
  EXPECT_EQ(help.find("--consistency"), std::string::npos) << help;
}

}  // namespace
}  // namespace accessvdb::cli_test

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Help, configuration files and the forms of output that every verb shares.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "program_run.h"

namespace accessvdb::cli_test {
namespace {

using CommandLine = ProgramTest;

TEST_F(CommandLine, EveryVerbHelpsWithAnExample) {
  for (const std::string verb : {"map", "info", "query", "diff", "render", "report"}) {
    const ProgramResult result = runProgram({verb, "--help"});
    EXPECT_EQ(result.exit_code, 0) << verb;
    EXPECT_NE(result.out.find("Example:\n  accessvdb " + verb), std::string::npos) << result.out;
    for (const char* flag : {"--device", "--threads", "--config", "--quiet", "--error-format"}) {
      EXPECT_NE(result.out.find(flag), std::string::npos) << verb << " " << flag;
    }
    EXPECT_EQ(result.err, "");
  }
  const ProgramResult overview = runProgram({"--help"});
  EXPECT_EQ(overview.exit_code, 0);
  for (const char* verb : {"map", "info", "query", "diff", "render", "report"})
    EXPECT_NE(overview.out.find(verb), std::string::npos);
}

/// One file of settings serves all verbs of both programs.
TEST_F(CommandLine, SettingsMayBeForAnyVerb) {
  std::vector<std::string> verbs;
  for (const std::string& overview : {runProgram({"--help"}).out, runLab({"--help"}).out}) {
    std::istringstream lines(overview.substr(overview.find("Verbs:\n") + 7));
    for (std::string line; std::getline(lines, line) && line.starts_with("  ");) {
      verbs.push_back(line.substr(2, line.find(' ', 2) - 2));
    }
  }
  EXPECT_GT(verbs.size(), 12u);
  verbs.push_back("evaluate");  // the old spelling of consistency
  for (const std::string& verb : verbs) {
    writeText("config.toml", "[" + verb + "]\n");
    const ProgramResult result = runProgram({"map", "--config", path("config.toml"), "--print-config"});
    EXPECT_EQ(result.exit_code, 0) << verb << ": " << result.err;
  }
  writeText("config.toml", "[no_verb]\n");
  EXPECT_EQ(runProgram({"map", "--config", path("config.toml"), "--print-config"}).exit_code, 2);
}

/// A variable of the shell that is not set takes no limit away, and leaves no file out.
TEST_F(CommandLine, AFlagWithAnEmptyTextIsRefused) {
  for (const char* flag : {"--max-memory", "--tau", "--crs", "--config", "--poses", "--tool", "--voxel", "--carry"}) {
    SCOPED_TRACE(flag);
    const ProgramResult result = runProgram({"map", "--scans", path("scans"), flag, ""});
    EXPECT_EQ(result.exit_code, 2);
    EXPECT_NE(result.err.find("error[usage.option] map"), std::string::npos) << result.err;
    EXPECT_NE(result.err.find(flag), std::string::npos) << result.err;
    EXPECT_EQ(result.err.find('\n'), result.err.size() - 1);
    const ProgramResult equals = runProgram({"map", flag + std::string("="), "--fresh", "--print-config"});
    EXPECT_EQ(equals.exit_code, 2);
    EXPECT_NE(equals.err.find(flag + std::string(" is given an empty text")), std::string::npos) << equals.err;
    if (flag == std::string("--config")) continue;
    writeText("config.toml", std::string(flag + 2) + " = ''\n");
    const ProgramResult config = runProgram({"map", "--config", path("config.toml"), "--print-config"});
    EXPECT_EQ(config.exit_code, 2);
    EXPECT_NE(config.err.find("error[config.value]"), std::string::npos) << config.err;
  }
  for (const char* list : {"tool = ['builtin:pencil', '']", "tool = ['', 'builtin:pencil']", "remove = ['']"}) {
    SCOPED_TRACE(list);
    writeText("config.toml", list);
    const ProgramResult config = runProgram({"map", "--config", path("config.toml"), "--print-config"});
    EXPECT_EQ(config.exit_code, 2);
    EXPECT_NE(config.err.find("error[config.value]"), std::string::npos) << config.err;
  }
  const ProgramResult place = runProgram({"tile", "run", ""});
  EXPECT_EQ(place.exit_code, 2);
  EXPECT_NE(place.err.find("OUT is given an empty text"), std::string::npos) << place.err;
  EXPECT_NE(runProgram({"map", "--voxel", "0.005", "--print-config"}).out.find("at most 20 GB of values"),
            std::string::npos);
}

/// Each flag has the heading that it has in every other verb.
TEST_F(CommandLine, HelpOfManyFlagsHasHeadings) {
  constexpr std::array<std::string_view, 7> kOrder = {
      "Input:", "Tool:", "World:", "Output:", "Expert:", "Run:", "Example:"};
  std::map<std::string, std::string> heading_of;
  for (std::vector<std::string> verb :
       {std::vector<std::string>{"map"}, {"live"}, {"tile", "plan"}, {"consistency"}, {"advise"}}) {
    verb.push_back("--help");
    const ProgramResult result = runProgram(verb);
    if (result.exit_code != 0) continue;  // a build without live
    std::vector<std::string> headings;
    std::istringstream lines(result.out);
    for (std::string line; std::getline(lines, line);) {
      if (std::ranges::find(kOrder, line) != kOrder.end()) headings.push_back(line);
      if (!line.starts_with("  --")) continue;
      ASSERT_FALSE(headings.empty()) << line;
      const std::string flag = line.substr(2, line.find_first_of(" =,", 2) - 2);
      EXPECT_EQ(heading_of.emplace(flag, headings.back()).first->second, headings.back())
          << verb.front() << " " << flag;
    }
    EXPECT_TRUE(std::ranges::is_sorted(headings, {}, [&](const std::string& heading) {
      return std::ranges::find(kOrder, heading) - kOrder.begin();
    })) << result.out;
  }
  EXPECT_GT(heading_of.size(), 80u);
  EXPECT_EQ(heading_of["--scans"], "Input:");
  EXPECT_EQ(heading_of["--tool-unit"], "Tool:");
  EXPECT_EQ(heading_of["--voxel"], "World:");
  EXPECT_EQ(heading_of["--html"], "Output:");
  EXPECT_EQ(heading_of["--policy"], "Expert:");
  EXPECT_EQ(heading_of["--threads"], "Run:");
}

TEST_F(CommandLine, MapHasEveryDocumentedFlag) {
  const std::string help = runProgram({"map", "--help"}).out;
  for (const char* flag : {"--scans",
                           "--poses",
                           "--tool",
                           "--tool-unit",
                           "--tool-tip",
                           "--tool-axis",
                           "--tool-up",
                           "--voxel",
                           "--out",
                           "--pose-format",
                           "--calib",
                           "--sensor-at",
                           "--max-range",
                           "--min-range",
                           "--every",
                           "--change",
                           "--static",
                           "--profile",
                           "--policy",
                           "--directions",
                           "--tau",
                           "--knn",
                           "--points",
                           "--point-spacing",
                           "--range-noise",
                           "--corridor",
                           "--allow-truncated",
                           "--sort-poses",
                           "--max-memory",
                           "--no-clobber",
                           "--update-every",
                           "--view",
                           "--print-config",
                           "--mirror-distance",
                           "--host-fusion",
                           "--max-device-memory",
                           "--checkpoint",
                           "--checkpoint-every",
                           "--resume",
                           "--trajectory",
                           "--time-offset",
                           "--max-gap",
                           "--match",
                           "--stations",
                           "--laz-command",
                           "--topic",
                           "--pose-topic",
                           "--fixed-frame",
                           "--extrinsic",
                           "--exclude-box",
                           "--deskew",
                           "--level",
                           "--ray",
                           "--tiles",
                           "--bin-memory",
                           "--keep-rays",
                           "--fresh",
                           "--origin",
                           "--points-format"}) {
    EXPECT_NE(help.find(flag), std::string::npos) << flag;
  }
}

TEST_F(CommandLine, PrintedConfigReadsBackAsItself) {
  const ProgramResult first = runProgram({"map",
                                          "--voxel",
                                          "0.02",
                                          "--tau",
                                          "4v",
                                          "--tool",
                                          "a \"quoted\" tool.obj",
                                          "--tool-tip",
                                          "-0.1,0,2e-3",
                                          "--no-clobber",
                                          "--max-range",
                                          "30",
                                          "--directions",
                                          "36",
                                          "--max-memory",
                                          "2G",
                                          "--max-device-memory",
                                          "500M",
                                          "--host-fusion",
                                          "--time-offset",
                                          "1356566399.123456",
                                          "--laz-command",
                                          "my decoder -x",
                                          "--topic",
                                          "/livox/lidar",
                                          "--extrinsic",
                                          "-0.1,0,0.05,0,90,-45",
                                          "--print-config"});
  ASSERT_EQ(first.exit_code, 0) << first.err;
  EXPECT_NE(first.out.find("tau = "), std::string::npos);
  writeText("config.toml", first.out);
  const ProgramResult second = runProgram({"map", "--config", path("config.toml"), "--print-config"});
  ASSERT_EQ(second.exit_code, 0) << second.err;
  EXPECT_EQ(first.out, second.out);
  const ProgramResult other = runProgram({"map", "--config", path("config.toml"), "--voxel", "0.04", "--print-config"});
  ASSERT_EQ(other.exit_code, 0) << other.err;
  EXPECT_NE(other.out.find("voxel = 0.04"), std::string::npos) << "a flag wins over the file";
  EXPECT_NE(other.out.find("directions = 36"), std::string::npos);
  EXPECT_NE(other.out.find("host-fusion = true"), std::string::npos);
  EXPECT_NE(other.out.find("max-device-memory = '500M'"), std::string::npos);
}

TEST_F(CommandLine, ConfigTakesTopLevelKeysAndVectors) {
  writeText("config.toml",
            "voxel = 0.03\ntool-tip = [-1.5, 0, 2]\n[map]\nvoxel = 0.05\nquiet = true\n[query]\nat = \"1,2,3\"\n");
  const ProgramResult result = runProgram({"map", "--config", path("config.toml"), "--print-config"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.out.find("voxel = 0.05"), std::string::npos) << "[map] wins over the top level";
  EXPECT_NE(result.out.find("tool-tip = '-1.5,0,2'"), std::string::npos) << result.out;
  EXPECT_NE(result.out.find("quiet = true"), std::string::npos);
}

TEST_F(CommandLine, ErrorsCanBeJson) {
  const ProgramResult result = runProgram({"map", "--error-format", "json"});
  EXPECT_EQ(result.exit_code, 2);
  const auto error = nlohmann::json::parse(result.err);
  EXPECT_EQ(error.at("level"), "error");
  EXPECT_EQ(error.at("id"), "usage.missing");
  EXPECT_EQ(error.at("exit_code"), 2);
  EXPECT_EQ(error.at("subject"), "--scans");
  EXPECT_NE(error.at("problem"), "");
  EXPECT_NE(error.at("advice"), "");
}

TEST_F(CommandLine, FullStandardOutputIsAnOutputFailure) {
  ProgramSetup setup;
  setup.arguments = {"--help"};
  setup.stdout_path = "/dev/full";
  const ProgramResult result = runProgram(setup);
  EXPECT_EQ(result.exit_code, 7);
  EXPECT_NE(result.err.find("accessvdb: error[output.stdout]"), std::string::npos) << result.err;
}

TEST_F(CommandLine, ControlBytesOfArgumentsAreEscaped) {
  const ProgramResult result = runProgram({"\x1b[31mred"});
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_EQ(result.err.find('\x1b'), std::string::npos);
  EXPECT_NE(result.err.find("\\x1b[31mred"), std::string::npos) << result.err;
}

}  // namespace
}  // namespace accessvdb::cli_test

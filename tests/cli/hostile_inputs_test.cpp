// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Inputs that no honest user would write: each ends with a documented code and one line, never with a signal.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "program_run.h"

namespace accessvdb::cli_test {
namespace {

class HostileInputs : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    writeWallScans();
    writePoses();
  }

  static void expectRefused(const ProgramResult& result, int code, const std::string& id) {
    EXPECT_EQ(result.signal, 0) << result.err;
    EXPECT_EQ(result.exit_code, code) << result.err;
    EXPECT_NE(result.err.find("error[" + id + "]"), std::string::npos) << result.err;
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
  }

  /// The flags of a run without numbers.
  [[nodiscard]] std::vector<std::string> arguments(const std::vector<std::string>& more) const {
    std::vector<std::string> all = {"map",    "--scans",        path("scans"), "--poses",  path("poses.txt"),
                                    "--tool", "builtin:pruner", "--out",       path("out")};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }

  static std::string repeated(const std::string& text, int times) {
    std::string all;
    for (int n = 0; n < times; ++n) all += text;
    return all;
  }
};

TEST_F(HostileInputs, NumbersAreDecimal) {
  for (const char* flag : {"--min-range", "--max-range", "--range-noise", "--time-offset", "--corridor", "--every",
                           "--directions", "--knn", "--width", "--update-every"}) {
    SCOPED_TRACE(flag);
    expectRefused(runProgram(arguments({std::string(flag) + "=0x10"})), 2, "usage.option");
  }
  for (const char* flag : {"--voxel", "--threads"}) {
    for (const char* text : {"0x1p-3", "0x10", "0b1", " 1", "1 ", "1e400", "infinity", "INF", "NaN", "nan(1)", "1_0",
                             "", "1,5", "1d", "+-1", ".", "e5", "010"}) {
      SCOPED_TRACE(std::string(flag) + "=" + text);
      expectRefused(runProgram(arguments({std::string(flag) + "=" + text})), 2, "usage.option");
    }
  }
  for (const char* flag : {"--voxel", "--min-range", "--max-range", "--range-noise", "--time-offset", "--corridor"}) {
    SCOPED_TRACE(flag);
    EXPECT_EQ(runProgram(arguments({std::string(flag) + "=nan"})).exit_code, 2);
  }
  // What was always read.
  for (const char* text : {"0.05", "+0.05", ".05", "5e-2", "5E-02", "0.050", "00.05"}) {
    SCOPED_TRACE(text);
    EXPECT_EQ(runProgram(arguments({"--voxel", text})).exit_code, 0);
  }
  writeText("hex.toml", "[map]\nvoxel = inf\n");
  expectRefused(runProgram({"map", "--config", path("hex.toml"), "--scans", path("scans"), "--poses", path("poses.txt"),
                            "--tool", "builtin:pencil", "--out", path("out")}),
                2, "config.range");
}

TEST_F(HostileInputs, PositionsAreNotBeyondTheEarth) {
  for (const char* text :
       {"1e300,0,0,0,0,0", "0,0,0,1e300,0,0", "0,1e9,0", "0,0,nan", "0x1,0,0", "0,0,0,0,0,0,1e300"}) {
    SCOPED_TRACE(text);
    expectRefused(runProgram(mapArguments({"--extrinsic", text})), 2, "usage.numbers");
  }
  expectRefused(runProgram(mapArguments({"--exclude-box", "-1e300,0,0,1,1,1"})), 2, "usage.numbers");
  expectRefused(runProgram(mapArguments({"--remove", "box:0,0,0,1,1,1e300"})), 2, "usage.numbers");
  expectRefused(runProgram(mapArguments({"--level", "1e300,0"})), 2, "usage.numbers");
  expectRefused(runProgram(mapArguments({"--origin", "1e300,0,0"})), 2, "usage.vector");
  expectRefused(runProgram(mapArguments({"--sensor-at", "0,-1e9,0"})), 2, "usage.vector");
  expectRefused(runProgram(mapArguments({"--ray", "0,0,-1e300"})), 2, "usage.vector");
  expectRefused(runProgram(mapArguments({"--view", "1e300,0,1e300"})), 2, "usage.vector");
}

/// The parser of TOML walks tables recursively, and only counts arrays and inline tables itself.
TEST_F(HostileInputs, ConfigurationsThatNest) {
  constexpr int kDeep = 100'000;
  const std::string dots = repeated("a.", kDeep) + "a";
  std::string spread;  // each of 250 nested tables has a key of many parts
  for (int n = 0; n < 250; ++n) spread += repeated("a.", 400) + "a = [\n{ ";
  const std::string files[] = {dots + " = 1\n",
                               "[" + dots + "]\n",
                               "[[" + dots + "]]\n",
                               "[map]\n" + repeated("\"a\" . ", kDeep) + "a = 1\n",
                               "x = { " + dots + " = 1 }\n",
                               "x = [\n'''\n\"''', { " + dots + " = 1 } ]\n",
                               spread,
                               "x = " + repeated("[", kDeep) + repeated("]", kDeep) + "\n",
                               "x = " + repeated("{ a = ", kDeep) + "1" + repeated(" }", kDeep) + "\n",
                               std::string(kDeep, 'k') + " = 1\n",
                               repeated("a.", 9000) + "a = 1\n",
                               "x = \"" + std::string(kDeep, 'v') + "\"\n"};
  for (std::size_t n = 0; n < std::size(files); ++n) {
    SCOPED_TRACE(n);
    writeText("x.toml", files[n]);
    const ProgramResult result = runProgram(mapArguments({"--config", path("x.toml")}));
    EXPECT_EQ(result.signal, 0);
    EXPECT_EQ(result.exit_code, 2) << result.err.substr(0, 500);
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err.substr(0, 500);
    EXPECT_LT(result.err.size(), 4000u);
  }
}

TEST_F(HostileInputs, TextThatIsNotUtf8) {
  ASSERT_EQ(runProgram(mapArguments({"--quiet"})).exit_code, 0);
  std::filesystem::copy(path("out"), path("after"), std::filesystem::copy_options::recursive);
  std::string points = readText("after/points.ply");
  const std::size_t comment = points.find("comment voxel_size_m");
  ASSERT_NE(comment, std::string::npos);
  writeText("after/points.ply", points.insert(comment, "comment odd\xff\xfe \xc3(\x80\n"));
  const ProgramResult diff = runProgram({"diff", path("out"), path("after"), "--json", "--allow-changed"});
  EXPECT_EQ(diff.exit_code, 0) << diff.err;
  EXPECT_TRUE(nlohmann::json::accept(diff.out)) << diff.out;
  const ProgramResult written =
      runProgram({"diff", path("out"), path("after"), "--out", path("changes"), "--allow-changed"});
  EXPECT_EQ(written.exit_code, 0) << written.err;
  EXPECT_TRUE(nlohmann::json::accept(readText("changes/diff.json")));

  // Names of files go into reports and errors.
  std::filesystem::rename(path("scans"), path("sc\xff"
                                              "ans"));
  const auto named = [this](const std::string& scans) {
    return std::vector<std::string>{"map",    "--scans",        path(scans), "--poses",   path("poses.txt"),
                                    "--tool", "builtin:pencil", "--out",     path("odd"), "--voxel",
                                    "0.01"};
  };
  ASSERT_EQ(runProgram(named("sc\xff"
                             "ans"))
                .exit_code,
            0);
  EXPECT_TRUE(nlohmann::json::accept(readText("odd/report.json")));
  const ProgramResult info = runProgram({"info", path("odd"), "--json"});
  EXPECT_EQ(info.exit_code, 0) << info.err;
  EXPECT_TRUE(nlohmann::json::accept(info.out));
  // A plan has to find its scans again: no replacement will do.
  std::vector<std::string> plan = named(
      "sc\xff"
      "ans");
  plan.erase(plan.begin());
  plan.insert(plan.begin(), {"tile", "plan", path("tiled")});
  const auto out = std::find(plan.begin(), plan.end(), "--out");
  plan.erase(out, out + 2);
  plan.push_back("--quiet");
  expectRefused(runProgram(plan), 4, "plan.name");
  std::vector<std::string> missing = named("\xff");
  missing.push_back("--error-format=json");
  const ProgramResult error = runProgram(missing);
  EXPECT_EQ(error.exit_code, 3) << error.err;
  EXPECT_TRUE(nlohmann::json::accept(error.err)) << error.err;
}

/// Libraries abort where they cannot start threads, some of them before main().
TEST_F(HostileInputs, WhereNoThreadCanBeStarted) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "sanitizers have to be loaded before any other library, and to start before the check";
#endif
  setenv("LD_PRELOAD", ACCESSVDB_FEW_THREADS, 1);
  for (int most = 0; most <= 12; ++most) {
    SCOPED_TRACE(most);
    setenv("ACCESSVDB_TEST_THREADS", std::to_string(most).c_str(), 1);
    const ProgramResult text = runProgram(mapArguments({"--quiet"}));
    const ProgramResult json = runProgram(mapArguments({"--quiet", "--error-format", "json"}));
    EXPECT_EQ(text.exit_code, json.exit_code) << text.err << json.err;
    if (most < 4 || text.exit_code != 0) {
      expectRefused(text, 5, "limit.threads");
      const auto error = nlohmann::json::parse(json.err, nullptr, false);
      EXPECT_EQ(error.value("id", ""), "limit.threads") << json.err;
      EXPECT_EQ(error.value("exit_code", 0), 5) << json.err;
    }
  }
  unsetenv("ACCESSVDB_TEST_THREADS");
  EXPECT_EQ(runProgram(mapArguments({"--quiet"})).exit_code, 0);
  unsetenv("LD_PRELOAD");
}

/// The library names its parameters, the program its flags.
TEST_F(HostileInputs, MessagesNameFlags) {
  const std::vector<std::string> cases[] = {
      {"--voxel", "20"},        {"--range-noise", "11"}, {"--tau", "1000v"},     {"--min-range", "-1"},
      {"--directions", "1000"}, {"--rolls", "65"},       {"--corridor", "1000"}, {"--knn", "1000"},
      {"--threads", "70000"},   {"--threads", "-1"},     {"--points", "some"},   {"--point-spacing", "0.02"}};
  for (const auto& flags : cases) {
    SCOPED_TRACE(flags[0] + " " + flags[1]);
    const ProgramResult result = runProgram(arguments({flags[0] + "=" + flags[1]}));
    EXPECT_EQ(result.exit_code, 2);
    EXPECT_NE(result.err.find("] " + flags[0] + ": "), std::string::npos) << result.err;
    for (const char* name : {"_m:", "_m ", "num_", "neighbours", "Policy::", "Mode::"}) {
      EXPECT_EQ(result.err.find(name), std::string::npos) << result.err;
    }
  }
}

/// So do the readers of scans and tools, whatever they say and where: subject, problem, advice, warning or notice.
TEST_F(HostileInputs, MessagesAboutFilesNameFlags) {
  writeBoxTool(0.9, 0.1);
  writeText("far.obj", "v 9 9 9\nv 10 9 9\nv 9 10 9\nv 9 9 10\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n");
  writeText("short.pcd", readText("scans/000100.000000.pcd").substr(0, 20'000));
  writeText("stairs.txt", "101 0 0 0 0 0 0 1\n100 0 0 0 0 0 0 1\n");
  struct Case {
    std::vector<std::string> flags;
    int code;
    const char* said;
  };
  const std::vector<Case> cases = {
      {{"--every", "0"}, 2, "] --every: must be"},
      {{"--ray", "0,0,-1"}, 2, "] --ray: excludes --poses, --sensor-at, --trajectory, --stations and --calib."},
      {{"--level", "imu"}, 2, "] --level imu: is for recordings (.mcap, .db3, .bag). Use --level ROLL,PITCH"},
      {{"--topic", "/points"}, 2, "] --topic: is for recordings"},
      {{"--trajectory", path("poses.txt")}, 2, "] --trajectory: excludes --poses"},
      {{"--deskew", "on"}, 4, "as --deskew on asks"},
      {{"--deskew", "off"}, 0, "motion within a scan is not removed: --deskew off"},
      {{"--extrinsic", "0,0,0.1"}, 0, "those of the sensor, by --extrinsic"},
      {{"--poses", path("stairs.txt")}, 4, "Use --sort-poses"},
      {{"--scans", path("short.pcd"), "--sensor-at", "0,0,0", "--poses", ""}, 3, "Use --allow-truncated to keep"},
      {{"--tool", path("tool.obj")}, 2, "Specify it: --tool-unit m, cm, mm or in"},
      {{"--tool", path("tool.obj"), "--tool-unit", "m", "--tool-axis", "0,0,1"}, 0, "--tool-up chooses another"},
      {{"--tool", path("far.obj"), "--tool-unit", "m"}, 0, "unless --tool-tip is set"},
      {{"--tool", path("none.obj"), "--tool-unit", "m"}, 3, "Check the path of --tool"},
      {{"--orientations", "pitch:-90:90:5"}, 5, "(--directions 108)"},
      {{"--remove", "box:1,1,1,0,0,0"}, 2, "] --remove: the corners of a box"}};
  for (const Case& c : cases) {
    SCOPED_TRACE(c.flags[0] + " " + c.flags[1]);
    const ProgramResult result = runProgram(mapArguments(c.flags));
    EXPECT_EQ(result.exit_code, c.code) << result.err;
    EXPECT_NE(result.err.find(c.said), std::string::npos) << result.err;
    for (const char* name : {"::", "_m:", "_m ", "_W ", "_W:", "_S ", "T_B_S", "allow_", "sort_", "LengthUnit"}) {
      EXPECT_EQ(result.err.find(name), std::string::npos) << name << " in " << result.err;
    }
  }
  // The voxel that is proposed has another truncation distance.
  const ProgramResult hidden = runProgram(arguments({"--voxel", "5", "--quiet"}));
  expectRefused(hidden, 4, "tool.hidden");
  EXPECT_NE(hidden.err.find("Use --voxel 0.2 or smaller"), std::string::npos) << hidden.err;
  ProgramSetup small;
  small.arguments = mapArguments({"--quiet"});
  small.file_size_limit = 1000;
  const ProgramResult large = runProgram(small);
  EXPECT_EQ(large.exit_code, 7);
  EXPECT_NE(large.err.find("or choose another --out folder."), std::string::npos) << large.err;
  // Names of files are no parameters.
  const ProgramResult missing = runProgram(mapArguments({"--tool", path("view_W/ray_W.obj"), "--tool-unit", "m"}));
  EXPECT_NE(missing.err.find("view_W/ray_W.obj: "), std::string::npos) << missing.err;
}

}  // namespace
}  // namespace accessvdb::cli_test

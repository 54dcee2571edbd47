// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Tools that are broken, or that vanish at the voxel size: never a point more accessible, and refused where labels
/// would say little.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>
#include <tuple>

#include "accessvdb/field_io.h"
#include "program_run.h"

namespace accessvdb::cli_test {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using Flags = std::vector<std::string>;

class DoubtfulTools : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    writeWallScans();
    writePoses();
  }
  [[nodiscard]] Flags allBut(const std::string& flag, const Flags& more = {}) const {
    Flags arguments = mapArguments(more);
    std::erase(arguments, flag);
    return arguments;
  }
  void expectRefused(const Flags& arguments, const std::string& id) const {
    const ProgramResult result = runProgram(arguments);
    EXPECT_EQ(result.exit_code, 4) << result.err;
    EXPECT_NE(result.err.find("error[" + id + "]"), std::string::npos) << result.err;
  }
  [[nodiscard]] bool warned(const std::string& out, const std::string& id) const {
    const Json report = Json::parse(readText(out + "/report.json"));
    const auto& warnings = report.at("warnings");
    return std::any_of(warnings.begin(), warnings.end(), [&](const Json& warning) { return warning.at("id") == id; });
  }
  using Place = std::tuple<double, double, double>;
  [[nodiscard]] std::map<Place, PointLabel> labelsOf(const std::string& out) const {
    std::map<Place, PointLabel> labels;
    for (const SurfacePoint& point : io::readPointsPly(path(out + "/points.ply")).points) {
      labels[{point.position_W.x(), point.position_W.y(), point.position_W.z()}] = point.label;
    }
    return labels;
  }
  /// Without the last triangles of writeBoxTool().
  void writeOpenBox(double length, double width, int missing) const {
    writeBoxTool(length, width);
    std::istringstream lines(readText("tool.obj"));
    std::vector<std::string> all;
    for (std::string line; std::getline(lines, line);) all.push_back(line);
    std::string text;
    for (std::size_t n = 0; n + static_cast<std::size_t>(missing) < all.size(); ++n) text += all[n] + "\n";
    writeText("tool.obj", text);
  }
};

TEST_F(DoubtfulTools, NoPointIsMoreAccessibleWithABrokenToolThanWithTheWholeOne) {
  const char* given = std::getenv("ACCESSVDB_TEST_DATA");
  const fs::path data =
      fs::path(given != nullptr ? given : ACCESSVDB_SOURCE_DIR "/../shared/data") / "hostile" / "open_tool";
  if (!fs::exists(data)) GTEST_SKIP() << "no test data: " << data;
  const auto mapWith = [&](const std::string& name) {
    const ProgramResult result =
        runProgram({"map", "--scans", (data / "scans").string(), "--poses", (data / "poses.txt").string(), "--tool",
                    (data / (name + ".stl")).string(), "--tool-unit", "m", "--voxel", "0.05", "--range-noise", "0.01",
                    "--device", "cpu", "--out", path(name)});
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return labelsOf(name);
  };
  const auto whole = mapWith("closed");
  EXPECT_EQ(std::count_if(whole.begin(), whole.end(),
                          [](const auto& point) { return point.second == PointLabel::Accessible; }),
            734);
  EXPECT_FALSE(warned("closed", "tool.open"));
  for (const std::string name : {"one_triangle_missing", "crack_0.2mm"}) {
    const auto broken = mapWith(name);
    EXPECT_TRUE(warned(name, "tool.open")) << name;
    ASSERT_EQ(broken.size(), whole.size());
    int accessible = 0;
    for (const auto& [place, label] : broken) {
      if (label != PointLabel::Accessible) continue;
      ++accessible;
      EXPECT_EQ(whole.at(place), PointLabel::Accessible) << name;
    }
    EXPECT_GT(accessible, 0) << name;
  }
}

TEST_F(DoubtfulTools, AnOpeningTooWideIsRefusedUnlessAllowed) {
  writeOpenBox(0.9, 0.4, 2);  // a side of 0.9 x 0.4 m
  const Flags tool = {"--tool", path("tool.obj"), "--tool-unit", "m"};
  expectRefused(mapArguments(tool), "tool.open");
  EXPECT_EQ(listing("out"), std::vector<std::string>{"report.json"});
  Flags plan = mapArguments(tool);
  plan.erase(plan.begin());
  std::erase(plan, "--out");
  std::erase(plan, path("out"));
  plan.insert(plan.begin(), {"tile", "plan", path("planned")});
  expectRefused(plan, "tool.open");
  Flags allowed = tool;
  allowed.emplace_back("--allow-open-tool");
  const ProgramResult result = runProgram(mapArguments(allowed));
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_TRUE(warned("out", "tool.open"));
}

TEST_F(DoubtfulTools, OneThatVanishesIsRefusedUnlessAllowed) {
  const std::string flag = "--allow-hidden-tool";
  expectRefused(allBut(flag), "tool.hidden");
  EXPECT_EQ(listing("out"), std::vector<std::string>{"report.json"});
  expectRefused(allBut(flag, {"--tiles", "6.4"}), "tool.hidden");
  // In any of its orientations, and whichever of the tools it is.
  expectRefused(allBut(flag, {"--orientations", "sphere:30"}), "tool.hidden");
  Flags two = allBut(flag);
  two.insert(two.end(), {"--tool", "builtin:pruner"});
  const ProgramResult of_two = runProgram(two);
  EXPECT_EQ(of_two.exit_code, 4);
  EXPECT_NE(of_two.err.find("builtin:pencil: at a voxel of 0.05 m"), std::string::npos) << of_two.err;
  EXPECT_NE(of_two.err.find("Use --voxel 0.02 or smaller"), std::string::npos) << of_two.err;
  // What is advised works.
  EXPECT_EQ(runProgram(allBut(flag, {"--voxel", "0.02"})).exit_code, 0);

  ASSERT_EQ(runProgram(mapArguments({"--checkpoint", path("state")})).exit_code, 0);
  EXPECT_TRUE(warned("out", "tool.hidden"));
  const Flags what_if = {"whatif",         path("state"), "--tool",
                         "builtin:pencil", "--remove",    "box:1.9,-0.3,-0.3,2.1,0.3,0.3"};
  expectRefused(what_if, "tool.hidden");
  Flags allowed = what_if;
  allowed.push_back(flag);
  EXPECT_EQ(runProgram(allowed).exit_code, 0);
}

TEST_F(DoubtfulTools, AdviseLooksAtTheToolFirst) {
  const auto voxelFor = [&](const std::string& tool) {
    const ProgramResult advice = runProgram(
        {"advise", "--scans", path("scans"), "--poses", path("poses.txt"), "--tool", tool, "--range-noise", "0.03"});
    EXPECT_EQ(advice.exit_code, 0) << advice.err;
    const std::string key = "\nvoxel = ";
    return std::stod(advice.out.substr(advice.out.find(key) + key.size()));
  };
  EXPECT_GE(voxelFor("builtin:pruner"), 0.03);  // by the noise
  EXPECT_EQ(voxelFor("builtin:pencil"), 0.02);
}

TEST_F(DoubtfulTools, ALineEndInAFileNameIsPartOfTheName) {
  writeBoxTool(0.9, 0.1);
  fs::rename(path("tool.obj"), path("two\nlines.obj"));
  const ProgramResult result =
      runProgram(mapArguments({"--tool", path("two\nlines.obj"), "--tool-unit", "m", "--no-clobber"}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const std::string points = readText("out/points.ply");
  EXPECT_NE(points.find("comment tool two\\x0alines.obj\n"), std::string::npos) << points.substr(0, 400);
}

TEST_F(DoubtfulTools, RenderWarnsOfTheUnitToo) {
  writeBoxTool(9, 1);
  const ProgramResult result =
      runProgram({"render", "--tool", path("tool.obj"), "--tool-unit", "m", "--out", path("tool.png")});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.err.find("warning[tool.unit]"), std::string::npos) << result.err;
}

}  // namespace
}  // namespace accessvdb::cli_test

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// `accessvdb whatif` and `map --remove`: the points that a what-if opens are those that the map without the thing has,
/// orders of cuts over boxes and labelled clouds, and every documented refusal.
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

#include "program_run.h"

namespace accessvdb::cli_test {
namespace {

using Json = nlohmann::json;

/// A wall at x = 2 m behind two level bars at x = 1.75 m, in the way of every approach at their heights, seen from
/// above and from below them.
class WhatIfVerb : public ProgramTest {
 protected:
  static constexpr double kBar_m = 1.75;
  static bool onBar(double z) { return std::abs(std::abs(z) - 0.25) < 0.05; }

  void SetUp() override {
    ProgramTest::SetUp();
    std::ostringstream poses;
    for (int scan = 0; scan < 13; ++scan) {
      const double sensor_z = -1.2 + 0.2 * scan;
      std::ostringstream points;
      int count = 0;
      for (double z = -0.6; z < 0.6; z += 0.02) {
        for (double y = -0.4; y < 0.4; y += 0.02, ++count) {
          const double at_bar = sensor_z + (z - sensor_z) * kBar_m / 2;
          const double share = onBar(at_bar) ? kBar_m / 2 : 1;
          points << 2 * share << ' ' << y * share << ' ' << (z - sensor_z) * share << '\n';
          if (share == 1) continue;
          cloud_ << kBar_m << ' ' << y * share << ' ' << at_bar << ' ' << (at_bar < 0 ? 1 : 2) << '\n';
          ++cloud_points_;
        }
      }
      std::ostringstream pcd;
      pcd << "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH " << count
          << "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " << count << "\nDATA ascii\n"
          << points.str();
      char name[64];
      std::snprintf(name, sizeof name, "scans/%06d.000000.pcd", 100 + scan);
      writeText(name, pcd.str());
      poses << 100 + scan << " 0 0 " << sensor_z << " 0 0 0 1\n";
    }
    writeText("poses.txt", poses.str());
    writeBoxTool(0.9, 0.1);
    const ProgramResult mapped = runProgram(mapWith({"--checkpoint", path("state")}));
    ASSERT_EQ(mapped.exit_code, 0) << mapped.err;
  }

  [[nodiscard]] std::vector<std::string> mapWith(const std::vector<std::string>& more) const {
    std::vector<std::string> flags = {"--tool", path("tool.obj"), "--tool-unit", "m"};
    flags.insert(flags.end(), more.begin(), more.end());
    return mapArguments(flags);
  }
  [[nodiscard]] ProgramResult ask(const std::vector<std::string>& more) const {
    std::vector<std::string> arguments = {"whatif", path("state"), "--tool", path("tool.obj"), "--tool-unit", "m"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return runProgram(arguments);
  }
  void expectRefused(const std::vector<std::string>& more, int code, const std::string& id) {
    const ProgramResult result = ask(more);
    EXPECT_EQ(result.exit_code, code) << result.err;
    EXPECT_NE(result.err.find("error[" + id + "]"), std::string::npos) << result.err;
    EXPECT_EQ(result.out, "");
  }

  std::ostringstream cloud_;  ///< x y z segment of the bars' returns
  int cloud_points_ = 0;
};

TEST_F(WhatIfVerb, OpensWhatTheMapWithoutTheThingHas) {
  const std::string box = "box:1.6,-1,-0.4,1.9,1,-0.1";
  const ProgramResult asked = ask({"--remove", box, "--json", "--out", path("cut")});
  ASSERT_EQ(asked.exit_code, 0) << asked.err;
  const Json answer = Json::parse(asked.out);
  const auto opens = answer.at("opens").get<std::size_t>();
  EXPECT_GT(opens, 20u);
  EXPECT_EQ(answer.at("points").size(), opens);
  EXPECT_GT(answer.at("points_gone"), 5);
  EXPECT_EQ(Json::parse(readText("cut/whatif.json")).at("opens"), opens);
  EXPECT_NE(readText("cut/whatif.ply").find("element vertex " + std::to_string(opens) + "\n"), std::string::npos);

  const ProgramResult removed =
      runProgram(mapWith({"--out", path("without"), "--remove", box, "--removed-as", "free"}));
  ASSERT_EQ(removed.exit_code, 0) << removed.err;
  const ProgramResult compared = runProgram({"diff", path("out"), path("without"), "--json"});
  ASSERT_EQ(compared.exit_code, 0) << compared.err;
  EXPECT_EQ(Json::parse(compared.out).at("opened"), opens);
  const Json report = Json::parse(readText("without/report.json"));
  ASSERT_EQ(report.at("removed").size(), 1u);
  EXPECT_EQ(report.at("removed")[0].at("as"), "free");
  EXPECT_EQ(report.at("removed")[0].at("points"), answer.at("points_gone"));
  EXPECT_EQ(report.at("counts").at("reasons").at("changed"), answer.at("points_gone"));

  // As unknown, nothing opens; and the run without --remove says nothing of it.
  const ProgramResult unknown = runProgram(mapWith({"--out", path("unknown"), "--remove", box}));
  ASSERT_EQ(unknown.exit_code, 0) << unknown.err;
  EXPECT_EQ(Json::parse(runProgram({"diff", path("out"), path("unknown"), "--json"}).out).at("opened"), 0);
  EXPECT_FALSE(Json::parse(readText("out/report.json")).contains("removed"));
}

TEST_F(WhatIfVerb, OrdersCuts) {
  writeText("boxes.txt",
            "# what could be cut\nair 0.4 0 0, 0.6 0.2 0.2\nfirst 1.6 -1 -0.4 1.9 1 -0.1\n"
            "second, 1.6, -1, 0.1, 1.9, 1, 0.4\n");
  expectRefused({"--segments", path("boxes.txt")}, 4, "region.outside");  // nothing was seen in the air
  writeText("boxes.txt",
            "corner 1.9 0.3 0.5 2.1 0.5 0.7\nfirst 1.6 -1 -0.4 1.9 1 -0.1\nsecond, 1.6, -1, 0.1, 1.9, 1, 0.4\n");
  const ProgramResult boxes = ask({"--segments", path("boxes.txt"), "--json"});
  ASSERT_EQ(boxes.exit_code, 0) << boxes.err;
  const Json by_box = Json::parse(boxes.out);
  ASSERT_EQ(by_box.at("cuts").size(), 2u) << boxes.out;
  EXPECT_EQ(by_box.at("left"), Json({"corner"}));
  const std::size_t first = by_box.at("cuts")[0].at("opens"), second = by_box.at("cuts")[1].at("opens");
  EXPECT_GE(first, second);
  EXPECT_EQ(by_box.at("opens"), first + second);
  EXPECT_NE(ask({"--segments", path("boxes.txt"), "--cuts", "1"}).out.find("1. cut "), std::string::npos);

  writeText("cloud.ply", "ply\nformat ascii 1.0\nelement vertex " + std::to_string(cloud_points_ + 2) +
                             "\nproperty float x\nproperty float y\nproperty float z\nproperty int segment\n"
                             "end_header\n9 9 9 3\n2 0 0 0\n" +
                             cloud_.str());
  const ProgramResult cloud = ask({"--segments", path("cloud.ply"), "--json"});
  ASSERT_EQ(cloud.exit_code, 0) << cloud.err;
  EXPECT_NE(cloud.err.find("2 segments; of " + std::to_string(cloud_points_ + 2) +
                           " points, 1 without a segment and 1 far from every point of the map"),
            std::string::npos)
      << cloud.err;
  const Json by_point = Json::parse(cloud.out);
  EXPECT_EQ(by_point.at("cuts").size(), 2u) << cloud.out;
  EXPECT_GT(by_point.at("opens"), 20);
}

TEST_F(WhatIfVerb, RefusesByName) {
  expectRefused({}, 2, "usage.missing");
  expectRefused({"--remove", "ids:1", "--segments", "x.txt"}, 2, "usage.missing");
  expectRefused({"--remove", "ball:1,2,3"}, 2, "usage.remove");
  expectRefused({"--remove", "ids:1,x"}, 2, "usage.remove");
  expectRefused({"--remove", "ids:"}, 2, "region.empty");
  expectRefused({"--remove", "box:0,0,0,1,1"}, 2, "usage.numbers");
  expectRefused({"--remove", "box:0,0,0,1,nan,1"}, 2, "usage.numbers");
  expectRefused({"--remove", "box:0,0,1,1,1,0"}, 2, "region.box");
  expectRefused({"--remove", "box:50,50,50,51,51,51"}, 4, "region.outside");
  expectRefused({"--remove", "ids:4000000000"}, 4, "region.ids");
  expectRefused({"--remove", "ids:99999999999"}, 2, "usage.remove");
  writeText("open.obj", "v 1 0 0\nv 1 1 0\nv 1 0 1\nv 1.5 0 0\nf 1 2 3\nf 1 2 4\nf 1 3 4\n");
  expectRefused({"--remove", "mesh:" + path("open.obj")}, 4, "region.mesh");
  expectRefused({"--remove", "mesh:" + path("none.obj")}, 3, "input.unreadable");
  writeText("bad.txt", "first 1 2 3\n");
  expectRefused({"--segments", path("bad.txt")}, 3, "input.malformed");
  writeText("bad.txt", "first 1 2 3 4 5 nan\n");
  expectRefused({"--segments", path("bad.txt")}, 3, "input.malformed");
  writeText("bad.txt", "# nothing\n");
  expectRefused({"--segments", path("bad.txt")}, 3, "input.malformed");
  const std::string head =
      "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n";
  writeText("bad.ply", head + "end_header\n1 1 1\n1 1 1\n");
  expectRefused({"--segments", path("bad.ply")}, 3, "input.no_segments");
  writeText("bad.ply", head + "property float segment\nend_header\n1 1 1 1\n1 1 1 1.5\n");
  expectRefused({"--segments", path("bad.ply")}, 3, "input.malformed");
  writeText("bad.ply", head + "property float segment\nend_header\n1 1 1 1\n");
  expectRefused({"--segments", path("bad.ply")}, 3, "input.truncated");
  writeText("bad.ply", head + "property int segment\nend_header\n9 9 9 1\n9 9 9 2\n");
  expectRefused({"--segments", path("bad.ply")}, 4, "segments.none");
  expectRefused({"--remove", "ids:1", "--cuts", "-1"}, 2, "usage.cuts");

  const ProgramResult plain = runProgram({"whatif", path("out"), "--tool", "builtin:pencil", "--remove", "ids:1"});
  EXPECT_EQ(plain.exit_code, 2);
  EXPECT_NE(plain.err.find("Run map with --checkpoint"), std::string::npos) << plain.err;
  const ProgramResult other = runProgram({"whatif", path("state"), "--tool", "builtin:pruner", "--remove", "ids:1"});
  EXPECT_EQ(other.exit_code, 4);
  EXPECT_NE(other.err.find("error[state.tool]"), std::string::npos) << other.err;
  const ProgramResult tiles = runProgram(mapWith({"--out", path("tiles"), "--tiles", "6.4", "--remove", "ids:1"}));
  EXPECT_EQ(tiles.exit_code, 2);
  EXPECT_NE(tiles.err.find("error[usage.tiles]"), std::string::npos) << tiles.err;
  EXPECT_EQ(runProgram(mapWith({"--out", path("as"), "--remove", "ids:1", "--removed-as", "gone"})).exit_code, 2);
}

}  // namespace
}  // namespace accessvdb::cli_test

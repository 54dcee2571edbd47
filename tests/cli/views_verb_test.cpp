// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb views, as a user runs it.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "program_run.h"

namespace accessvdb::cli_test {
namespace {

using nlohmann::json;

class ViewsVerb : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    std::filesystem::create_directories(folder_ / "scans");
    // So few returns of a wall, 17 cm apart, that no voxel has two.
    for (const char* name : {"000100.000000.pcd", "000101.000000.pcd"}) {
      std::string points;
      for (int n = 0; n < 144; ++n)
        points += "2 " + std::to_string(-1 + 0.17 * (n % 12)) + " " + std::to_string(-0.9 + 0.17 * (n / 12)) + "\n";
      writeText(std::string("scans/") + name,
                "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 144\nHEIGHT 1\n"
                "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 144\nDATA ascii\n" +
                    points);
    }
    writePoses(2);
  }
  ProgramResult views(const std::string& state, const std::vector<std::string>& more) {
    const std::vector<std::string> arguments = mapArguments();
    std::vector<std::string> all = {"views",
                                    "--map",
                                    path(state),
                                    "--device",
                                    "cpu",
                                    "--tool",
                                    *(std::find(arguments.begin(), arguments.end(), "--tool") + 1)};
    all.insert(all.end(), more.begin(), more.end());
    return runProgram(all);
  }
  void expectRefused(const std::vector<std::string>& more, int code, const std::string& id, const std::string& word) {
    const ProgramResult result = views("state", more);
    EXPECT_EQ(result.exit_code, code) << result.err;
    EXPECT_NE(result.err.find("error[" + id + "]"), std::string::npos) << result.err;
    EXPECT_NE(result.err.find(word), std::string::npos) << result.err;
  }
};

TEST_F(ViewsVerb, ProposesFromACheckpointWithKnownFreeSpace) {
  const ProgramResult mapped =
      runProgram(mapArguments({"--clear-rays", "all", "--platform-radius", "0.4", "--checkpoint", path("state")}));
  ASSERT_EQ(mapped.exit_code, 0) << mapped.err;
  const ProgramResult found = views("state", {"--body", "0.2", "--most", "2", "--json", "--out", path("views")});
  ASSERT_EQ(found.exit_code, 0) << found.err;
  const json answer = json::parse(found.out);
  EXPECT_GT(answer.at("unresolved_points").at("unknown").get<int>() +
                answer.at("unresolved_points").at("confidence").get<int>() +
                answer.at("unresolved_points").at("unseen").get<int>(),
            0);
  ASSERT_GT(answer.at("views").size(), 0U) << found.out;
  ASSERT_LE(answer.at("views").size(), 2U);
  EXPECT_EQ(listing("views"), (std::vector<std::string>{"views.csv", "views.json", "views.ply"}));
  EXPECT_EQ(readText("views/views.json"), found.out);
  // Written again over our own, and never over what is not.
  EXPECT_EQ(views("state", {"--body", "0.2", "--out", path("views")}).exit_code, 0);
  writeText("views/views.csv", "of the user\n");
  expectRefused({"--body", "0.2", "--out", path("views")}, 7, "output.foreign", "views.csv");
  EXPECT_EQ(readText("views/views.csv"), "of the user\n");

  expectRefused({"--azimuth", "0"}, 2, "views.field_of_view", "--azimuth");
  expectRefused({"--elevation", "52,-7"}, 2, "views.field_of_view", "--elevation");
  expectRefused({"--elevation", "52"}, 2, "usage.numbers", "--elevation");
  expectRefused({"--pitches", "120"}, 2, "views.field_of_view", "--pitches");
  expectRefused({"--rays", "0"}, 2, "views.field_of_view", "--rays");
  expectRefused({"--reach", "-1"}, 2, "views.field_of_view", "--reach");
  expectRefused({"--most", "0"}, 2, "usage.number", "--most");
  expectRefused({"--body", "-1"}, 2, "views.options", "--body");
  expectRefused({"--within", "3"}, 2, "views.options", "--within");
  expectRefused({"--body", "30"}, 4, "views.no_free_space", "--clear-rays");
}

/// Nothing but the band before surfaces is known to be free.
TEST_F(ViewsVerb, SaysWhatToMapWithWhereNothingIsKnownFree) {
  ASSERT_EQ(runProgram(mapArguments({"--checkpoint", path("state")})).exit_code, 0);
  expectRefused({}, 4, "views.no_free_space", "--platform-radius");
}

}  // namespace
}  // namespace accessvdb::cli_test

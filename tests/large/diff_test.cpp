// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// `diff` on folders of either kind. Tiles have the bytes of one piece, so they must differ in nothing, and from a
/// third map in the same points.
#include <nlohmann/json.hpp>

#include "large/tiled_test.h"

namespace accessvdb::large_test {
namespace {

using MapDiff = TiledTest;

TEST_F(MapDiff, TilesAndOnePieceAreTheSame) {
  succeed(map({"--tiles", "off"}, "one"));
  succeed(map({"--tiles", "6.4"}, "tiled"));
  for (const auto& [before, after] : {std::pair{"one", "tiled"}, {"tiled", "one"}, {"tiled", "tiled"}}) {
    const auto diff = nlohmann::json::parse(succeed({"diff", path(before), path(after), "--json", "--quiet"}));
    EXPECT_GT(diff.at("same"), 1000);
    EXPECT_EQ(diff.at("same"), diff.at("points_after"));
    EXPECT_EQ(diff.at("points_before"), diff.at("points_after"));
    for (const char* change : {"opened", "closed", "relabelled", "appeared", "gone"}) EXPECT_EQ(diff.at(change), 0);
  }

  // Fewer scans: some points are missing, others have another label.
  const Flags all = scans_;
  scans_ = plus(scans_, {"--every", "2"});
  succeed(map({"--tiles", "off", "--origin", path("one")}, "less"));
  succeed({"diff", path("less"), path("one"), "--out", path("diff"), "--quiet"});
  succeed({"diff", path("less"), path("tiled"), "--out", path("diff_tiled"), "--quiet"});
  for (const char* file : {"diff.ply", "diff.vdb", "diff.json"}) {
    expectSameFiles(std::string("diff_tiled/") + file, std::string("diff/") + file);
  }
  const auto diff = nlohmann::json::parse(succeed({"diff", path("less"), path("one"), "--json", "--quiet"}));
  const auto back = nlohmann::json::parse(succeed({"diff", path("one"), path("less"), "--json", "--quiet"}));
  EXPECT_EQ(diff.at("match"), "same voxel");
  EXPECT_GT(diff.at("appeared"), 0);
  EXPECT_EQ(diff.at("gone"), back.at("appeared"));
  EXPECT_EQ(diff.at("appeared"), back.at("gone"));
  EXPECT_EQ(diff.at("opened"), back.at("closed"));
}

TEST_F(MapDiff, RefusesWhatCannotBeCompared) {
  succeed(map({"--tiles", "off"}, "one"));
  what_[3] = "0.07";
  succeed(map({"--tiles", "off"}, "coarse"));
  refuse({"diff", path("one"), path("coarse")}, 4, "diff.voxel");
  what_[3] = "0.05";
  what_[1] = "builtin:pruner";
  succeed(plan({"--tiles", "6.4"}, "planned"));
  succeed(map({"--tiles", "off"}, "pruner"));
  refuse({"diff", path("one"), path("pruner")}, 4, "diff.tool");
  refuse({"diff", path("one"), path("nowhere")}, 3, "input.missing");
  refuse({"diff", path("one")}, 2, "usage.missing");
}

}  // namespace
}  // namespace accessvdb::large_test

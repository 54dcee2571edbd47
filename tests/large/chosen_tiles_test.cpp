// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// --tiles auto, the default: one piece where it fits, tiles where it does not, and a refusal before any work where not
/// even the smallest tile fits.
#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "accessvdb/tiles.h"
#include "large/tiled_test.h"
#include "large/walk_scans.h"

namespace accessvdb::large_test {
namespace {

namespace fs = std::filesystem;

class ChosenTiles : public TiledTest {
 protected:
  /// A walk that does not fit where a tile does.
  void walkFar() {
    writeWalk(folder_, {.scans = 14, .rays = 12000});
    what_[1] = "builtin:pruner";
  }
  /// Edge of the tiles that `tile plan` chooses. @return 0 if it refuses for want of memory
  [[nodiscard]] std::int32_t edgeFor(const std::string& limit) const {
    fs::remove_all(path("planned"));
    const ProgramResult result = runProgram(plan({"--max-memory", limit}, "planned"));
    EXPECT_TRUE(result.exit_code == 0 || result.exit_code == 5) << limit << "\n" << result.err;
    EXPECT_EQ(fs::exists(path("planned/plan.json")), result.exit_code == 0);
    return result.exit_code == 0 ? tiles::readPlan(path("planned")).tile_voxels : 0;
  }
};

TEST_F(ChosenTiles, NoneWhereOnePieceFits) {
  succeed(map({"--max-memory", "4G"}));
  EXPECT_FALSE(fs::exists(path("out/plan.json")));
  EXPECT_FALSE(fs::exists(path("out/tiles")));
  succeed(map({"--tiles", "off", "--max-memory", "4G"}, "one"));
  expectSameFiles("out/points.ply", "one/points.ply");
  expectSameFiles("out/field.vdb", "one/field.vdb");
}

TEST_F(ChosenTiles, SomeWhereItDoesNot) {
  walkFar();
  const std::string limit = "270M";
  refuse(map({"--tiles", "off", "--max-memory", limit}, "refused"), 5, "limit.memory");
  succeed(map({"--max-memory", limit}));
  const tiles::Plan plan = tiles::readPlan(path("out"));
  EXPECT_EQ(plan.tile_voxels % 128, 0);
  EXPECT_GE(tilesOf().size(), 4u);
  EXPECT_EQ(nlohmann::json::parse(readText("out/report.json")).at("tiles").at("todo"), 0);
  expectOnePiece();
  expectNoLeftovers();
}

/// With more memory tiles never become smaller.
TEST_F(ChosenTiles, GrowWithTheMemory) {
  walkFar();
  std::int32_t before = 0;
  for (const char* limit : {"255M", "285M", "2G"}) {
    const std::int32_t edge = edgeFor(limit);
    EXPECT_GE(edge, std::max(before, 128)) << limit;
    before = edge;
  }
  EXPECT_GT(before, 128);  // a piece that fits is still shared
}

TEST_F(ChosenTiles, RefusedBeforeWorkWithTheSmallestVoxelThatFits) {
  walkFar();
  // The tables of the tool alone do not fit at 1 cm, whatever the tiles.
  const Flags limited = {"--every", "7", "--max-memory", "230M"};
  what_[3] = "0.01";
  std::string line;
  for (const Flags& arguments : {plan(limited), map(limited)}) {
    line = refuse(arguments, 5, "limit.memory");
    for (const char* made : {"plan.json", "rays", "tiles", "field.vdb"})
      EXPECT_FALSE(fs::exists(folder_ / "out" / made));
  }
  const std::string before = "Use --voxel ";
  ASSERT_NE(line.find(before), std::string::npos) << line;
  what_[3] = std::to_string(std::stod(line.substr(line.find(before) + before.size())));
  succeed(map(plus(limited, {"--tiles", "off"})));
  what_[3] = std::to_string(0.93 * std::stod(what_[3]));  // the advice is rounded up to two digits
  refuse(map(plus(limited, {"--tiles", "off"}), "finer"), 5, "limit.memory");
}

}  // namespace
}  // namespace accessvdb::large_test

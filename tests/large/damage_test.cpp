// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Files of a folder of tiles that are not as they were written: named in one line with the documented code, and after
/// what the line advises the result is the same.
#include <algorithm>
#include <fstream>

#include "accessvdb/tiles.h"
#include "large/tiled_test.h"

namespace accessvdb::large_test {
namespace {

namespace fs = std::filesystem;

class TileDamage : public TiledTest {
 protected:
  void planAndBin() const {
    succeed(plan({"--tiles", "6.4"}));
    succeed(step("bin"));
  }
  static bool has(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

  /// Runs `check` with the file damaged in several ways, then puts it back.
  void damaged(const std::string& file, const std::function<void()>& check) const {
    const std::string whole = readText(file);
    ASSERT_GT(whole.size(), 20u) << file;
    for (const std::size_t place : {std::size_t{0}, whole.size() / 3, whole.size() / 2, whole.size() - 4}) {
      SCOPED_TRACE(file + ", byte " + std::to_string(place));
      flipByte(file, place);
      check();
      put(file, whole);
    }
    for (const std::string& other : {whole.substr(0, whole.size() / 2), std::string(), std::string("{}"),
                                     std::string("[1, 2"), std::string("null")}) {
      SCOPED_TRACE(file + ", other content: " + other.substr(0, 20));
      put(file, other);
      check();
    }
    put(file, whole);
  }
  void put(const std::string& file, const std::string& text) const {
    std::ofstream(folder_ / file, std::ios::binary | std::ios::trunc) << text;
  }
  /// One digit of a number, so that the file can still be read.
  void changeNumber(const std::string& file, const std::string& key) const {
    std::string text = readText(file);
    const std::size_t place = text.find_first_of("0123456789", text.find("\"" + key + "\"") + key.size() + 2);
    ASSERT_LT(place, text.size()) << key;
    text[place] = text[place] == '9' ? '8' : static_cast<char>(text[place] + 1);
    put(file, text);
  }
};

TEST_F(TileDamage, PlanIsNotUsed) {
  planAndBin();
  damaged("out/plan.json", [&] {
    refuse(step("run"), 3, "plan.damaged");
    refuse(map({"--tiles", "6.4"}), 3, "plan.damaged");
  });
  for (const char* key : {"voxel_size_m", "tile_voxels", "margin_voxels", "stamps_s"}) {
    const std::string whole = readText("out/plan.json");
    changeNumber("out/plan.json", key);
    refuse(step("run"), 3, "plan.damaged");
    put("out/plan.json", whole);
  }
  succeed(step("run"));
  expectOnePiece();
}

/// Of another program or another layout, but whole.
TEST_F(TileDamage, PlanOfAnotherVersionIsNotUsed) {
  planAndBin();
  tiles::Plan plan = tiles::readPlan(path("out"));
  plan.program = "0.0.1";
  tiles::writePlan(path("out"), plan);
  EXPECT_TRUE(has(refuse(step("run"), 4, "plan.changed"), "0.0.1"));
  EXPECT_TRUE(has(refuse(map({"--tiles", "6.4"}), 4, "plan.changed"), "0.0.1"));
  succeed(map({"--tiles", "6.4", "--fresh"}));
  expectOnePiece();
}

TEST_F(TileDamage, ManifestOfRaysIsNotUsed) {
  planAndBin();
  damaged("out/rays.json", [&] { refuse(step("run"), 3, "rays.damaged"); });
  for (const char* key : {"returns_stored", "end_step", "tiles"}) {
    const std::string whole = readText("out/rays.json");
    changeNumber("out/rays.json", key);
    refuse(step("run"), 3, "rays.damaged");
    put("out/rays.json", whole);
  }
  flipByte("out/rays.json", 50);
  fs::remove(path("out/rays.json"));  // as the line advises
  succeed(step("bin"));
  succeed(step("run"));
  expectOnePiece();
}

TEST_F(TileDamage, ShardsAreNotUsed) {
  succeed(plan({"--tiles", "6.4"}));
  tiles::Plan plan = tiles::readPlan(path("out"));
  plan.bin_bytes = 1;  // one shard per scan
  tiles::writePlan(path("out"), plan);
  succeed(step("bin"));
  const std::string second = "out/rays/shard-000001.rays", third = "out/rays/shard-000002.rays";
  damaged(second, [&] {
    EXPECT_TRUE(has(refuse(step("run"), 3, "rays.damaged"), "shard-000001")) << "names the file";
    fs::remove_all(path("out/tiles"));
  });
  const std::string other = readText(third), own = readText(second);
  put(second, other);
  EXPECT_TRUE(has(refuse(step("run", {"--tile", tilesOf().back()}), 3, "rays.damaged"), "shard-000001"));
  put(third, own);
  refuse(step("run"), 3, "rays.damaged");
  put(third, other);
  // As the line advises: only this one is made again.
  fs::remove(path(second));
  const auto kept = fs::last_write_time(path(third));
  succeed(step("bin"));
  EXPECT_EQ(fs::last_write_time(path(third)), kept);
  EXPECT_TRUE(readText(second) == own);
  put(second, own.substr(0, own.size() - 1));
  succeed(step("bin"));  // a shard of another size is noticed without being deleted
  succeed(step("run"));
  expectOnePiece();
}

TEST_F(TileDamage, ShardsOfAnotherPlanAreNotUsed) {
  planAndBin();
  fs::rename(path("out"), path("other"));
  what_[3] = "0.049";
  succeed(plan({"--tiles", "6.4"}));
  fs::copy(path("other/rays"), path("out/rays"), fs::copy_options::recursive);
  fs::copy(path("other/rays.json"), path("out/rays.json"));
  refuse(step("run"), 3, "rays.missing");
  succeed(step("bin"));
  succeed(step("run"));
  expectOnePiece();
}

TEST_F(TileDamage, TilesAreNotMerged) {
  planAndBin();
  succeed(step("run"));
  const std::string name = tilesOf().front(), folder = "out/tiles/" + name + "/";
  const Flags merge = step("merge", {"--points", path("all.ply"), "--vdb", path("all.vdb")});
  for (const char* file : {"points.ply", "order.bin", "field.vdb"}) {
    const std::string whole = readText(folder + file);
    for (const std::size_t place : {std::size_t{0}, whole.size() / 2, whole.size() - 1, whole.size()}) {
      SCOPED_TRACE(file + (" " + std::to_string(place)));
      if (place < whole.size()) {
        flipByte(folder + file, place);
      } else {
        put(folder + file, whole + "x");
      }
      EXPECT_TRUE(has(refuse(merge, 3, "output.changed"), name + "/" + file));
      put(folder + file, whole);
    }
    fs::remove(path(folder + file));
    EXPECT_TRUE(has(refuse(merge, 3, "output.changed"), name + "/" + file));
    put(folder + file, whole);
  }
  damaged(folder + "tile.json", [&] { refuse(merge, 3, "tile.damaged"); });
  changeNumber(folder + "tile.json", "points");
  refuse(merge, 3, "tile.damaged");
  EXPECT_FALSE(fs::exists(path("all.vdb")));
  // As the line advises: the rays are still there.
  fs::remove_all(path(folder));
  succeed(step("run"));
  expectOnePiece();
  expectNoLeftovers();
}

/// Whatever reads it, and what the line advises is the cure.
TEST_F(TileDamage, TilesThatHaveChangedAreNotRead) {
  succeed(map({"--tiles", "6.4", "--keep-rays"}));
  const std::string name = tilesOf().front(), points = "out/tiles/" + name + "/points.ply",
                    grids = "out/tiles/" + name + "/field.vdb",
                    cure = "accessvdb tile run --tile " + name + " " + path("out");
  const tiles::Index index = tiles::readIndex(path("out"));
  const auto tile = std::ranges::find_if(index.tiles, [&](const auto& one) { return one.id.name() == name; });
  ASSERT_NE(tile, index.tiles.end());
  std::string at;
  for (int axis = 0; axis < 3; ++axis) {
    const auto n = static_cast<std::size_t>(axis);
    at += std::to_string((tile->min_W[n] + tile->max_W[n]) / 2) + (axis < 2 ? "," : "");
  }
  fs::copy(path("out"), path("before"), fs::copy_options::recursive);
  const std::vector<Flags> readers = {{"query", "--map", path("out"), "--at", at},
                                      {"diff", path("out"), path("before")},
                                      {"diff", path("before"), path("out")},
                                      {"render", "--map", path("out"), "--out", path("top.png")},
                                      {"report", "--map", path("out"), "--out", path("page.html")},
                                      step("merge", {"--keep-rays"})};
  for (const Flags& flags : readers) succeed(flags);
  const std::string whole = readText(points), whole_grids = readText(grids);
  for (const std::size_t place : {whole.size() / 3, whole.size() - 1, whole.size()}) {
    SCOPED_TRACE("byte " + std::to_string(place));
    put(points, whole + "x");
    if (place < whole.size()) put(points, whole), flipByte(points, place);
    for (const Flags& flags : readers) {
      const std::string line = refuse(flags, 3, "output.changed");
      EXPECT_TRUE(has(line, points.substr(4)) && has(line, cure)) << line;
    }
  }
  put(points, whole);
  put(grids, whole_grids.substr(0, whole_grids.size() / 2));
  EXPECT_TRUE(has(refuse(readers[0], 3, "output.changed"), cure));
  // Of another place: whole, with a manifest that is right.
  put(grids, whole_grids);
  const std::string index_text = readText("out/field.json");
  put("out/field.json", readText("out/tiles/" + name + "/tile.json"));
  refuse(readers[0], 3, "output.changed");
  put("out/field.json", index_text);
  flipByte(points, whole.size() / 2);
  flipByte(grids, whole_grids.size() / 2);
  succeed(step("run", {"--tile", name}));
  EXPECT_TRUE(readText(points) == whole);
  EXPECT_TRUE(readText(grids) == whole_grids);
  for (const Flags& flags : readers) succeed(flags);
  expectOnePiece();
}

TEST_F(TileDamage, ATileIsMadeAgainAfterTheRaysAreGone) {
  succeed(map({"--tiles", "6.4"}));
  fs::remove_all(path("out/tiles/" + tilesOf().front()));
  EXPECT_TRUE(has(runProgram(step("status")).out, "next: accessvdb tile bin"));
  EXPECT_TRUE(has(refuse(step("run"), 3, "rays.missing"), "tile bin"));
  succeed(step("bin"));
  EXPECT_TRUE(has(runProgram(step("status")).out, "next: accessvdb tile run"));
  succeed(step("run"));
  expectOnePiece();
  expectNoLeftovers();
}

TEST_F(TileDamage, IndexIsNotUsed) {
  succeed(map({"--tiles", "6.4"}));
  damaged("out/field.json", [&] {
    refuse(map({"--tiles", "6.4", "--origin", path("out")}, "other"), 3, "field.damaged");
  });
  expectOnePiece();
}

}  // namespace
}  // namespace accessvdb::large_test

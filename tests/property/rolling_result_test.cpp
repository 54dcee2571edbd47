// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The folder that RollingField::write() makes.
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <csignal>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "accessvdb/rolling_field.h"
#include "accessvdb/tiles.h"
#include "rolling_walks.h"

namespace accessvdb::test {
namespace {

/// The folder at the end is that of a map in tiles: merged, it has the bytes of one piece.
TEST(RollingFolder, MergesIntoOnePiece) {
  const Case test = {.name = "merge", .seed = 7, .change = ChangeMode::Block, .update_every = 0};
  const std::vector<Step> steps = walk(test);
  const ScratchFolder scratch;
  const RollingOptions options = tightOptions(test, steps, 0.5, scratch / "states");
  FieldParams params = paramsOf(test);
  params.carry = carryOf("tree_id");
  AccessibilityField whole(toolsOf(test), params);
  RollingField rolling(toolsOf(test), params, options);
  std::mt19937_64 random(7);
  for (std::size_t n = 0; n < steps.size(); ++n) {
    std::vector<std::int32_t> trees(steps[n].points_W.size());
    for (std::int32_t& tree : trees) tree = static_cast<std::int32_t>(random() % 4);
    const double stamp_s = 0.1 * static_cast<double>(n);
    whole.integrateRays(steps[n].points_W, steps[n].sensors_W, stamp_s, trees);
    rolling.integrateRays(steps[n].points_W, steps[n].sensors_W, stamp_s, trees);
  }
  whole.update();
  whole.write(scratch / "whole");
  rolling.write(scratch / "out");
  EXPECT_GT(rolling.status().saved, 0U);

  const tiles::Plan plan = tiles::readPlan(scratch / "out");
  const tiles::Index index = tiles::readIndex(scratch / "out");
  EXPECT_TRUE(index.complete);
  std::vector<tiles::Tile> done;
  for (const tiles::IndexedTile& tile : index.tiles) {
    tiles::Tile& each = done.emplace_back();
    each.id = tile.id;
    each.sha256 = tile.sha256;
    each.points = tile.points;
    each.device = whole.deviceName();
  }
  EXPECT_EQ(tiles::mergePoints(scratch / "out", plan, done, scratch / "merged.ply"), whole.snapshot().points.size());
  EXPECT_EQ(bytesOf(scratch / "merged.ply"), bytesOf(scratch / "whole" / "points.ply"));
  tiles::mergeGrids({scratch / "out", done, scratch / "merged.ply", scratch / "merged.vdb", {}, 2});
  EXPECT_EQ(bytesOf(scratch / "merged.vdb"), bytesOf(scratch / "whole" / "field.vdb"));
  // A call that was cut off may be repeated; another result is not replaced.
  const std::string listed = bytesOf(scratch / "out" / "plan.json");
  rolling.write(scratch / "out");
  EXPECT_EQ(bytesOf(scratch / "out" / "plan.json"), listed);
  integrate(rolling, steps.front(), 1e3);
  EXPECT_THROW(rolling.write(scratch / "out"), OutputError) << "it holds the result of another moment";
  EXPECT_EQ(bytesOf(scratch / "out" / "plan.json"), listed);
}

/// write() deletes what an earlier call has left in rays/ and tiles/.
TEST(RollingWrite, RefusesAFolderThatHoldsItsOwn) {
  const Case test = {.name = "own", .seed = 26};
  const std::vector<Step> steps = walk(test, 6);
  for (const char* const name : {"rays", "tiles/deeper"}) {
    SCOPED_TRACE(name);
    const ScratchFolder scratch;
    RollingField field(toolsOf(test), paramsOf(test), {.folder = scratch / "out" / name, .tile_voxels = kTile_voxels});
    for (std::size_t n = 0; n < steps.size(); ++n) integrate(field, steps[n], 0.1 * static_cast<double>(n));
    field.checkpoint();
    EXPECT_THROW(field.write(scratch / "out"), OutputError);
    EXPECT_TRUE(std::filesystem::exists(scratch / "out" / name / "rolling.json"));
    EXPECT_FALSE(field.write(scratch / "other").empty());
  }
}

/// A process that may write files up to a size only, as on a disk that fills, while it lives.
class WithFilesUpTo {
 public:
  explicit WithFilesUpTo(std::uintmax_t bytes) : handled_(std::signal(SIGXFSZ, SIG_IGN)) {
    ::getrlimit(RLIMIT_FSIZE, &before_);
    rlimit now = before_;
    now.rlim_cur = bytes;
    ::setrlimit(RLIMIT_FSIZE, &now);
  }
  ~WithFilesUpTo() {
    ::setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, handled_);
  }
  WithFilesUpTo(const WithFilesUpTo&) = delete;
  WithFilesUpTo& operator=(const WithFilesUpTo&) = delete;

 private:
  void (*handled_)(int);
  rlimit before_{};
};

std::uintmax_t largestFile(const std::filesystem::path& folder) {
  std::uintmax_t most = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) most = std::max(most, entry.file_size());
  return most;
}

/// Two flights that look like the same steps: of the second, fewer returns in the west. Its result replaces that of the
/// first tile by tile, until a file does not fit.
TEST(RollingWrite, IsNoResultWhereItIsCutOffBetweenTiles) {
  const Case test = {.name = "cut_off", .seed = 28};
  std::vector<Step> steps = walk(test, 24);
  const ScratchFolder scratch;
  const auto flight = [&](const char* name) {
    RollingField field(toolsOf(test), paramsOf(test), {.folder = scratch / name, .tile_voxels = kTile_voxels});
    for (std::size_t n = 0; n < steps.size(); ++n) integrate(field, steps[n], 0.1 * static_cast<double>(n));
    return field;
  };
  RollingField first = flight("first");
  for (std::size_t n = 1; n < steps.size(); ++n) {  // the first one says where the map lies
    std::size_t seen = 0;
    std::erase_if(steps[n].points_W, [&](const Eigen::Vector3d& p_W) { return p_W.x() < 0 && seen++ % 4 != 0; });
  }
  RollingField second = flight("second");
  static_cast<void>(first.write(scratch / "out"));
  const std::vector<tiles::Tile> whole = second.write(scratch / "whole");
  const tiles::Plan plan = tiles::readPlan(scratch / "out");
  ASSERT_EQ(plan.id(), tiles::readPlan(scratch / "whole").id());
  ASSERT_TRUE(tiles::binned(scratch / "out", plan).has_value());

  const auto of = [&](const char* out, const tiles::Tile& tile) { return scratch / out / "tiles" / tile.id.name(); };
  const auto manifestOf = [&](const tiles::Tile& tile) { return bytesOf(of("out", tile) / "tile.json"); };
  const std::string before = manifestOf(whole.front());
  std::uintmax_t limit = 0;
  for (const tiles::Tile& tile : whole) limit = std::max(limit, largestFile(of("whole", tile)) - 1);
  ASSERT_LT(largestFile(of("whole", whole.front())), limit) << "it is replaced";
  {
    const WithFilesUpTo limited(limit);
    EXPECT_THROW(second.write(scratch / "out"), OutputError);
  }
  const std::string replaced = manifestOf(whole.front());
  EXPECT_NE(replaced, before);
  EXPECT_FALSE(tiles::binned(scratch / "out", plan).has_value());

  // The same field, which has lost that tile: what the cut-off result has of it stays.
  flight("third").checkpoint();
  for (const auto& entry : std::filesystem::directory_iterator(scratch / "third")) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with(whole.front().id.name() + ".") || !name.ends_with(".state")) continue;
    std::string bytes = bytesOf(entry.path());
    bytes[bytes.size() / 2] ^= 1;
    std::ofstream(entry.path(), std::ios::binary) << bytes;
  }
  RollingField lossy = RollingField::resume(toolsOf(test), paramsOf(test), {.folder = scratch / "third"});
  try {
    static_cast<void>(lossy.write(scratch / "out"));
    ADD_FAILURE() << "a whole tile was replaced by one that is lost";
  } catch (const InputError& error) {
    EXPECT_EQ(error.id(), "rolling.damaged") << error.what();
  }
  EXPECT_EQ(manifestOf(whole.front()), replaced);

  EXPECT_EQ(second.write(scratch / "out").size(), whole.size());
  EXPECT_EQ(bytesOf(scratch / "out/rays.json"), bytesOf(scratch / "whole/rays.json"));
}

}  // namespace
}  // namespace accessvdb::test

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// tiles::bin() with ChangeMode::Full, cut off again and again: each call goes on where the last checkpoint was, and
/// the bytes are those of one field.
#include <gtest/gtest.h>

#include <cstdint>
#include <limits>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "accessvdb/program/memory_prediction.h"
#include "accessvdb/tiles.h"
#include "accessvdb/tool_spec.h"
#include "cli/program_run.h"
#include "cli/rolling_world.h"

namespace accessvdb::large_test {
namespace {

namespace fs = std::filesystem;

class SideBySide : public cli_test::ProgramTest {
 protected:
  static constexpr std::uint64_t kScans = 30;

  void SetUp() override {
    ProgramTest::SetUp();
    cli_test::writeRollingWorld({.scans = static_cast<int>(kScans), .returns_home = true, .boards_go = true}, folder_);
    FieldParams params;
    params.tsdf.voxel_size_m = 0.05;
    params.tsdf.range_noise_m = 0.01;
    params.tsdf.max_range_m = 8;
    params.backend = BackendKind::Cpu;
    params.threads = 2;
    params.approach.num_directions = 36;
    params.change = {ChangeMode::Full, 7};
    job_.params = params;
    job_.tools = namedTools({{ToolGeometry::builtin("builtin:pruner"), OrientationSet::yaw(), 0, {}, 0}});
    io::ScanSequence scans = open();
    tiles::Plan plan;
    plan.voxel_size_m = params.tsdf.voxel_size_m;
    plan.origin_W = tiles::originOf(scans, params);
    plan.tile_voxels = 128;
    plan.margin_voxels = tiles::tileMargins(job_.tools, params).returns_voxels;
    tiles::Flight& flight = plan.flights.emplace_back();
    for (std::size_t step = 0; step < scans.size(); ++step) flight.stamps_s.push_back(scans.stamp_s(step).value_or(0));
    for (const std::string& file : scans.paths()) {
      const fs::path path = fs::absolute(file).lexically_normal();
      flight.inputs.push_back({path.string(), fs::file_size(path), {}});
    }
    job_.plan = identified(std::move(plan));
    job_.out = folder_ / "out";
    tiles::writePlan(makeFolder(job_.out), job_.plan);
  }
  [[nodiscard]] io::ScanSequence open() const {
    io::ScanInputOptions options;
    options.scans = path("scans");
    options.poses = path("poses.txt");
    return io::ScanSequence::open(options);
  }
  static fs::path makeFolder(const fs::path& folder) {
    fs::create_directories(folder);
    return folder;
  }

  struct Cut {};
  /// @param after  this many steps of the whole: the process dies, or else is asked to stop
  /// @return the first step that was done
  std::uint64_t binUntil(std::uint64_t after, bool dies, const tiles::BinLimits& limits) {
    io::ScanSequence scans = open();
    io::ScanSequence* const flights[] = {&scans};
    std::uint64_t first = kScans, now = 0;
    tiles::Watch watch;
    watch.stop = [&] { return !dies && now >= after; };
    watch.progress = [&](std::uint64_t done, std::uint64_t, const std::string&) {
      first = std::min(first, done - 1);
      now = done;
      if (dies && done > after) throw Cut();
    };
    try {
      rays_ = tiles::bin(job_, flights, watch, limits);
    } catch (const Cut&) {
      rays_ = {};
    }
    return first;
  }
  void expectOnePiece() {
    std::vector<tiles::Tile> done;
    for (const tiles::TileReturns& tile : rays_.returns_of)
      for (const tiles::Tile& each : tiles::run(job_, rays_, tile.id, {})) done.push_back(each);
    tiles::mergePoints(job_.out, job_.plan, done, folder_ / "all.ply");
    AccessibilityField field(job_.tools, job_.params);
    io::ScanSequence scans = open();
    for (std::size_t step = 0; step < scans.size(); ++step) {
      const io::ScanRecord record = scans.read(step);
      field.integrateScan(record.points_S, record.T_W_S,
                          scans.stamp_s(step).value_or(std::numeric_limits<double>::quiet_NaN()));
    }
    field.update();
    std::size_t changed = 0;
    for (const SurfacePoint& point : field.snapshot().points) changed += point.reason == PointReason::Changed ? 1 : 0;
    EXPECT_GT(changed, 100U);
    field.write(folder_ / "one");
    EXPECT_TRUE(readText("all.ply") == readText("one/points.ply"));
  }

  tiles::Job job_;
  tiles::Binned rays_;
};

TEST_F(SideBySide, GoesOnWhereItWasStopped) {
  EXPECT_EQ(binUntil(4, false, {}), 0U);
  EXPECT_EQ(binUntil(11, false, {}), 4U);
  EXPECT_FALSE(rays_.complete);
  EXPECT_FALSE(tiles::binned(job_.out, job_.plan));
  EXPECT_EQ(binUntil(26, false, {}), 11U);
  EXPECT_EQ(binUntil(kScans, false, {}), 26U);
  EXPECT_TRUE(rays_.complete);
  EXPECT_EQ(rays_.steps, kScans);
  EXPECT_EQ(rays_.points_in, 4000 * kScans);
  EXPECT_EQ(binUntil(kScans, false, {}), kScans) << "nothing is left to do";
  EXPECT_TRUE(tiles::hasRays(job_, rays_));
  expectOnePiece();
}

TEST_F(SideBySide, GoesOnAfterTheLastCheckpoint) {
  const tiles::BinLimits each = {.memory_bytes = 0, .checkpoint_every_s = 0};
  EXPECT_EQ(binUntil(6, true, each), 0U);
  EXPECT_EQ(binUntil(20, true, each), 6U);
  EXPECT_EQ(binUntil(kScans, true, {}), 20U);
  EXPECT_TRUE(rays_.complete);
  expectOnePiece();
}

TEST_F(SideBySide, WithMoreMemoryItGoesOn) {
  binUntil(9, false, {});
  // What a process without tiles takes, and little more: those of a scan do not fit.
  const std::uint64_t base = residentMemoryBytes() + (std::uint64_t{81} << 20);
  try {
    binUntil(kScans, false, {.memory_bytes = base, .checkpoint_every_s = 60});
    ADD_FAILURE() << "fits";
  } catch (const ResourceLimit& error) {
    EXPECT_EQ(error.id(), "limit.memory");
    EXPECT_NE(error.subject().find("scan "), std::string::npos) << error.what();
  }
  EXPECT_EQ(binUntil(kScans, false, {}), 9U);
  expectOnePiece();
}

/// With the rays gone when all was done, and one tile to be made again.
TEST_F(SideBySide, NoTileIsMadeFromWhatAStoppedPassHasTaken) {
  binUntil(kScans, false, {});
  const tiles::Binned whole = rays_;
  fs::remove_all(job_.out / "rays");
  EXPECT_FALSE(tiles::hasRays(job_, whole));
  binUntil(9, false, {});
  EXPECT_FALSE(tiles::hasRays(job_, whole));
  const auto expectMissing = [&] {
    try {
      tiles::run(job_, whole, whole.returns_of.front().id, {});
      ADD_FAILURE() << "made";
    } catch (const InputError& error) {
      EXPECT_EQ(error.id(), "rays.missing");
    }
  };
  expectMissing();

  // A scan that has changed: bin() refuses it once all are read, and what it has fused is of no use.
  const std::string scan = open().paths()[kScans / 2];
  const std::string before = readText(fs::relative(scan, folder_).string());
  std::string changed = before;
  changed[changed.size() - 2] = static_cast<char>(changed[changed.size() - 2] ^ 1);
  writeText(fs::relative(scan, folder_).string(), changed);
  EXPECT_THROW(binUntil(kScans, false, {}), UnusableInput);
  expectMissing();

  writeText(fs::relative(scan, folder_).string(), before);
  binUntil(kScans, false, {});
  EXPECT_TRUE(rays_.complete);
  expectOnePiece();
}

/// A tile is not put in the place of one of a plan that came while it was made.
TEST_F(SideBySide, ASlowRunOfAnOlderPlanKeepsNothing) {
  binUntil(kScans, false, {});
  const tiles::TileId tile = rays_.returns_of.front().id;
  const tiles::Job older = job_;
  job_.plan.flights.front().options = "every 1\n";
  job_.plan = identified(std::move(job_.plan));
  tiles::writePlan(job_.out, job_.plan);
  try {
    tiles::run(older, rays_, tile, {});
    ADD_FAILURE() << "put in place";
  } catch (const UnusableInput& error) {
    EXPECT_EQ(error.id(), "plan.changed");
  }
  EXPECT_FALSE(fs::exists(job_.out / "tiles" / tile.name()));
  fs::remove(job_.out / "plan.json");
  EXPECT_THROW(tiles::run(older, rays_, tile, {}), UnusableInput);
  EXPECT_FALSE(fs::exists(job_.out / "tiles" / tile.name()));
}

/// The same of the mark of a tile that is run as quarters. Where the newer plan has the same returns, the tile is kept.
TEST_F(SideBySide, ASlowRunOfAnOlderPlanServesANewerOneWhereItCan) {
  job_.params.change = {};
  job_.plan.tile_voxels = 512;
  const auto write = [&](const std::string& options) {
    job_.plan.flights.front().options = options;
    job_.plan = identified(std::move(job_.plan));
    tiles::writePlan(job_.out, job_.plan);
  };
  write("every 1\n");
  binUntil(kScans, false, {});
  const tiles::TileId tile = rays_.returns_of.front().id;
  const tiles::Job older = job_;
  const tiles::Binned of_older = rays_;
  write("every 01\n");
  EXPECT_THROW(tiles::run(older, of_older, tile.split().front(), {}), UnusableInput);
  EXPECT_FALSE(fs::exists(job_.out / "tiles" / (tile.name() + ".split.json")));

  tiles::writePlan(job_.out, older.plan);
  bool begun = false;
  tiles::Watch watch;
  watch.stop = [&] {
    if (std::exchange(begun, true)) return false;
    tiles::writePlan(job_.out, job_.plan);
    binUntil(kScans, false, {});
    return false;
  };
  EXPECT_EQ(tiles::run(older, of_older, tile, {}, watch).size(), 1U);
  EXPECT_EQ(tiles::status(job_.out, job_.plan, rays_).done.size(), 1U);
}

/// What was not as it is now, or belongs to another plan, is made again.
TEST_F(SideBySide, OtherScansAreNotGoneOnWith) {
  binUntil(9, false, {});
  job_.plan.flights.front().options = "every 1\n";
  job_.plan = identified(std::move(job_.plan));
  tiles::writePlan(job_.out, job_.plan);
  EXPECT_EQ(binUntil(kScans, false, {}), 0U);
  expectOnePiece();
}

}  // namespace
}  // namespace accessvdb::large_test

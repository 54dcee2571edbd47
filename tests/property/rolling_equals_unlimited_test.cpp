// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A rolling field against one field without a limit, on random walks that return: ids, labels, and score and direction
/// of accessible points, after every update. ACCESSVDB_ROLLING_WORLDS=300 tries so many more.
#include <gtest/gtest.h>
#include <openvdb/openvdb.h>

#include <algorithm>
#include <cstdint>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "accessvdb/rolling_field.h"
#include "accessvdb/tiles.h"
#include "field/tools/window_margins.h"
#include "hostdev/occupancy_query.h"
#include "hostdev/voxel_scale.h"
#include "rolling_walks.h"
#include "support/same_map.h"
#include "tiles/json_file.h"

namespace accessvdb::test {
namespace {

/// Voxels of a grid that one of two files has, and the other has not, or has otherwise.
template <typename GridT>
std::size_t differentVoxels(const std::filesystem::path& one, const std::filesystem::path& other, const char* name) {
  const auto read = [name](const std::filesystem::path& path) {
    openvdb::io::File file(path.string());
    file.open(/*delayLoad=*/false);
    return openvdb::gridPtrCast<GridT>(file.readGrid(name));
  };
  const auto missing = [](const GridT& from, const GridT& in) {
    std::size_t count = 0;
    const auto accessor = in.getConstAccessor();
    for (auto voxel = from.cbeginValueOn(); voxel; ++voxel)
      count += accessor.isValueOn(voxel.getCoord()) && accessor.getValue(voxel.getCoord()) == *voxel ? 0 : 1;
    return count;
  };
  const auto a = read(one), b = read(other);
  return missing(*a, *b) + missing(*b, *a);
}

/// What rays have opened is in the map, also where no label depends on it.
void expectSameMap(const AccessibilityField& unlimited, RollingField& rolling, const ScratchFolder& scratch) {
  unlimited.write(scratch / "whole");
  const std::filesystem::path whole = scratch / "whole" / "field.vdb", merged = scratch / "merged.vdb";
  tiles::mergeGrids({scratch / "out", rolling.write(scratch / "out"), scratch / "whole" / "points.ply", merged, {}, 2});
  EXPECT_EQ(differentVoxels<openvdb::FloatGrid>(whole, merged, "distance"), 0U);
  EXPECT_EQ(differentVoxels<openvdb::FloatGrid>(whole, merged, "weight"), 0U);
  EXPECT_EQ(differentVoxels<openvdb::BoolGrid>(whole, merged, "cleared"), 0U);
}

std::string usedOf(const RollingStatus& now, const RollingOptions& limits) {
  return std::to_string(now.tiles_in_memory) + " of " + std::to_string(now.tiles) + " tiles, " +
         std::to_string(now.memory_bytes) + " of " + std::to_string(limits.memory_limit_bytes) + " bytes, on the GPU " +
         std::to_string(now.device_bytes) + " of " + std::to_string(limits.device_limit_bytes);
}

class Rolling : public ::testing::TestWithParam<Case> {};

TEST_P(Rolling, EqualsAFieldWithoutALimit) {
  const Case& test = GetParam();
  const std::vector<Step> steps = walk(test);
  const ScratchFolder scratch;
  const RollingOptions options = tightOptions(test, steps, test.memory_share, scratch / "tiles");
  AccessibilityField unlimited(toolsOf(test), paramsOf(test));
  RollingField rolling(toolsOf(test), paramsOf(test), options);
  std::size_t most_in_memory = 0;
  for (std::size_t n = 0; n < steps.size(); ++n) {
    const double stamp_s = 0.1 * static_cast<double>(n);
    integrate(unlimited, steps[n], stamp_s);
    integrate(rolling, steps[n], stamp_s);
    const RollingStatus status = rolling.status();
    ASSERT_FALSE(status.memory_short) << "step " << n << ": " << usedOf(status, options);
    most_in_memory = std::max<std::size_t>(most_in_memory, status.tiles_in_memory);
    if (test.update_every == 0 || n % static_cast<std::size_t>(test.update_every) != 0) continue;
    unlimited.update();
    rolling.update();
    ASSERT_EQ(differences(unlimited.snapshot(), rolling.snapshot()), 0U) << "step " << n;
  }
  unlimited.update();
  rolling.update();
  const FieldSnapshot expected = unlimited.snapshot();
  EXPECT_EQ(differences(expected, rolling.snapshot()), 0U);
  expectVaried(expected);
  if (test.change == ChangeMode::Full) {
    EXPECT_GT(std::ranges::count(expected.points, PointReason::Changed, &SurfacePoint::reason), 10);
  }
  if (test.spacing_m > 0) {
    EXPECT_GT(std::ranges::count(expected.points, PointReason::BesideSurface, &SurfacePoint::reason), 100);
  }
  const RollingStatus status = rolling.status();
  expectSameMap(unlimited, rolling, scratch);
  // Before anything is scored, all tiles of the shorter walk past what goes may fit.
  if (test.change != ChangeMode::Full) {
    EXPECT_LT(most_in_memory, status.tiles);
  }
  EXPECT_GT(status.loaded, 0U);
  EXPECT_EQ(status.points, expected.points.size());
  EXPECT_TRUE(status.lost_tiles.empty());
}

/// Returns on a rectangle that is at right angles to y or x, from one sensor.
Step onRectangle(const Eigen::Vector3d& sensor_W, const Eigen::Vector3d& corner, const Eigen::Vector3d& size,
                 std::mt19937_64& random, int returns = 6000) {
  Step step;
  for (int n = 0; n < returns; ++n) {
    const Eigen::Vector3d part(uniform(random, 0, 1), uniform(random, 0, 1), uniform(random, 0, 1));
    step.points_W.emplace_back(corner + part.cwiseProduct(size));
  }
  step.sensors_W.push_back(sensor_W);
  return step;
}

/// Boards that have been seen go, while rays pass where they were: tiles are 6.4 m, and this is in tile 0_0 and at its
/// border in the west.
class RollingEvidence : public ::testing::Test {
 protected:
  void expectSame(const std::vector<Step>& steps, std::uint64_t seed) {
    const Case test = {.name = "evidence", .seed = seed, .change = ChangeMode::Full};
    FieldParams params = paramsOf(test);
    params.origin_W = {{0, 0, 0}};
    RollingOptions options;
    options.folder = scratch_ / "tiles";
    options.tile_voxels = kTile_voxels;
    AccessibilityField unlimited(toolsOf(test), params);
    RollingField rolling(toolsOf(test), params, options);
    for (std::size_t n = 0; n < steps.size(); ++n) {
      integrate(unlimited, steps[n], 0);
      integrate(rolling, steps[n], 0);
      unlimited.update();
      rolling.update();
      ASSERT_EQ(differences(unlimited.snapshot(), rolling.snapshot()), 0U) << "step " << n;
    }
    const FieldSnapshot found = unlimited.snapshot();
    EXPECT_GT(std::ranges::count(found.points, PointReason::Changed, &SurfacePoint::reason), 100);
    expectSameMap(unlimited, rolling, scratch_);
  }
  ScratchFolder scratch_;
  std::mt19937_64 random_{30};
};

TEST_F(RollingEvidence, OfRaysThatOnlyCrossATile) {
  std::vector<Step> steps;
  for (int n = 0; n < 4; ++n)
    steps.push_back(onRectangle({1.5, 3, 0.1 * n}, {3.2, 2.7, -0.4}, {0.02, 1, 0.8}, random_));
  for (int n = 0; n < 24; ++n)
    steps.push_back(onRectangle({-7, 3 + 0.02 * n, 0}, {14, 1.2, -1.5}, {0.02, 4, 3}, random_));
  expectSame(steps, 1);
}

/// A board goes that stood across the border, and with it what it hid from the tool. Few rays pass each cell, so that
/// it is judged together with those beside it.
TEST_F(RollingEvidence, OfBothSidesOfABorder) {
  std::vector<Step> steps;
  for (int n = 0; n < 4; ++n) {
    steps.push_back(onRectangle({0.3 * n - 0.5, 1.2, 0}, {-0.83, 3, -0.5}, {1.6, 0.02, 1}, random_));
    steps.push_back(onRectangle({0.3 * n - 3, 1.2, 0}, {-2, 3.4, -0.6}, {4, 0.02, 1.2}, random_));
  }
  for (int n = 0; n < 24; ++n)
    steps.push_back(onRectangle({0.03 * n - 0.4, 1.2, 0.1}, {-2, 3.4, -0.6}, {4, 0.02, 1.2}, random_, 1200));
  expectSame(steps, 2);
}

/// A board goes whose shadow, seen aslant, lies beyond the border.
TEST_F(RollingEvidence, OfAShadowBeyondABorder) {
  std::vector<Step> steps;
  for (int n = 0; n < 4; ++n) steps.push_back(onRectangle({-3, 1.2, 0.1 * n}, {-1.03, 3, -0.5}, {1, 0.02, 1}, random_));
  for (int n = 0; n < 24; ++n)
    steps.push_back(onRectangle({0.02 * n - 0.4, 1.2, 0.1}, {-2, 4.5, -0.8}, {4, 0.02, 1.6}, random_));
  expectSame(steps, 3);
}

/// Every 16th scan it is forgotten where nothing is left to open: also in a tile that no ray comes near then.
TEST_F(RollingEvidence, OfATileThatMissesATurn) {
  std::vector<Step> steps;
  for (int n = 0; n < 3; ++n)
    steps.push_back(onRectangle({1.5, 3, 0.1 * n}, {3.2, 2.7, -0.4}, {0.02, 1, 0.8}, random_));
  for (int n = 0; n < 9; ++n)
    steps.push_back(onRectangle({1.5, 3 + 0.02 * n, 0}, {5.5, 1.2, -1.5}, {0.02, 4, 3}, random_));
  for (int n = 0; n < 8; ++n)  // scans 13 to 20, somewhere else
    steps.push_back(onRectangle({-40, 3, 0}, {-42, 2.7, -0.4}, {0.02, 1, 0.8}, random_));
  // Another board close behind: its shadow is where the first one was, and rays go through it from the side.
  for (int n = 0; n < 4; ++n) steps.push_back(onRectangle({5, 3, 0.1 * n}, {3.4, 2.7, -0.4}, {0.02, 1, 0.8}, random_));
  for (int n = 0; n < 4; ++n)
    steps.push_back(onRectangle({3.27, 0.5, 0.02 * n}, {3.2, 5, -0.8}, {0.14, 0.02, 1.6}, random_));
  expectSame(steps, 4);
}

/// Both sides of a border are done with what stood across it, each with its part. Another board close behind: its
/// shadow is where the first one was, and rays go through it from the side.
TEST_F(RollingEvidence, OfWhatTheOtherSideIsDoneWith) {
  std::vector<Step> steps;
  for (int n = 0; n < 3; ++n)
    steps.push_back(onRectangle({1.5, 0, 0.1 * n}, {3.2, -0.5, -0.4}, {0.02, 1, 0.8}, random_));
  for (int n = 0; n < 15; ++n)
    steps.push_back(onRectangle({1.5, 0.02 * n - 0.2, 0}, {5.5, -2, -1.5}, {0.02, 4, 3}, random_));
  for (int n = 0; n < 4; ++n) steps.push_back(onRectangle({5, 0, 0.1 * n}, {3.4, -0.5, -0.4}, {0.02, 1, 0.8}, random_));
  for (int n = 0; n < 4; ++n)
    steps.push_back(onRectangle({3.27, -2.7, 0.02 * n}, {3.2, 1.8, -0.8}, {0.14, 0.02, 1.6}, random_));
  expectSame(steps, 5);
}

internal::VoxelColumnBox coreOf(const std::string& tile) {
  return internal::coreOf(tiles::TileId::parse(tile).window(kTile_voxels));
}

bool isInside(const internal::VoxelColumnBox& core, const SurfacePoint& point, const FieldSnapshot& snapshot) {
  const Eigen::Vector3f p_L = (point.position_W - snapshot.origin_W).cast<float>();
  const auto ijk =
      kernels::voxelOf(p_L.x(), p_L.y(), p_L.z(), kernels::VoxelScale(snapshot.voxel_size_m).inverse_float32);
  return core.contains({ijk[0], ijk[1], ijk[2]});
}

/// The state in a folder whose tile has most accessible points, of those up to a column from the west. The first scan
/// is in column 0.
std::filesystem::path mostAccessible(const std::filesystem::path& folder, const FieldSnapshot& labels,
                                     std::int32_t up_to_x) {
  std::filesystem::path found;
  std::ptrdiff_t most = 0;
  const std::vector<SurfacePoint> accessible = labels.accessible();
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() != ".state" || tiles::TileId::parse(tileOf(entry.path())).x > up_to_x) continue;
    const internal::VoxelColumnBox core = coreOf(tileOf(entry.path()));
    const auto count = std::count_if(accessible.begin(), accessible.end(),
                                     [&](const SurfacePoint& point) { return isInside(core, point, labels); });
    if (count <= most) continue;
    most = count;
    found = entry.path();
  }
  return found;
}

/// A state that is damaged costs its tile, in words, and no other.
TEST(RollingLoss, IsOneTileThatIsNamed) {
  const Case test = {.name = "loss", .seed = 9};
  const std::vector<Step> steps = walk(test, 20);
  const ScratchFolder scratch;
  const RollingOptions options = tightOptions(test, steps, 0.5, scratch / "states");
  AccessibilityField unlimited(toolsOf(test), paramsOf(test));
  RollingField rolling(toolsOf(test), paramsOf(test), options);
  std::string damaged;  // far from where the sensor is then, so that the tile is neither in memory nor read ahead
  for (std::size_t n = 0; n < steps.size(); ++n) integrate(unlimited, steps[n], 0.1 * static_cast<double>(n));
  unlimited.update();
  for (std::size_t n = 0; n < steps.size(); ++n) {
    integrate(rolling, steps[n], 0.1 * static_cast<double>(n));
    if (n != 12) continue;
    rolling.checkpoint();
    const std::filesystem::path file = mostAccessible(options.folder, unlimited.snapshot(), /*up_to_x=*/2);
    ASSERT_FALSE(file.empty());
    std::string bytes = bytesOf(file);
    bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 1);
    writeBytes(file, bytes);
    damaged = tileOf(file);
  }
  ASSERT_FALSE(damaged.empty());
  rolling.update();
  const FieldSnapshot found = rolling.snapshot();
  EXPECT_EQ(rolling.status().lost_tiles, std::vector<std::string>{damaged});
  const internal::VoxelColumnBox core = coreOf(damaged);
  std::size_t accessible = 0;
  for (const SurfacePoint& point : found.points) {
    if (point.label != PointLabel::Accessible) continue;
    EXPECT_FALSE(isInside(core, point, found));
    EXPECT_EQ(unlimited.pointAt(point.position_W)->label, PointLabel::Accessible);
    ++accessible;
  }
  EXPECT_GT(accessible, 100U);
  EXPECT_LT(accessible, unlimited.snapshot().accessible().size());
}

/// What a process leaves that is killed after a checkpoint: the same folder, with tiles that came and went since.
TEST(RollingResume, GoesOnAfterTheLastCheckpoint) {
  for (int world = 0; world < worlds(2); ++world) {
    const auto seed = static_cast<std::uint64_t>(10 + world);
    SCOPED_TRACE(seed);
    Case test = {.name = "resume", .seed = seed, .change = ChangeMode::Block, .memory_share = 0.6};
    if (world % 2 == 1) {
      test.memory_share = 0.8;  // it sees farther
      test.change = ChangeMode::Full;
      test.free_for_s = 1;
    }
    const std::vector<Step> steps = walk(test);
    std::mt19937_64 random(seed);
    const ScratchFolder scratch;
    const RollingOptions options = tightOptions(test, steps, test.memory_share, scratch / "states");
    AccessibilityField unlimited(toolsOf(test), paramsOf(test));
    auto rolling = std::make_unique<RollingField>(toolsOf(test), paramsOf(test), options);
    std::size_t saved_at = 0, resumed = 0;
    std::uint64_t left_before = 0;
    for (std::size_t n = 0; n < steps.size(); ++n) {
      integrate(unlimited, steps[n], 0.1 * static_cast<double>(n));
      integrate(*rolling, steps[n], 0.1 * static_cast<double>(n));
      unlimited.update();
      rolling->update();
      if (n % 7 == 3) {
        rolling->checkpoint();
        saved_at = n + 1;
      }
      if (saved_at == 0 || random() % 6 != 0) continue;
      left_before += rolling->status().saved;
      writeBytes(options.folder / "letter.txt", "of the user");
      rolling.reset();
      rolling = std::make_unique<RollingField>(RollingField::resume(toolsOf(test), paramsOf(test), options));
      EXPECT_EQ(rolling->status().steps, saved_at);
      EXPECT_EQ(bytesOf(options.folder / "letter.txt"), "of the user");
      ++resumed;
      for (std::size_t again = saved_at; again <= n; ++again) {
        integrate(*rolling, steps[again], 0.1 * static_cast<double>(again));
        rolling->update();
      }
      ASSERT_FALSE(rolling->status().memory_short) << "step " << n << ": " << usedOf(rolling->status(), options);
      ASSERT_EQ(differences(unlimited.snapshot(), rolling->snapshot()), 0U) << "step " << n;
    }
    EXPECT_EQ(differences(unlimited.snapshot(), rolling->snapshot()), 0U);
    EXPECT_GT(resumed, 2U);
    EXPECT_GT(left_before + rolling->status().saved, 0U);
    EXPECT_TRUE(rolling->status().lost_tiles.empty());
    rolling->checkpoint();
    std::size_t states = 0;
    for (const auto& entry : std::filesystem::directory_iterator(options.folder))
      states += entry.path().extension() == ".state" ? 1 : 0;
    EXPECT_EQ(states, rolling->status().tiles) << "of checkpoints before";
    rolling->write(scratch / "out");
    EXPECT_TRUE(tiles::readIndex(scratch / "out").complete);
  }
}

TEST(RollingResume, RefusesWhatIsNotItsOwn) {
  const Case test = {.name = "own", .seed = 13};
  const std::vector<Step> steps = walk(test, 6);
  const ScratchFolder scratch;
  const RollingOptions options = {.folder = scratch / "states"};
  {
    RollingField rolling(toolsOf(test), paramsOf(test), options);
    for (const Step& step : steps) integrate(rolling, step, 0);
    rolling.checkpoint();
  }
  const auto refused = [&](const std::vector<ToolSpec>& tools, const FieldParams& params,
                           const RollingOptions& with) -> std::string {
    try {
      const RollingField field = RollingField::resume(tools, params, with);
      return field.status().steps == steps.size() ? "taken" : "other";
    } catch (const Error& error) {
      return error.id();
    }
  };
  EXPECT_EQ(refused(toolsOf(test), paramsOf(test), options), "taken");
  EXPECT_EQ(refused(toolsOf(test), paramsOf(test), {.folder = scratch / "elsewhere"}), "rolling.missing");
  EXPECT_FALSE(std::filesystem::exists(scratch / "elsewhere"));
  FieldParams params = paramsOf(test);
  params.tsdf.range_noise_m = 0.02;
  EXPECT_EQ(refused(toolsOf(test), params, options), "rolling.changed");
  EXPECT_EQ(refused({{ToolGeometry::builtin("builtin:pencil")}}, paramsOf(test), options), "rolling.changed");
  RollingOptions larger = options;
  larger.tile_voxels = 1024;
  EXPECT_EQ(refused(toolsOf(test), paramsOf(test), larger), "rolling.changed");
  {
    const RollingField user = RollingField::resume(toolsOf(test), paramsOf(test), options);
    EXPECT_EQ(refused(toolsOf(test), paramsOf(test), options), "output.locked") << "two fields in one folder";
  }
  EXPECT_EQ(refused(toolsOf(test), paramsOf(test), options), "taken");
  // With a right hash, but what no field writes.
  const auto with = [&](const std::function<void(nlohmann::ordered_json&)>& change) {
    const std::string good = bytesOf(options.folder / "rolling.json");
    nlohmann::ordered_json json = nlohmann::ordered_json::parse(good);
    json.erase("sha256");
    change(json);
    tiles::writeJson(options.folder / "rolling.json", json);
    const std::string id = refused(toolsOf(test), paramsOf(test), options);
    writeBytes(options.folder / "rolling.json", good);
    return id;
  };
  EXPECT_EQ(with([](auto& json) { json["tiles"].push_back(json["tiles"][0]); }), "rolling.damaged");
  EXPECT_EQ(with([](auto& json) { json["tiles"][0]["tile"] = "0_0.03"; }), "rolling.damaged");
  EXPECT_EQ(with([](auto& json) { json["first_ids"].clear(); }), "rolling.damaged");
  EXPECT_EQ(with([](auto& json) { json["points"] = 1; }), "rolling.damaged");
  EXPECT_EQ(with([](auto& json) { json.erase("origin_W"); }), "rolling.damaged");
  EXPECT_EQ(with([](auto& json) { json["schema"] = 1; }), "rolling.damaged");
  EXPECT_EQ(with([](auto& json) { json["tiles"] = 3; }), "rolling.damaged");
  EXPECT_EQ(with([](auto& json) { json["levelling"] = {1, 0, 0, 0, 1, 0, 0, 0, -1}; }), "rolling.damaged");
  EXPECT_EQ(with([](auto& json) { json["levelling"] = {1, 0, 0, 0, 2, 0, 0, 0, 1}; }), "rolling.damaged");
  EXPECT_EQ(refused(toolsOf(test), paramsOf(test), options), "taken");
  // A new field does not begin in it.
  EXPECT_THROW(RollingField(toolsOf(test), paramsOf(test), options), OutputError);
  std::string manifest = bytesOf(options.folder / "rolling.json");
  manifest[manifest.size() / 2] = static_cast<char>(manifest[manifest.size() / 2] ^ 1);
  writeBytes(options.folder / "rolling.json", manifest);
  EXPECT_EQ(refused(toolsOf(test), paramsOf(test), options), "rolling.damaged");
}

/// A field that is about to end, and one that goes on in its folder.
TEST(RollingResume, ReadsNothingBeforeTheFolderIsItsOwn) {
  const Case test = {.name = "late", .seed = 17};
  const ScratchFolder scratch;
  const RollingOptions options = {.folder = scratch / "states"};
  auto ends = std::make_unique<RollingField>(toolsOf(test), paramsOf(test), options);
  for (const Step& step : walk(test, 4)) integrate(*ends, step, 0);
  ends->checkpoint("before");
  const auto end = [&] {
    ends->checkpoint("last");
    ends.reset();
  };
  const TableProgress while_it_begins = [&](std::size_t, std::size_t) {
    if (ends) std::thread(end).join();  // not on a thread of the tables
  };
  try {
    EXPECT_EQ(RollingField::resume(toolsOf(test), paramsOf(test), options, while_it_begins).note(), "last");
  } catch (const OutputError& error) {
    EXPECT_EQ(error.id(), "output.locked");
  }
  if (ends) end();
  EXPECT_EQ(RollingField::resume(toolsOf(test), paramsOf(test), options).note(), "last");
}

TEST(RollingRefusals, NameWhatIsWrong) {
  const Case test = {.name = "refusals"};
  const ScratchFolder scratch;
  const auto refused = [&](const FieldParams& params, const RollingOptions& options) -> std::string {
    try {
      RollingField field(toolsOf(test), params, options);
      return "taken";
    } catch (const Error& error) {
      return error.id();
    }
  };
  const RollingOptions fine = {.folder = scratch / "states"};
  FieldParams params = paramsOf(test);
  params.update.budget_points = 10;
  EXPECT_EQ(refused(params, fine), "rolling.params");
  params = paramsOf(test);
  params.origin_W = {{0, 0, 0}};
  params.window = FieldWindow{{0, 0}, {128, 128}};
  EXPECT_EQ(refused(params, fine), "rolling.params");
  for (const std::int32_t edge : {1, 100, 64, -128, 1 << 17})
    EXPECT_EQ(refused(paramsOf(test), {.folder = scratch / "states", .tile_voxels = edge}), "rolling.tile") << edge;
  std::filesystem::create_directories(scratch / "full");
  writeBytes(scratch / "full" / "letter.txt", "of the user");
  EXPECT_EQ(refused(paramsOf(test), {.folder = scratch / "full"}), "output.foreign");
  EXPECT_EQ(refused(paramsOf(test), {.folder = scratch / "full" / "letter.txt"}), "output.foreign");
  EXPECT_EQ(bytesOf(scratch / "full" / "letter.txt"), "of the user");
  EXPECT_EQ(refused(paramsOf(test), fine), "taken");
}

/// Of tiles that are scored once, at the end. On a GPU what scoring adds is not on the host.
double shareOfUnscored() { return backendNamedBy("ACCESSVDB_TILE_DEVICE") == BackendKind::Cuda ? 0.65 : 0.5; }

std::vector<Case> cases() {
  std::vector<Case> all = {
      {.name = "off"},
      {.name = "block", .seed = 2, .change = ChangeMode::Block},
      {.name = "every_third", .seed = 3, .change = ChangeMode::Block, .update_every = 3},
      {.name = "at_the_end", .seed = 4, .update_every = 0, .memory_share = shareOfUnscored()},
      {.name = "two_tools", .seed = 5, .change = ChangeMode::Block, .update_every = 5, .tools = 2},
      {.name = "ray_cloud", .seed = 6, .ray_cloud = true},
      {.name = "points_of_surface", .seed = 7, .change = ChangeMode::Block, .spacing_m = 0.1},
      {.name = "full", .seed = 20, .change = ChangeMode::Full},
      {.name = "full_ray_cloud", .seed = 21, .change = ChangeMode::Full, .ray_cloud = true},
      {.name = "full_two_tools", .seed = 22, .change = ChangeMode::Full, .update_every = 5, .tools = 2},
      {.name = "full_at_the_end",
       .seed = 23,
       .change = ChangeMode::Full,
       .update_every = 0,
       .memory_share = shareOfUnscored()},
      {.name = "full_forgets", .seed = 24, .change = ChangeMode::Full, .free_for_s = 1}};
  for (int n = 0; n < worlds(0); ++n) {
    std::mt19937_64 random(1000 + n);
    constexpr ChangeMode kModes[] = {ChangeMode::Off, ChangeMode::Block, ChangeMode::Full, ChangeMode::Full};
    all.push_back({.name = "world_" + std::to_string(n),
                   .seed = random(),
                   .change = kModes[n % 4],
                   .update_every = static_cast<int>(random() % 5),
                   .tools = 1 + static_cast<int>(random() % 2),
                   .ray_cloud = random() % 3 == 0,
                   .memory_share = uniform(random, 0.65, 0.8)});
    if (n % 4 >= 2) all.back().memory_share = uniform(random, 0.7, 0.8);  // scans that see farther
    if (n % 4 == 3) all.back().free_for_s = uniform(random, 0.3, 3);
    if (all.back().update_every == 0) all.back().memory_share = shareOfUnscored();
  }
  return all;
}
INSTANTIATE_TEST_SUITE_P(Walks, Rolling, ::testing::ValuesIn(cases()),
                         [](const auto& test) { return test.param.name; });

}  // namespace
}  // namespace accessvdb::test

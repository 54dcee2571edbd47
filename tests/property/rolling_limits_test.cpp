// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Limits of a rolling field, on memory, on a GPU and of the disk: what does not fit is left out, blocks, and is said.
#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <utility>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "accessvdb/program/memory_prediction.h"
#include "accessvdb/rolling_field.h"
#include "rolling_walks.h"
#include "tiles/rolling_start.h"

namespace accessvdb::test {
namespace {

/// Where the tiles of one scan do not fit, what is left out blocks.
TEST(RollingLimit, IsContainedWhereMemoryIsShort) {
  for (const auto& [mode, share] :
       {std::pair(ChangeMode::Block, 0.2), std::pair(ChangeMode::Block, 0.35), std::pair(ChangeMode::Full, 0.3)}) {
    SCOPED_TRACE(share);
    const Case test = {.name = "short", .seed = 8, .change = mode};
    const std::vector<Step> steps = walk(test);
    const ScratchFolder scratch;
    const RollingOptions options = tightOptions(test, steps, share, scratch / "states");
    AccessibilityField unlimited(toolsOf(test), paramsOf(test));
    RollingField rolling(toolsOf(test), paramsOf(test), options);
    std::size_t times_short = 0, accessible = 0;
    for (std::size_t n = 0; n < steps.size(); ++n) {
      integrate(unlimited, steps[n], 0.1 * static_cast<double>(n));
      integrate(rolling, steps[n], 0.1 * static_cast<double>(n));
      unlimited.update();
      rolling.update();
      const RollingStatus status = rolling.status();
      EXPECT_LE(status.memory_bytes, options.memory_limit_bytes) << "step " << n;
      if (status.memory_short) {
        ++times_short;
        EXPECT_LT(status.fitting_range_m, mode == ChangeMode::Full ? 11 : 6);
      }
      for (const SurfacePoint& point : rolling.snapshot().accessible()) {
        const auto other = unlimited.pointAt(point.position_W);
        ASSERT_TRUE(other.has_value());
        ASSERT_EQ(other->label, PointLabel::Accessible) << "step " << n;
        ++accessible;
      }
    }
    EXPECT_GT(times_short, 0U);
    EXPECT_GT(rolling.status().left_out_returns, 0U);
    EXPECT_GT(accessible, 1000U);
  }
}

/// Steps of the same place take no room for growth that does not come.
TEST(RollingLimit, LeavesNothingOutThatFits) {
  const Case test = {.name = "same_place", .seed = 15};
  std::vector<Step> steps = walk(test, 4);
  steps.resize(1);
  for (int n = 0; n < 12; ++n) steps.push_back(steps.front());
  const ScratchFolder scratch;
  const RollingOptions options = tightOptions(test, steps, 1.2, scratch / "states");
  RollingField rolling(toolsOf(test), paramsOf(test), options);
  for (const Step& step : steps) {
    integrate(rolling, step, 0);
    rolling.update();
    EXPECT_FALSE(rolling.status().memory_short);
  }
  EXPECT_EQ(rolling.status().left_out_returns, 0U);
}

/// A field that ends and is resumed in one program would otherwise begin with hardly any tiles.
TEST(RollingLimit, OfTheProcessCountsNothingThatHasBeenFreed) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "a sanitizer's own malloc keeps what is freed";
#endif
  constexpr std::size_t kFreed = std::size_t{200} << 20, kBlock = std::size_t{1} << 12;
  RollingOptions options;
  options.process_limit_bytes = residentMemoryBytes() + kFreed;
  std::vector<std::unique_ptr<char[]>> blocks;
  while (kBlock * blocks.size() < kFreed) blocks.push_back(std::make_unique<char[]>(kBlock));
  const std::unique_ptr<char[]> stays =
      std::move(blocks.back());  // at the end, so that the rest is not given back by itself
  blocks.pop_back();
  EXPECT_THROW(static_cast<void>(tiles::tileLimit(options)), ResourceLimit);
  blocks.clear();
  EXPECT_GT(tiles::tileLimit(options), kFreed / 4);
}

/// Without one of the caller's, the tiles leave room on a GPU for what a step takes besides.
TEST(RollingLimit, OnAGpuIsMostOfWhatIsFreeThere) {
  EXPECT_EQ(tiles::deviceLimit({.folder = {}, .device_limit_bytes = 7}, 1000, 10), 7U);
  EXPECT_EQ(tiles::deviceLimit({}, 1000, 10), 810U);
  EXPECT_EQ(tiles::deviceLimit({}, 0, 0), 0U) << "on the CPU";
}

/// A tile on a GPU holds two buffers of 8 MiB there, and two on the host, before it has anything else.
TEST(RollingLimit, CountsAllThatTilesHoldOnAGpu) {
  const Case test = {.name = "gpu", .seed = 19};
  const ScratchFolder scratch;
  RollingField rolling(toolsOf(test), paramsOf(test), {.folder = scratch / "states", .tile_voxels = kTile_voxels});
  const std::vector<Step> steps = walk(test, 8);
  for (const Step& step : steps) integrate(rolling, step, 0);
  const RollingStatus status = rolling.status();
  if (status.device_bytes == 0) GTEST_SKIP() << "on the CPU; ACCESSVDB_TILE_DEVICE=cuda";
  EXPECT_GT(status.device_bytes, status.tiles_in_memory * (std::uint64_t{16} << 20));
  EXPECT_GT(status.memory_bytes, status.tiles_in_memory * (std::uint64_t{16} << 20));
  for (int n = 0; n < 30; ++n) integrate(rolling, steps.back(), 0);
  EXPECT_LT(rolling.status().device_bytes, 3 * status.device_bytes / 2) << "what was counted is not counted again";
}

/// Whatever is left out is said, also where it is of the nearest tile.
TEST(RollingLimit, IsSaidWhereItIsReached) {
  const Case test = {.name = "said", .seed = 16};
  const std::vector<Step> steps = walk(test, 20);
  const ScratchFolder scratch;
  RollingField rolling(toolsOf(test), paramsOf(test),
                       {.folder = scratch / "states", .memory_limit_bytes = 8'000'000, .tile_voxels = 1024});
  std::uint64_t before = 0;
  for (const Step& step : steps) {
    integrate(rolling, step, 0);
    rolling.update();
    const RollingStatus status = rolling.status();
    EXPECT_EQ(status.left_out_returns > before, status.memory_short);
    before = status.left_out_returns;
  }
  EXPECT_GT(before, 0U);
}

/// More was lost than anybody keeps track of: nothing is accessible any more, wherever in the world the map lies, and
/// whether the tiles come before it or after.
TEST(RollingLimit, OfWhatIsLostClosesEverything) {
  const Case test = {.name = "all_closed", .seed = 18};
  std::vector<Step> steps = walk(test, 12);
  const Eigen::Vector3d utm_m(500'000, 5'400'000, 120);
  for (Step& step : steps) {
    for (Eigen::Vector3d& p_W : step.points_W) p_W += utm_m;
    for (Eigen::Vector3d& q_W : step.sensors_W) q_W += utm_m;
  }
  const std::vector<Eigen::Vector3d> lost_W((std::size_t{1} << 20) + 1, utm_m + Eigen::Vector3d(5000, 0, 0));
  const auto accessible = [](RollingField& field) {
    field.update();
    return field.snapshot().accessible().size();
  };
  for (const std::size_t lost_before : {0, 6, 12}) {
    SCOPED_TRACE(lost_before);
    const ScratchFolder scratch;
    const RollingOptions options = {.folder = scratch / "states", .tile_voxels = kTile_voxels};
    {
      RollingField field(toolsOf(test), paramsOf(test), options);
      for (std::size_t n = 0; n < steps.size(); ++n) {
        if (n == lost_before) field.leaveOut(lost_W, 0);
        integrate(field, steps[n], 0);
      }
      if (lost_before == steps.size()) {
        EXPECT_GT(accessible(field), 100U);
        field.leaveOut(lost_W, 0);
      }
      EXPECT_EQ(accessible(field), 0U);
      EXPECT_GT(field.status().points, 1000U);
      field.checkpoint();
    }
    RollingField resumed = RollingField::resume(toolsOf(test), paramsOf(test), options);
    integrate(resumed, steps.front(), 0);
    EXPECT_EQ(accessible(resumed), 0U);
  }
}

/// A folder that takes no more files: the step is refused before anything changes, and can be repeated.
class RollingDiskLimit : public ::testing::TestWithParam<Pace> {};

TEST_P(RollingDiskLimit, RefusesAStepAndNothingElse) {
  const WithPace with(GetParam());
  const Case test = {.name = "disk", .seed = 14};
  const std::vector<Step> steps = walk(test, 20);
  const ScratchFolder scratch;
  const RollingOptions options = tightOptions(test, steps, 0.5, scratch / "states");
  AccessibilityField unlimited(toolsOf(test), paramsOf(test));
  RollingField rolling(toolsOf(test), paramsOf(test), options);
  std::size_t refused = 0;
  for (std::size_t n = 0; n < steps.size(); ++n) {
    integrate(unlimited, steps[n], 0.1 * static_cast<double>(n));
    std::filesystem::rename(options.folder, scratch / "away");  // root may write everywhere else
    try {
      integrate(rolling, steps[n], 0.1 * static_cast<double>(n));
      std::filesystem::rename(scratch / "away", options.folder);
    } catch (const Error& error) {
      EXPECT_NE(error.id(), "field.broken");
      ++refused;
      std::filesystem::rename(scratch / "away", options.folder);
      integrate(rolling, steps[n], 0.1 * static_cast<double>(n));
    }
    unlimited.update();
    rolling.update();
  }
  EXPECT_GT(refused, 0U);
  EXPECT_TRUE(rolling.status().lost_tiles.empty());
  EXPECT_EQ(differences(unlimited.snapshot(), rolling.snapshot()), 0U);
}
INSTANTIATE_TEST_SUITE_P(Paces, RollingDiskLimit, ::testing::Values(Pace::AtOnce, Pace::WhenNeeded));

}  // namespace
}  // namespace accessvdb::test

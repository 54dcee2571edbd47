// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Saved states: a field that was saved and loaded goes on like one that was not, bit for bit.
#include "accessvdb/saved_state.h"
#include "accessvdb/tool_spec.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "accessvdb/device_view.h"
#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "property/state_streams.h"
#include "support/determinism_support.h"
#include "support/same_map.h"
#include "support/scratch_folder.h"

namespace accessvdb::test {
namespace {

namespace fs = std::filesystem;

/// BackendKind::Cuda with ACCESSVDB_STATE_DEVICE=cuda: the loaded field is on the GPU, all others on the CPU.
BackendKind loadBackend() { return backendNamedBy("ACCESSVDB_STATE_DEVICE"); }

Stream randomStream(std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const auto oneOf = [&](auto... values) {
    const std::array all = {values...};
    return all[random() % all.size()];
  };
  Stream stream;
  stream.params = cpuParams(oneOf(0.02, 0.03, 0.05));
  stream.params.tsdf.max_weight = oneOf(5u, 4095u);
  stream.params.tsdf.clamp_min_m = oneOf(0.0, -0.02);
  stream.params.tsdf.region = oneOf(UpdateRegion::DoubleCone, UpdateRegion::FullCube);
  stream.params.tsdf.cleared_radius_voxels = oneOf(0.0, 2.5);
  stream.params.approach.num_directions = oneOf(36, 130, 180, 256);
  stream.params.approach.corridor_length_m = oneOf(0.0, 0.6);
  stream.params.approach.viewpoints = oneOf(false, false, true);
  stream.params.scoring.mean_positions = oneOf(true, true, false);
  stream.params.scoring.neighbourhood_weight = oneOf(true, true, false);
  // By number: coins fell on the same side for the first seeds.
  stream.params.mirror_distance = seed % 2 == 0;
  if (seed % 3 == 0) stream.params.origin_W = {{0.25, -0.125, 1.0 / 3}};
  stream.ray_cloud = oneOf(false, true);
  stream.scans = wallScans(seed, 6, oneOf(600, 1500));
  stream.stop = random() % (stream.scans.size() + 1);
  if (seed % 6 == 0) stream.params.window = FieldWindow{{0, 0}, {128, 128}};
  return stream;
}

std::string plyOf(const AccessibilityField& field, const fs::path& file) {
  io::writePointsPly(file, field.snapshot(), {});
  return bytesOf(file);
}

/// The mirror of distances, which no label depends on, against the map.
void expectDistancesMirrored(const AccessibilityField& field) {
  if (!field.params().mirror_distance || field.deviceName() != "cpu") return;
  const DeviceView view = field.hostView();
  const auto distances = field.volume().distance();
  std::size_t observed = 0;
  for (auto voxel = distances->cbeginValueOn(); voxel; ++voxel, ++observed) {
    const Eigen::Vector3d ijk(voxel.getCoord().x(), voxel.getCoord().y(), voxel.getCoord().z());
    const Eigen::Vector3d p_W = field.origin_W() + field.params().tsdf.voxel_size_m * ijk;
    ASSERT_EQ(view.distanceAt(p_W.data()), *voxel);
  }
  EXPECT_EQ(observed, field.volume().activeVoxelCount());
}

/// @return what the stream ends with
FieldSnapshot expectGoesOn(const Stream& stream, const ScratchFolder& folder) {
  AccessibilityField straight(armTool(), stream.params);
  integrate(straight, stream, 0, stream.stop);
  straight.saveState(folder / "a.avst");
  AccessibilityField loaded = AccessibilityField::loadState(folder / "a.avst", armTool(), loadBackend(), 1);
  expectSame(straight.snapshot(), loaded.snapshot());
  expectSameMap(straight.volume(), loaded.volume());
  expectDistancesMirrored(loaded);
  EXPECT_EQ(straight.params().describe(), loaded.params().describe());
  loaded.saveState(folder / "b.avst");
  EXPECT_EQ(bytesOf(folder / "a.avst"), bytesOf(folder / "b.avst"));

  integrate(straight, stream, stream.stop, stream.scans.size());
  integrate(loaded, stream, stream.stop, stream.scans.size());
  expectSameMap(straight.volume(), loaded.volume());
  straight.update();
  loaded.update();
  expectSame(straight.snapshot(), loaded.snapshot());
  EXPECT_EQ(plyOf(straight, folder / "a.ply"), plyOf(loaded, folder / "b.ply"));
  expectDistancesMirrored(loaded);
  straight.saveState(folder / "a.avst");
  loaded.saveState(folder / "b.avst");
  EXPECT_EQ(bytesOf(folder / "a.avst"), bytesOf(folder / "b.avst"));
  return straight.snapshot();
}

/// A few streams; ACCESSVDB_STATE_STREAMS=N for more, ACCESSVDB_STATE_SEED for the first one's seed.
TEST(SavedState, GoesOnBitForBit) {
  const auto number = [](const char* name, unsigned long fallback) {
    const char* text = std::getenv(name);
    return text == nullptr ? fallback : std::strtoul(text, nullptr, 10);
  };
  const std::uint64_t first = number("ACCESSVDB_STATE_SEED", 1), count = number("ACCESSVDB_STATE_STREAMS", 6);
  const ScratchFolder folder;
  std::size_t accessible = 0, blocked = 0;
  for (std::uint64_t seed = first; seed < first + count && !HasFailure(); ++seed) {
    SCOPED_TRACE("ACCESSVDB_STATE_SEED=" + std::to_string(seed));
    const FieldSnapshot end = expectGoesOn(randomStream(seed), folder);
    accessible += end.count(PointLabel::Accessible);
    blocked += end.count(PointLabel::Blocked);
  }
  EXPECT_GT(accessible, 50u);
  EXPECT_GT(blocked, 50u);
}

/// With sets of orientations, which only then are part of the file.
TEST(SavedState, OfOrientationsGoesOnBitForBit) {
  const ScratchFolder folder;
  std::vector<ToolOrientation> list;
  for (int n = 0; n < 70; ++n) list.push_back(orientationOf(37.0 * n, 90 * std::sin(n), 11.0 * n));
  for (const OrientationSet& orientations :
       {OrientationSet::sphere(12.5), OrientationSet::pitch(-60, 90, 30), OrientationSet::of(list)}) {
    SCOPED_TRACE(orientations.text());
    Stream stream = {cpuParams(), wallScans(7, 6, 1500), false, 3};
    stream.params.approach.orientations = orientations;
    expectVaried(expectGoesOn(stream, folder));
    const SavedState state = inspectState(folder / "a.avst");
    EXPECT_EQ(state.params.describe(), AccessibilityField(armTool(), stream.params).params().describe());
    ASSERT_EQ(state.params.approach.orientations.list.size(), orientations.list.size());
    for (std::size_t n = 0; n < orientations.list.size(); ++n) {
      EXPECT_EQ(state.params.approach.orientations.list[n].R_WT, orientations.list[n].R_WT);
    }
  }
}

/// The number of rolls is part of the file where the tool rolls, whether it was chosen or follows from the rule.
TEST(SavedState, OfAToolThatRollsGoesOnBitForBit) {
  const ScratchFolder folder;
  for (const auto& [orientations, rolls, stored] : {std::tuple{OrientationSet::sphere(30), 0, 12},
                                                    {OrientationSet::sphere(30), 5, 5},
                                                    {OrientationSet::yaw(), 3, 3},
                                                    {OrientationSet::sphere(30), 1, 1}}) {
    SCOPED_TRACE(orientations.text() + ", rolls " + std::to_string(rolls));
    Stream stream = {cpuParams(), wallScans(7, 6, 1500), false, 3};
    stream.params.approach.orientations = orientations;
    stream.params.approach.rolls = rolls;
    expectVaried(expectGoesOn(stream, folder));
    EXPECT_EQ(inspectState(folder / "a.avst").params.approach.rolls, stored);
  }
}

/// Which points are scored follows from them, whether they were updated before the stop or not.
TEST(SavedState, OfPointsOfTheSurfaceGoesOnBitForBit) {
  const ScratchFolder folder;
  for (const double spacing_m : {0.05, 0.1}) {
    Stream stream = {cpuParams(), wallScans(9, 6, 1500), false, 3};
    stream.params.tsdf.range_noise_m = 0.03;
    stream.params.scoring.point_spacing_m = spacing_m;
    const FieldSnapshot end = expectGoesOn(stream, folder);
    expectVaried(end);
    EXPECT_GT(end.reasons()[static_cast<std::size_t>(PointReason::BesideSurface)], 100u);
    EXPECT_EQ(inspectState(folder / "a.avst").params.scoring.point_spacing_m, spacing_m);
  }
}

TEST(SavedState, KeepsLabelsAfterUpdates) {
  const ScratchFolder folder;
  Stream stream = {cpuParams(), wallScans(3, 8, 1500), false, 5};
  for (const int budget : {0, 100}) {
    stream.params.update.budget_points = budget;
    AccessibilityField straight(armTool(), stream.params);
    const auto update_all = [](AccessibilityField& field) {
      while (field.update().backlog > 0) {
      }
    };
    const auto compare = [](const FieldSnapshot& a, const FieldSnapshot& b) {
      ASSERT_EQ(a.points.size(), b.points.size());
      for (std::size_t n = 0; n < a.points.size(); ++n) {
        ASSERT_EQ(a.points[n].position_W, b.points[n].position_W);
        ASSERT_EQ(a.points[n].label, b.points[n].label);
        if (a.points[n].label != PointLabel::Accessible) continue;
        ASSERT_EQ(a.points[n].score, b.points[n].score);
        ASSERT_EQ(a.points[n].direction, b.points[n].direction);
      }
    };
    for (std::size_t n = 0; n < stream.stop; ++n) {
      integrate(straight, stream, n, n + 1);
      update_all(straight);
    }
    straight.saveState(folder / "scored.avst");
    AccessibilityField loaded = AccessibilityField::loadState(folder / "scored.avst", armTool(), loadBackend());
    compare(straight.snapshot(), loaded.snapshot());
    const SurfacePoint first = straight.snapshot().accessible().at(0);
    ASSERT_TRUE(loaded.pointAt(first.position_W));
    EXPECT_EQ(loaded.pointAt(first.position_W)->direction, first.direction);
    loaded.saveState(folder / "again.avst");
    EXPECT_EQ(bytesOf(folder / "scored.avst"), bytesOf(folder / "again.avst"));
    for (std::size_t n = stream.stop; n < stream.scans.size(); ++n) {
      integrate(straight, stream, n, n + 1);
      integrate(loaded, stream, n, n + 1);
      update_all(straight);
      update_all(loaded);
      compare(straight.snapshot(), loaded.snapshot());
    }
    expectVaried(loaded.snapshot());
  }
}

/// On the processor a state has what the last update found out: loading it asks nothing again.
TEST(SavedState, GoesOnWithoutScoringAgain) {
  const ScratchFolder folder;
  struct Kind {
    std::string name;
    std::vector<ToolSpec> tools;
    ChangeMode change = ChangeMode::Block;
    double free_for_s = std::numeric_limits<double>::infinity();
  };
  const auto arm = [](OrientationSet set, int rolls = 0) {
    return ToolSpec{armTool(), std::move(set), rolls, "arm", 0};
  };
  const ToolSpec hook = {boxTool({-0.03F, -0.2F, -0.05F}, {0.35F, 0.07F, 0.31F}), OrientationSet::yaw(), 0, "hook", 2};
  const std::vector<Kind> kinds = {{"yaw", {arm(OrientationSet::yaw())}},
                                   {"rolls", {arm(OrientationSet::sphere(40), 3)}},
                                   {"wide", {arm(OrientationSet::sphere(12))}},
                                   {"several", {arm(OrientationSet::yaw()), hook, arm(OrientationSet::sphere(40))}},
                                   {"full", {arm(OrientationSet::yaw())}, ChangeMode::Full, 2}};
  for (Kind kind : kinds) {
    SCOPED_TRACE(kind.name);
    for (std::size_t n = 0; n < kind.tools.size(); ++n) kind.tools[n].name = "tool" + std::to_string(n);
    Stream stream = {cpuParams(), wallScans(3, 8, 1500), false, 5};
    stream.params.change.mode = kind.change;
    stream.params.change.free_for_s = kind.free_for_s;
    AccessibilityField straight(kind.tools, stream.params);
    const auto take = [&](AccessibilityField& field, std::size_t n) {
      field.integrateScan(stream.scans[n].points_S, stream.scans[n].T_W_S, static_cast<double>(n));
      return field.update();
    };
    for (std::size_t n = 0; n < stream.stop; ++n) take(straight, n);
    straight.saveState(folder / "scored.avst");
    AccessibilityField loaded = AccessibilityField::loadState(folder / "scored.avst", kind.tools, BackendKind::Cpu, 2);
    expectSame(straight.snapshot(), loaded.snapshot());
    loaded.saveState(folder / "again.avst");
    EXPECT_EQ(bytesOf(folder / "scored.avst"), bytesOf(folder / "again.avst"));
    const UpdateStats nothing = loaded.update();
    EXPECT_EQ(nothing.dirty_points, 0U);
    EXPECT_EQ(nothing.direction_tests, 0U);
    for (std::size_t n = stream.stop; n < stream.scans.size(); ++n) {
      const UpdateStats expected = take(straight, n), found = take(loaded, n);
      EXPECT_EQ(found.moved_points, expected.moved_points);
      const FieldSnapshot a = straight.snapshot(), b = loaded.snapshot();
      ASSERT_EQ(a.points.size(), b.points.size());
      for (std::size_t i = 0; i < a.points.size(); ++i) {
        ASSERT_EQ(a.points[i].label, b.points[i].label) << i;
        ASSERT_EQ(a.points[i].tools, b.points[i].tools) << i;
        if (a.points[i].label != PointLabel::Accessible) continue;
        ASSERT_EQ(a.points[i].score, b.points[i].score) << i;
        ASSERT_EQ(a.points[i].direction, b.points[i].direction) << i;
        ASSERT_EQ(a.points[i].roll, b.points[i].roll) << i;
      }
    }
    expectVaried(loaded.snapshot());
    // What came after the last update is not in it: labels are made again.
    integrate(loaded, stream, 0, 1);
    loaded.saveState(folder / "behind.avst");
    EXPECT_LT(std::filesystem::file_size(folder / "behind.avst"),
              std::filesystem::file_size(folder / "scored.avst") * 2);
    AccessibilityField behind = AccessibilityField::loadState(folder / "behind.avst", kind.tools, BackendKind::Cpu, 2);
    loaded.update();
    EXPECT_EQ(loaded.snapshot().count(PointLabel::Accessible), behind.snapshot().count(PointLabel::Accessible));
  }
}

TEST(SavedState, HasTheSameBytesForAnyNumberOfThreads) {
  const ScratchFolder folder;
  const std::vector<Scan> scans = wallScans(4, 5, 3000);
  for (const int threads : {1, 2, 5}) {
    Stream stream = {cpuParams(0.02), scans, false, 0};
    stream.params.threads = threads;
    AccessibilityField field(armTool(), stream.params);
    integrate(field, stream, 0, scans.size());
    field.saveState(folder / std::to_string(threads));
  }
  EXPECT_EQ(bytesOf(folder / "1"), bytesOf(folder / "2"));
  EXPECT_EQ(bytesOf(folder / "1"), bytesOf(folder / "5"));
  EXPECT_GT(bytesOf(folder / "1").size(), 1'000'000u);
}

TEST(SavedState, SaysWhatItIs) {
  const ScratchFolder folder;
  Stream stream = {cpuParams(0.1), wallScans(5, 3, 200), false, 0};
  stream.params.tsdf.max_range_m = 4.1;
  AccessibilityField field(armTool(), stream.params);
  integrate(field, stream, 0, 3);
  field.saveState(folder / "s.avst");
  const SavedState state = inspectState(folder / "s.avst");
  EXPECT_EQ(state.scans, 3u);
  EXPECT_EQ(state.points, field.snapshot().points.size());
  EXPECT_EQ(state.leaves, field.volume().leafCount());
  EXPECT_EQ(state.tool_sha256, armTool().sha256());
  EXPECT_FALSE(state.updated);
  EXPECT_EQ(state.params.describe(), field.params().describe());
  EXPECT_EQ(state.params.tsdf.max_range_m, 4.1);
  EXPECT_EQ(state.sha256.size(), 64u);
  field.update();
  field.saveState(folder / "s.avst");
  EXPECT_TRUE(inspectState(folder / "s.avst").updated);
  EXPECT_NE(inspectState(folder / "s.avst").sha256, state.sha256);
}

TEST(SavedStateRefusal, OfHistoriesThatItDoesNotHold) {
  const ScratchFolder folder;
  FieldParams params = FieldParams::paper(0.05);
  params.backend = BackendKind::Cpu;
  const auto idOf = [&](const FieldParams& refused) -> std::string {
    try {
      AccessibilityField(armTool(), refused).saveState(folder / "s.avst");
    } catch (const InvalidArgument& error) {
      return error.id();
    }
    return "";
  };
  EXPECT_EQ(idOf(params), "usage.checkpoint");
  params = cpuParams();
  params.tsdf.region = UpdateRegion::Projective;
  EXPECT_EQ(idOf(params), "usage.checkpoint");
  EXPECT_TRUE(folder.names().empty());
  const AccessibilityField field(armTool(), cpuParams());
  EXPECT_THROW(field.saveState(folder / "no_folder" / "s.avst"), OutputError);
  try {
    field.saveState("/dev/full");
    ADD_FAILURE() << "a full disk was not noticed";
  } catch (const OutputError& error) {
    EXPECT_EQ(error.id(), "output.disk_full");
  }
  field.saveState(folder / "empty.avst");
  EXPECT_TRUE(
      AccessibilityField::loadState(folder / "empty.avst", armTool(), BackendKind::Cpu).snapshot().points.empty());
}

/// Before and right after an update, whose states hold more.
TEST(SavedState, GoesOnWithWhatReturnsCarry) {
  for (const bool updated : {false, true}) {
    Stream stream = {cpuParams(), wallScans(3, 6, 600), false, 3};
    stream.params.carry = treeAndRow();
    AccessibilityField straight(armTool(), stream.params), stopped(armTool(), stream.params);
    integrateCarrying(stopped, stream, 0, 3);
    integrateCarrying(straight, stream, 0, 3);
    if (updated) stopped.update(), straight.update();
    integrateCarrying(straight, stream, 3, 6);
    straight.update();
    const ScratchFolder folder;
    stopped.saveState(folder / "state");
    AccessibilityField loaded = AccessibilityField::loadState(folder / "state", armTool(), loadBackend(), 2);
    EXPECT_EQ(loaded.params().carry, stream.params.carry);
    integrateCarrying(loaded, stream, 3, 6);
    loaded.update();
    EXPECT_EQ(plyOf(loaded, folder / "loaded.ply"), plyOf(straight, folder / "straight.ply")) << updated;
    const FieldSnapshot expected = straight.snapshot();
    ASSERT_EQ(expected.attributes.size(), 2U);
    // Both values and none are there, so that a state without them would differ.
    for (const std::int32_t value : {0, 1, 2}) {
      EXPECT_GT(std::count(expected.attributes[0].values.begin(), expected.attributes[0].values.end(), value), 0);
    }
  }
}

}  // namespace
}  // namespace accessvdb::test

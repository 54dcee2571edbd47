// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Fields of tiles (FieldParams::window) against one field of everything, bit for bit: points and map. Whatever breaks
/// the equality on purpose - a narrower halo, clipped rays, scans that are joined, another origin - has to show.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <limits>
#include <ostream>
#include <random>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "accessvdb/tool_spec.h"
#include "accessvdb/tsdf_volume.h"
#include "hostdev/occupancy_query.h"
#include "hostdev/voxel_scale.h"
#include "support/box_tool.h"
#include "support/determinism_support.h"

namespace accessvdb::test {
namespace {

/// Rays in the world frame, one list per step.
struct Step {
  std::vector<Eigen::Vector3d> points_W;
  std::vector<Eigen::Vector3d> sensors_W;  ///< [n] or [1]
};
using World = std::vector<Step>;

enum class Source { Scans, RayCloud, Stations };

struct Case {
  std::string name;
  std::uint64_t seed = 1;
  double voxel_size_m = 0.05;
  std::int32_t tile_voxels = 128;
  std::string tool = "builtin:pruner";
  Source source = Source::Scans;
  std::function<void(FieldParams&)> change = [](FieldParams&) {};
};
void PrintTo(const Case& test, std::ostream* out) { *out << test.name; }

/// Boards and poles over an area of about 300 x 200 voxels, seen from a walk between them; or from two stations, one of
/// them far outside, whose clouds are read in several steps each.
World makeWorld(const Case& test) {
  std::mt19937_64 random(test.seed);
  const double v = test.voxel_size_m;
  struct Board {
    Eigen::Vector3d corner, along, up;
  };
  std::vector<Board> boards;
  for (int n = 0; n < 70; ++n) {
    const double heading = uniform(random, 0, 6.28), length = uniform(random, 2, 25) * v;
    boards.push_back({{uniform(random, -150, 150) * v, uniform(random, -100, 100) * v, uniform(random, -20, 10) * v},
                      {length * std::cos(heading), length * std::sin(heading), 0},
                      {uniform(random, -3, 3) * v, uniform(random, -3, 3) * v, uniform(random, 4, 30) * v}});
  }
  World world;
  for (int s = 0; s < 10; ++s) {
    Step& step = world.emplace_back();
    Eigen::Vector3d sensor_W(uniform(random, -140, 140) * v, uniform(random, -90, 90) * v, uniform(random, 0, 20) * v);
    if (test.source == Source::Stations) {
      if (s >= 5) sensor_W = {190 * v, -260 * v, 25 * v};
      if (s % 5 != 0) sensor_W = world[world.size() - 2].sensors_W.front();
    }
    for (int n = 0; n < 6000; ++n) {
      const Board& board = boards[random() % boards.size()];
      const Eigen::Vector3d noise(uniform(random, -0.4, 0.4), uniform(random, -0.4, 0.4), uniform(random, -0.4, 0.4));
      step.points_W.push_back(board.corner + uniform(random, 0, 1) * board.along + uniform(random, 0, 1) * board.up +
                              v * noise);
      if (test.source == Source::RayCloud) step.sensors_W.push_back(sensor_W + Eigen::Vector3d(0.01 * v * n, 0, 0));
    }
    if (test.source != Source::RayCloud) step.sensors_W.push_back(sensor_W);
  }
  return world;
}

FieldParams paramsOf(const Case& test) {
  FieldParams params;
  params.tsdf.voxel_size_m = test.voxel_size_m;
  params.backend = BackendKind::Cpu;
  params.threads = 2;
  params.approach.num_directions = 36;
  test.change(params);
  return params;
}

ToolGeometry toolOf(const Case& test) {
  if (test.tool == "lopsided") return boxTool({-0.03f, -0.5f, -0.05f}, {0.35f, 0.07f, 0.31f});
  return ToolGeometry::builtin(test.tool);
}

/// "three": one that reaches far and does not come first, in other directions than the two before it.
std::vector<ToolSpec> toolsOf(const Case& test, const FieldParams& params) {
  const OrientationSet& set = params.approach.orientations;
  if (test.tool != "three") return {{toolOf(test), set, params.approach.rolls, {}, params.scoring.max_collisions}};
  return {{ToolGeometry::builtin("builtin:pencil"), OrientationSet::yaw(), 0, "pencil", -1},
          {boxTool({-0.03f, -0.5f, -0.05f}, {0.35f, 0.07f, 0.31f}), OrientationSet::yaw(), 0, "lopsided", 4},
          {boxTool({-0.1f, -0.06f, -0.05f}, {2.4f, 0.07f, 0.31f}), OrientationSet::sphere(30), 3, "long", 0}};
}

AccessibilityField fieldOf(const Case& test, const FieldParams& params, const World& world) {
  AccessibilityField field(toolsOf(test, params), params);
  for (const Step& step : world) {
    if (!step.points_W.empty()) field.integrateRays(step.points_W, step.sensors_W);
  }
  field.update();
  return field;
}

struct Tile {
  FieldWindow window;
  [[nodiscard]] bool contains(const openvdb::Coord& ijk) const {
    return ijk.x() >= window.core_low[0] && ijk.x() < window.core_high[0] && ijk.y() >= window.core_low[1] &&
           ijk.y() < window.core_high[1];
  }
};

/// By the library's rule: another one would put a return on the boundary of two voxels into the other tile.
openvdb::Coord voxelOf(const Eigen::Vector3d& p_W, const Eigen::Vector3d& origin_W, double voxel_size_m) {
  const Eigen::Vector3f p_L = (p_W - origin_W).cast<float>();
  const auto ijk = kernels::voxelOf(p_L.x(), p_L.y(), p_L.z(), kernels::VoxelScale(voxel_size_m).inverse_float32);
  return {ijk[0], ijk[1], ijk[2]};
}

std::vector<Tile> tilesOf(const TsdfVolume& volume, std::int32_t edge) {
  const openvdb::CoordBBox box = volume.leafBounds();
  const auto down = [edge](std::int32_t x) { return (x >= 0 ? x / edge : -((edge - 1 - x) / edge)) * edge; };
  std::vector<Tile> tiles;
  for (std::int32_t x = down(box.min().x()); x <= box.max().x(); x += edge) {
    for (std::int32_t y = down(box.min().y()); y <= box.max().y(); y += edge) {
      tiles.push_back({{{x, y}, {x + edge, y + edge}}});
    }
  }
  return tiles;
}

std::vector<SurfacePoint> pointsIn(const FieldSnapshot& field, const Tile& tile) {
  std::vector<SurfacePoint> points;
  for (const SurfacePoint& point : field.points) {
    if (tile.contains(voxelOf(point.position_W, field.origin_W, field.voxel_size_m))) points.push_back(point);
  }
  return points;
}

/// Points and leaves of the tile that differ, also those that only one side has.
std::size_t differences(const AccessibilityField& one, const FieldSnapshot& all, const AccessibilityField& part,
                        const Tile& tile) {
  const auto expected = pointsIn(all, tile), found = pointsIn(part.snapshot(), tile);
  std::size_t count = std::max(expected.size(), found.size()) - std::min(expected.size(), found.size());
  for (std::size_t n = 0; n < std::min(expected.size(), found.size()); ++n) {
    if (expected[n].position_W != found[n].position_W || !sameVerdict(expected[n], found[n]) ||
        expected[n].tool != found[n].tool || expected[n].tools != found[n].tools) {
      ++count;
    }
  }
  const auto compare = [&](const auto& x, const auto& y) {
    const auto missing = [&](const auto& from, const auto& in, bool values) {
      for (auto leaf = from->tree().cbeginLeaf(); leaf; ++leaf) {
        if (!tile.contains(leaf->origin())) continue;
        const auto* other = in->tree().probeConstLeaf(leaf->origin());
        if (other == nullptr || (values && !(*leaf == *other))) ++count;
      }
    };
    missing(x, y, true);
    missing(y, x, false);
  };
  compare(one.volume().distance(), part.volume().distance());
  compare(one.volume().weight(), part.volume().weight());
  compare(one.volume().cleared(), part.volume().cleared());
  return count;
}

/// ACCESSVDB_TILE_DEVICE=cuda: the tiles are scored on the GPU, the one piece always on the CPU.
BackendKind tileBackend() { return backendNamedBy("ACCESSVDB_TILE_DEVICE"); }

/// The field that the tiles have to equal, and what they share with it.
struct OnePiece {
  explicit OnePiece(const Case& tested)
      : test(tested), world(makeWorld(test)), params(paramsOf(test)), field(fieldOf(test, params, world)) {
    const Eigen::Vector3d origin_W = field.origin_W();
    params.origin_W = {{origin_W.x(), origin_W.y(), origin_W.z()}};
  }
  [[nodiscard]] std::vector<Tile> tiles() const { return tilesOf(field.volume(), test.tile_voxels); }

  Case test;
  World world;
  FieldParams params;  ///< with the field's origin
  AccessibilityField field;
  FieldSnapshot all = field.snapshot();
};

/// Compares all tiles with one piece. @return the field in one piece
FieldSnapshot expectTilesEqual(const Case& test) {
  const OnePiece one(test);
  const Eigen::Vector3d origin_W = one.field.origin_W();
  FieldParams params = one.params;
  params.backend = tileBackend();
  const std::vector<Tile> tiles = one.tiles();
  EXPECT_GE(tiles.size(), 4u);
  std::size_t seen = 0, scored_elsewhere = 0;
  for (const Tile& tile : tiles) {
    params.window = tile.window;
    const AccessibilityField part = fieldOf(test, params, one.world);
    EXPECT_EQ(part.origin_W(), origin_W);
    EXPECT_EQ(differences(one.field, one.all, part, tile), 0u)
        << tile.window.core_low[0] << ", " << tile.window.core_low[1];
    seen += pointsIn(one.all, tile).size();
    for (const SurfacePoint& point : part.snapshot().points) {
      const bool core = tile.contains(voxelOf(point.position_W, origin_W, test.voxel_size_m));
      if (!core && point.label != PointLabel::Unscored) ++scored_elsewhere;
    }
  }
  EXPECT_EQ(seen, one.all.points.size());  // the tiles cover everything
  EXPECT_EQ(scored_elsewhere, 0u);
  return one.all;
}

class TilesEqualOnePiece : public testing::TestWithParam<Case> {};

TEST_P(TilesEqualOnePiece, BitForBit) { expectVaried(expectTilesEqual(GetParam())); }

INSTANTIATE_TEST_SUITE_P(
    Worlds, TilesEqualOnePiece,
    testing::Values(
        Case{.name = "pruner"}, Case{.name = "ray_cloud", .seed = 2, .source = Source::RayCloud},
        Case{.name = "stations", .seed = 8, .source = Source::Stations},
        Case{.name = "pencil_20mm", .seed = 3, .voxel_size_m = 0.02, .tool = "builtin:pencil"},
        Case{.name = "lopsided_large_tiles", .seed = 4, .tile_voxels = 256, .tool = "lopsided"},
        Case{.name = "long_corridor", .seed = 5, .change = [](FieldParams& p) { p.approach.corridor_length_m = 1.5; }},
        Case{.name = "three_tools", .seed = 10, .tool = "three"},
        Case{
            .name = "points_of_surface", .seed = 13, .change = [](FieldParams& p) { p.scoring.point_spacing_m = 0.1; }},
        Case{.name = "sphere",
             .seed = 9,
             .change = [](FieldParams& p) { p.approach.orientations = OrientationSet::sphere(12.5); }},
        Case{.name = "sphere_one_roll",
             .seed = 9,
             .change =
                 [](FieldParams& p) {
                   p.approach.orientations = OrientationSet::sphere(12.5);
                   p.approach.rolls = 1;
                 }},
        Case{.name = "wide",
             .seed = 12,
             .voxel_size_m = 0.08,
             .change =
                 [](FieldParams& p) {
                   p.approach.orientations = OrientationSet::sphere(10);
                   p.approach.rolls = 2;
                 }},
        Case{.name = "rolls",
             .seed = 11,
             .tool = "lopsided",
             .change =
                 [](FieldParams& p) {
                   p.approach.orientations = OrientationSet::sphere(25);
                   p.approach.rolls = 7;
                 }},
        Case{.name = "pitch_samples",
             .seed = 10,
             .tool = "lopsided",
             .change =
                 [](FieldParams& p) {
                   p.approach.orientations = OrientationSet::pitch(-60, 90, 30);
                   p.scoring.surface_samples = 200;
                   p.scoring.form = ToolForm::SurfaceSamples;
                 }},
        Case{.name = "low_weight_cap",
             .seed = 6,
             .change =
                 [](FieldParams& p) {
                   p.tsdf.max_weight = 7;
                   p.tsdf.clamp_min_m = -0.03;
                 }},
        Case{.name = "full_cube_samples",
             .seed = 7,
             .change =
                 [](FieldParams& p) {
                   p.tsdf.region = UpdateRegion::FullCube;
                   p.scoring.form = ToolForm::SurfaceSamples;
                 }}),
    [](const auto& tested) { return tested.param.name; });

Case randomCase(std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const auto oneOf = [&](auto... values) {
    const std::array all = {values...};
    return all[random() % all.size()];
  };
  Case test;
  test.seed = seed;
  test.voxel_size_m = oneOf(0.02, 0.03, 0.05, 0.1);
  test.tile_voxels = oneOf(128, 128, 256);
  test.tool = oneOf("builtin:pruner", "builtin:pencil", "lopsided");
  test.source = oneOf(Source::Scans, Source::RayCloud, Source::Stations);
  const double corridor_m = oneOf(0.0, 0.0, 0.4, 1.3), noise_m = oneOf(0.0, 0.02), clamp_m = oneOf(0.0, -0.02);
  const int max_weight = oneOf(7, 4095), threads = oneOf(1, 2);
  const auto region = oneOf(UpdateRegion::DoubleCone, UpdateRegion::FullCube);
  const auto form = oneOf(ToolForm::Voxels, ToolForm::SurfaceSamples);
  test.change = [=](FieldParams& params) {
    params.approach.corridor_length_m = corridor_m;
    params.tsdf.range_noise_m = noise_m;
    params.tsdf.clamp_min_m = clamp_m;
    params.tsdf.max_weight = max_weight;
    params.tsdf.region = region;
    params.scoring.form = form;
    params.threads = threads;
  };
  return test;
}

/// A few worlds; ACCESSVDB_TILE_WORLDS=N for more, ACCESSVDB_TILE_SEED for the first one's seed.
TEST(TilesEqualOnePieceInRandomWorlds, BitForBit) {
  const auto number = [](const char* name, unsigned long fallback) {
    const char* text = std::getenv(name);
    return text == nullptr ? fallback : std::strtoul(text, nullptr, 10);
  };
  const std::uint64_t first = number("ACCESSVDB_TILE_SEED", 100), count = number("ACCESSVDB_TILE_WORLDS", 6);
  std::size_t accessible = 0, blocked = 0;
  for (std::uint64_t seed = first; seed < first + count && !HasFailure(); ++seed) {
    SCOPED_TRACE("ACCESSVDB_TILE_SEED=" + std::to_string(seed));
    const FieldSnapshot all = expectTilesEqual(randomCase(seed));
    accessible += all.count(PointLabel::Accessible);
    blocked += all.count(PointLabel::Blocked);
  }
  EXPECT_GT(accessible, 50u);
  EXPECT_GT(blocked, 50u);
}

/// Differences of all tiles of one world if their input is spoilt.
std::size_t differencesIf(const Case& test, const std::function<void(World&, const Tile&, FieldParams&)>& spoil) {
  const OnePiece one(test);
  std::size_t count = 0;
  for (const Tile& tile : one.tiles()) {
    World spoilt = one.world;
    FieldParams params = one.params;
    params.window = tile.window;
    spoil(spoilt, tile, params);
    count += differences(one.field, one.all, fieldOf(test, params, spoilt), tile);
  }
  return count;
}

/// Leaves the returns at most `margin` voxels from the core.
void narrow(World& world, const Tile& tile, const FieldParams& params, std::int32_t margin) {
  const Eigen::Vector3d origin_W((*params.origin_W)[0], (*params.origin_W)[1], (*params.origin_W)[2]);
  Tile wide = tile;
  for (std::size_t axis = 0; axis < 2; ++axis) {
    wide.window.core_low[axis] -= margin;
    wide.window.core_high[axis] += margin;
  }
  for (Step& step : world) {
    Step kept;
    for (std::size_t n = 0; n < step.points_W.size(); ++n) {
      if (!wide.contains(voxelOf(step.points_W[n], origin_W, params.tsdf.voxel_size_m))) continue;
      kept.points_W.push_back(step.points_W[n]);
      if (step.sensors_W.size() > 1) kept.sensors_W.push_back(step.sensors_W[n]);
    }
    if (step.sensors_W.size() == 1) kept.sensors_W = step.sensors_W;
    step = kept;
  }
}

TEST(TilesDiffer, IfTheHaloIsTooNarrow) {
  const Case test;
  EXPECT_GT(differencesIf(test, [](World& w, const Tile& t, FieldParams& p) { narrow(w, t, p, 0); }), 100u);
  EXPECT_GT(differencesIf(test, [](World& w, const Tile& t, FieldParams& p) { narrow(w, t, p, 10); }), 10u);
  EXPECT_GT(differencesIf(test, [](World& w, const Tile& t, FieldParams& p) { narrow(w, t, p, 20); }), 0u);
}

TEST(TilesDiffer, IfRaysAreClipped) {
  const auto clip = [](World& world, const Tile&, FieldParams&) {
    for (Step& step : world) {
      step.sensors_W.assign(step.points_W.size(), step.sensors_W.front());
      for (std::size_t n = 0; n < step.points_W.size(); ++n) {
        const Eigen::Vector3d to_sensor = step.sensors_W[n] - step.points_W[n];
        if (to_sensor.norm() > 2) step.sensors_W[n] = step.points_W[n] + 2 * to_sensor.normalized();
      }
    }
  };
  EXPECT_GT(differencesIf(Case{}, clip), 100u);
}

TEST(TilesDiffer, IfScansAreJoined) {
  const auto join = [](World& world, const Tile&, FieldParams&) {
    for (Step& step : world) step.sensors_W.assign(step.points_W.size(), step.sensors_W.front());
    for (std::size_t n = 1; n < world.size(); n += 2) {
      Step& before = world[n - 1];
      before.points_W.insert(before.points_W.end(), world[n].points_W.begin(), world[n].points_W.end());
      before.sensors_W.insert(before.sensors_W.end(), world[n].sensors_W.begin(), world[n].sensors_W.end());
      world[n] = {};
    }
  };
  EXPECT_GT(differencesIf(Case{}, join), 100u);
}

TEST(TilesDiffer, IfTheOriginIsAnother) {
  const auto shift = [](World&, const Tile&, FieldParams& params) { (*params.origin_W)[0] += 0.35; };  // 7 voxels
  EXPECT_GT(differencesIf(Case{}, shift), 100u);
}

TEST(TilesDiffer, NotIfNothingIsSpoilt) {
  EXPECT_EQ(differencesIf(Case{}, [](World&, const Tile&, FieldParams&) {}), 0u);
}

TEST(FieldWindow, IsCheckedAndSavesMemory) {
  const Case test;
  const World world = makeWorld(test);
  FieldParams params = paramsOf(test);
  params.window = FieldWindow{{0, 0}, {128, 128}};
  EXPECT_THROW((void)params.resolved(), InvalidArgument);  // no origin
  params.origin_W = {{0, 0, 0}};
  EXPECT_NO_THROW((void)params.resolved());
  for (const FieldWindow& bad :
       {FieldWindow{{0, 0}, {128, 100}}, FieldWindow{{128, 0}, {128, 128}}, FieldWindow{{0, 128}, {128, 0}},
        FieldWindow{{0, 0}, {128, 1 << 21}}, FieldWindow{{std::numeric_limits<std::int32_t>::min(), 0}, {128, 128}}}) {
    params.window = bad;
    EXPECT_THROW((void)params.resolved(), InvalidArgument);
  }
  params.window = FieldWindow{{0, 0}, {128, 128}};
  params.update.policy = UpdatePolicy::Paper;
  EXPECT_THROW((void)params.resolved(), InvalidArgument);
  params.update.policy = UpdatePolicy::Exact;
  params.tsdf.region = UpdateRegion::Projective;
  EXPECT_THROW((void)params.resolved(), InvalidArgument);
  params.tsdf.region = UpdateRegion::DoubleCone;
  const AccessibilityField part = fieldOf(test, params, world);
  FieldParams unlimited = paramsOf(test);
  unlimited.origin_W = params.origin_W;
  const AccessibilityField one = fieldOf(test, unlimited, world);
  EXPECT_LT(part.memoryUse().leaves, one.memoryUse().leaves);
  EXPECT_LT(part.snapshot().points.size(), one.snapshot().points.size());
}

TEST(FieldOrigin, IsRoundedToWholeVoxels) {
  const Case test;
  FieldParams params = paramsOf(test);
  params.origin_W = {{1.02, -3.49, 0.026}};
  const AccessibilityField field(toolOf(test), params);
  const double v = params.tsdf.voxel_size_m;
  EXPECT_EQ(field.origin_W(), Eigen::Vector3d(20 * v, -70 * v, 1 * v));
}

}  // namespace
}  // namespace accessvdb::test

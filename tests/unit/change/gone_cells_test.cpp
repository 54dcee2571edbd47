// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What goes by evidence, and what must not: scenes whose returns are computed here, ray by ray.
#include "change/gone_cells.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <memory>
#include <random>
#include <set>
#include <vector>

#include "tsdf/scan_integrator.h"
#include "unit/points/random_points.h"

namespace accessvdb::internal {
namespace {

constexpr float kVoxel_m = 0.05f;
constexpr float kTau_m = 0.2f, kSigma_m = 0.01f;
using Points = std::vector<Eigen::Vector3f>;

FieldParams fieldParams() {
  FieldParams params = test::pointParams(kVoxel_m, 36);
  params.tsdf.truncation_distance_m = kTau_m;
  params.tsdf.range_noise_m = kSigma_m;
  return params;
}

/// Map, points and evidence, fed as a field feeds them.
class World {
 public:
  World() : params_(fieldParams()), map_(params_.tsdf), points_(params_, test::directionTable(36)) {
    map_.setCollisionDistance(0.5f * kVoxel_m);
    map_.blockNewThings(2.5f * kVoxel_m);
    cells_ = std::make_unique<GoneCells>(map_, points_, params_.tsdf);
    integrator_ = std::make_unique<ScanIntegrator>(map_);
  }

  /// @return voxels that were opened
  std::uint64_t scan(const Points& returns, const Eigen::Vector3f& sensor) {
    const std::vector<std::uint32_t>& touched = points_.addReturns(returns, {&sensor, 1}).all;
    std::uint64_t count = 0;
    const std::unique_ptr<GoneCells> restored = compares_restored_ ? this->restored() : nullptr;
    const std::vector<OpenedLeaf> opened = cells_->takeScan(returns, {&sensor, 1}, touched);
    if (restored) expectSame(opened, restored->takeScan(returns, {&sensor, 1}, touched));
    openVoxels(map_, opened);
    for (const OpenedLeaf& leaf : opened) {
      for (const std::uint64_t word : leaf.voxels) count += static_cast<std::uint64_t>(std::popcount(word));
    }
    integrator_->integrate(returns, {&sensor, 1});
    return count;
  }

  [[nodiscard]] bool collides(const Eigen::Vector3f& p) const {
    const Index3 voxel = points_.voxelOf(p);
    const VoxelState state = map_.at({voxel[0], voxel[1], voxel[2]});
    return state.weight > 0 && state.distance_m < 0.5f * kVoxel_m;
  }
  [[nodiscard]] bool isGone(const Eigen::Vector3f& p) const {
    const auto verdict = cells_->verdictAt(points_.voxelOf(p));
    return verdict.has_value() && *verdict != Verdict::Stands;
  }
  [[nodiscard]] std::size_t cellsGone() const {
    std::size_t count = 0;
    for (const std::uint32_t block : cells_->blocksInOrder()) {
      for (const CellRecord& cell : cells_->cellsOf(block)) count += cell.verdict != Verdict::Stands ? 1 : 0;
    }
    return count;
  }
  [[nodiscard]] const PackedMap& map() const { return map_; }
  [[nodiscard]] const PointStore& points() const { return points_; }
  [[nodiscard]] const GoneCells& cells() const { return *cells_; }
  /// From now on each scan opens what it would open if all had been saved and loaded just before it.
  void compareRestored() { compares_restored_ = true; }

 private:
  [[nodiscard]] std::unique_ptr<GoneCells> restored() const {
    auto cells = std::make_unique<GoneCells>(map_, points_, params_.tsdf);
    for (const std::uint32_t block : cells_->blocksInOrder())
      EXPECT_TRUE(cells->restore(points_.index().blocks()[block].leaf, cells_->cellsOf(block)));
    cells->restoreScans(cells_->scans());
    return cells;
  }
  static void expectSame(const std::vector<OpenedLeaf>& a, const std::vector<OpenedLeaf>& b) {
    ASSERT_EQ(a.size(), b.size());
    for (std::size_t n = 0; n < a.size(); ++n) {
      EXPECT_EQ(a[n].leaf, b[n].leaf);
      EXPECT_EQ(a[n].voxels, b[n].voxels);
    }
  }

  FieldParams params_;
  PackedMap map_;
  PointStore points_;
  std::unique_ptr<GoneCells> cells_;
  std::unique_ptr<ScanIntegrator> integrator_;
  bool compares_restored_ = false;
};

/// A wall at x = 3 m, and before it a board at x = 2 m, 0.4 m wide and high; seen from somewhere around the origin.
class Room {
 public:
  explicit Room(unsigned seed = 1) : random_(seed) {}
  float uniform(float low, float high) { return std::uniform_real_distribution<float>(low, high)(random_); }
  Eigen::Vector3f sensor() { return {0, uniform(-0.15f, 0.15f), uniform(-0.15f, 0.15f)}; }
  /// @param there  the board is
  Points look(const Eigen::Vector3f& sensor, bool there, int rays = 3000, float wall_m = 3) {
    Points returns;
    std::normal_distribution<float> noise(0, 0.3f * kSigma_m);
    for (int n = 0; n < rays; ++n) {
      const Eigen::Vector3f at(wall_m, uniform(-0.5f, 0.5f), uniform(-0.5f, 0.5f)), u = (at - sensor).normalized();
      const float to_board = (2 - sensor.x()) / u.x();
      const Eigen::Vector3f on_board = sensor + to_board * u;
      const bool hits = there && std::abs(on_board.y()) < 0.2f && std::abs(on_board.z()) < 0.2f;
      returns.push_back((hits ? on_board : at) + noise(random_) * u);
    }
    return returns;
  }
  std::mt19937& random() { return random_; }

 private:
  std::mt19937 random_;
};

Points boardPoints() {
  Points points;
  for (int y = -3; y <= 3; ++y) {
    for (int z = -3; z <= 3; ++z)
      points.emplace_back(2.0f, kVoxel_m * static_cast<float>(y), kVoxel_m * static_cast<float>(z));
  }
  return points;
}
int countColliding(const World& world, const Points& points) {
  return static_cast<int>(std::ranges::count_if(points, [&](const auto& p) { return world.collides(p); }));
}

/// Returns on a plane of one x, y and z within half a size of the middle.
Points onPlane(Room& room, float x, float size_m, int rays) {
  Points returns;
  for (int n = 0; n < rays; ++n)
    returns.emplace_back(x + room.uniform(-0.003f, 0.003f), room.uniform(-0.5f, 0.5f) * size_m,
                         room.uniform(-0.5f, 0.5f) * size_m);
  return returns;
}

/// What is near something that had gone is looked at until the next 16th scan, also once that is back, but nothing may
/// open there: a state that is loaded does not know where it was.
TEST(GoneCells, WhatIsBackOpensNothingSavedOrNot) {
  World world;
  Room room;
  int scans = 0;
  const auto look = [&](float x, float size_m, int times, const Eigen::Vector3f& sensor = Eigen::Vector3f::Zero()) {
    std::uint64_t opened = 0;
    for (int n = 0; n < times; ++n, ++scans) {
      const Eigen::Vector3f from = sensor + Eigen::Vector3f(0, room.uniform(-0.1f, 0.1f), room.uniform(-0.1f, 0.1f));
      opened += world.scan(onPlane(room, x, size_m, 3000), from);
    }
    return opened;
  };
  world.compareRestored();
  look(2, 0.4f, 4);
  EXPECT_GT(look(3, 1.2f, 28), 100u);  // it has gone, and after scan 32 nothing is left to open
  ASSERT_EQ(scans, 32);
  ASSERT_TRUE(world.isGone({2, 0, 0}));
  look(1.7f, 0.4f, 2);  // another one before it
  EXPECT_GT(look(3, 1.2f, 6), 100u);
  ASSERT_TRUE(world.isGone({1.7f, 0, 0}));
  look(1.7f, 0.5f, 1);
  ASSERT_FALSE(world.isGone({1.7f, 0, 0}));
  look(2.2f, 0.4f, 2, {2.9f, 0, 0});  // from behind: its shadow is where the first one was
  ASSERT_TRUE(world.isGone({2, 0, 0}));
  ASSERT_TRUE(world.collides({2.05f, 0, 0}));
  Points beside;  // rays from one side to the other, through that shadow
  for (int n = 0; n < 3000; ++n) beside.emplace_back(room.uniform(1.98f, 2.12f), 2.0f, room.uniform(-0.15f, 0.15f));
  world.scan(beside, {2.05f, -2, 0});
  EXPECT_LT(scans, 47);
  EXPECT_TRUE(world.collides({2.05f, 0, 0}));
}

TEST(GoneCells, ABoardThatLeftOpensVoxelByVoxelAndComesBack) {
  World world;
  Room room;
  const Points board = boardPoints();
  for (int n = 0; n < 20; ++n) {
    const Eigen::Vector3f sensor = room.sensor();
    EXPECT_EQ(world.scan(room.look(sensor, true), sensor), 0u);
  }
  ASSERT_EQ(countColliding(world, board), static_cast<int>(board.size()));
  EXPECT_EQ(world.cellsGone(), 0u);
  int scans = 0;
  std::vector<int> left;
  for (; scans < 40 && (left.empty() || left.back() > 0); ++scans) {
    const Eigen::Vector3f sensor = room.sensor();
    const std::uint64_t opened = world.scan(room.look(sensor, false), sensor);
    EXPECT_TRUE(scans >= 3 || opened == 0) << "three scans of evidence at least, and none of them opens";
    left.push_back(countColliding(world, board));
  }
  RecordProperty("scans", std::to_string(scans));
  EXPECT_EQ(left.back(), 0);
  EXPECT_GE(scans, 4);
  // The shadow behind it goes, too.
  for (const Eigen::Vector3f& p : board) EXPECT_FALSE(world.collides(p + Eigen::Vector3f(0.1f, 0, 0)));
  // One return brings its own voxel back at once.
  const Eigen::Vector3f sensor = room.sensor();
  world.scan(room.look(sensor, true), sensor);
  EXPECT_GT(countColliding(world, board), static_cast<int>(board.size() / 2));
  for (const Eigen::Vector3f& p : board) EXPECT_FALSE(world.isGone(p));
}

/// (c) A verdict frees nothing by itself: voxels through which no ray has come keep colliding.
TEST(GoneCells, OnlyTheVoxelThatARayCrossesOpens) {
  World world;
  Room room;
  for (int n = 0; n < 20; ++n) {
    const Eigen::Vector3f sensor = room.sensor();
    world.scan(room.look(sensor, true), sensor);
  }
  const Points board = boardPoints();
  std::set<Index3> crossed;
  for (int n = 0; n < 40; ++n) {
    const Eigen::Vector3f sensor = room.sensor();
    Points returns = room.look(sensor, false, 6000);
    // No ray comes through the upper third of the board, which was seen before.
    std::erase_if(returns, [&](const Eigen::Vector3f& p) {
      const Eigen::Vector3f u = p - sensor;
      return sensor.z() + u.z() * (1.7f - sensor.x()) / u.x() > 0.06f ||
             sensor.z() + u.z() * (2.3f - sensor.x()) / u.x() > 0.06f;
    });
    world.scan(returns, sensor);
  }
  int opened = 0;
  for (const Eigen::Vector3f& p : board) {
    if (p.z() > 0.08f) {
      EXPECT_TRUE(world.collides(p)) << p.transpose();
    } else if (p.z() < 0.0f) {
      opened += world.collides(p) ? 0 : 1;
    }
  }
  EXPECT_GT(opened, 15);
}

/// (a) One line, however often: a thin twig that these beams miss, seen from a second place.
TEST(GoneCells, ManyEqualRaysAreOneLine) {
  for (const bool equal : {true, false}) {
    World world;
    Room room;
    const Eigen::Vector3f twig(2, 0, 0), first(0, 1.5f, 0), second(0, 0, 0);
    std::normal_distribution<float> noise(0, 0.004f);
    for (int n = 0; n < 60; ++n) {
      Points returns;
      for (int k = 0; k < 5; ++k)
        returns.push_back(twig + Eigen::Vector3f(0, noise(room.random()), noise(room.random())));
      world.scan(returns, first);
    }
    ASSERT_TRUE(world.collides(twig));
    for (int n = 0; n < 1000; ++n) {
      // Through the twig's voxel, 1 cm beside it; in the other world anywhere within 2 cm of it.
      const Eigen::Vector3f through =
          twig + (equal ? Eigen::Vector3f(0, 0.01f, 0)
                        : Eigen::Vector3f(0, room.uniform(-0.02f, 0.02f), room.uniform(-0.02f, 0.02f)));
      world.scan({second + (through - second) * 1.5f}, second);
    }
    EXPECT_EQ(world.isGone(twig), !equal);
    EXPECT_EQ(world.collides(twig), equal);
  }
}

/// (b) A wall through the corners of voxels, and rays along it through their middles: none of them comes near the wall.
TEST(GoneCells, RaysAlongAWallTakeNothingAway) {
  World world;
  Room room;
  const float wall_x = 1.0f + 0.3f * kVoxel_m;  // in the voxels around x = 1 m
  for (int n = 0; n < 40; ++n) {
    Points returns;
    for (int k = 0; k < 400; ++k) returns.emplace_back(wall_x, room.uniform(-0.5f, 0.5f), room.uniform(-0.5f, 0.5f));
    world.scan(returns, {0, 0, 0});
  }
  ASSERT_TRUE(world.collides({1, 0, 0}));
  for (int n = 0; n < 300; ++n) {
    // From many places, so that the rays are many lines.
    const Eigen::Vector3f sensor(1.0f - room.uniform(0.28f, 0.4f) * kVoxel_m, -3, room.uniform(-0.6f, 0.6f));
    Points returns;
    for (int k = 0; k < 200; ++k) returns.emplace_back(sensor.x(), 3.0f, room.uniform(-0.4f, 0.4f));
    EXPECT_EQ(world.scan(returns, sensor), 0u);
  }
  EXPECT_EQ(world.cellsGone(), 0u);
}

/// (d) A background within tau + 3 sigma says nothing: its returns may be noise of the thing itself.
TEST(GoneCells, ReturnsJustBehindAreNoPasses) {
  for (const float behind_m : {0.08f, kTau_m + 3 * kSigma_m - 0.02f, kTau_m + 3 * kSigma_m + 0.05f}) {
    World world;
    Room room;
    for (int n = 0; n < 60; ++n) {
      const Eigen::Vector3f sensor = room.sensor();
      world.scan(room.look(sensor, n < 20, 3000, 2 + behind_m), sensor);
    }
    EXPECT_EQ(world.cellsGone() > 0, behind_m > kTau_m + 3 * kSigma_m) << behind_m;
  }
}

/// (e) A hit in the same scan wins, whichever comes first.
TEST(GoneCells, AHitInTheSameScanWins) {
  for (const bool hits_first : {false, true}) {
    World world;
    Room room;
    for (int n = 0; n < 20; ++n) {
      const Eigen::Vector3f sensor = room.sensor();
      world.scan(room.look(sensor, true), sensor);
    }
    for (int n = 0; n < 200; ++n) {
      const Eigen::Vector3f sensor = room.sensor();
      Points returns = room.look(sensor, false);
      // One return in each voxel of the board's cells.
      Points hits;
      for (int k = 0; k < 144; ++k) {
        hits.emplace_back(2.0f, kVoxel_m * static_cast<float>(k / 12 - 6), kVoxel_m * static_cast<float>(k % 12 - 6));
      }
      returns.insert(hits_first ? returns.begin() : returns.end(), hits.begin(), hits.end());
      EXPECT_EQ(world.scan(returns, sensor), 0u);
    }
    EXPECT_EQ(world.cellsGone(), 0u);
  }
}

/// (f) Foliage that returns one ray in twenty stays, for 6 000 lines a cell. Runs of 66 misses come dozens of times.
TEST(GoneCells, FoliageStays) {
  World world;
  Room room;
  constexpr int kSide = 14;
  const auto leafAt = [](int n) {
    return Eigen::Vector3f(2, 0.2f * static_cast<float>(n % kSide - kSide / 2) + 0.05f,
                           0.2f * static_cast<float>(n / kSide - kSide / 2) + 0.05f);
  };
  std::uint64_t rays = 0;
  int longest = 0;
  std::array<int, kSide* kSide> run = {};
  for (int scan = 0; scan < 1500; ++scan) {
    const Eigen::Vector3f sensor(0, room.uniform(-0.8f, 0.8f), room.uniform(-0.8f, 0.8f));
    Points returns;
    for (int n = 0; n < kSide * kSide; ++n) {
      for (int k = 0; k < 4; ++k) {
        const Eigen::Vector3f through =
            leafAt(n) + Eigen::Vector3f(0, room.uniform(-0.02f, 0.02f), room.uniform(-0.02f, 0.02f));
        const bool hits = room.uniform(0, 1) < 0.05f;
        returns.push_back(hits ? through : Eigen::Vector3f(sensor + 1.5f * (through - sensor)));
        ++rays;
        auto& misses = run[static_cast<std::size_t>(n)];
        misses = hits ? 0 : misses + 1;
        longest = std::max(longest, misses);
      }
    }
    world.scan(returns, sensor);
    ASSERT_EQ(world.cellsGone(), 0u) << scan;
  }
  EXPECT_GE(rays, 6000u * kSide * kSide);
  EXPECT_GT(longest, 66);
}

/// (h) Rays without a return say nothing: nothing behind, nothing gone.
TEST(GoneCells, OpenSkyOpensNothing) {
  World world;
  Room room;
  for (int n = 0; n < 60; ++n) {
    const Eigen::Vector3f sensor = room.sensor();
    Points returns = room.look(sensor, n < 20);
    if (n >= 20) std::erase_if(returns, [](const Eigen::Vector3f& p) { return std::abs(p.y()) < 0.45f; });
    EXPECT_EQ(world.scan(returns, sensor), 0u);
  }
  EXPECT_EQ(world.cellsGone(), 0u);
}

/// The order of the rays within a scan does not matter.
TEST(GoneCells, OrderWithinAScanDoesNotMatter) {
  World a, b;
  Room room;
  std::mt19937 shuffle(3);
  std::uint64_t opened = 0;
  for (int n = 0; n < 45; ++n) {
    const Eigen::Vector3f sensor = room.sensor();
    Points returns = room.look(sensor, n < 20 || n == 33);
    const std::uint64_t of_a = a.scan(returns, sensor);
    std::shuffle(returns.begin(), returns.end(), shuffle);
    ASSERT_EQ(b.scan(returns, sensor), of_a);
    opened += of_a;
  }
  EXPECT_GT(opened, 50u);
  for (auto leaf = a.map().tree().cbeginLeaf(); leaf; ++leaf) {
    for (openvdb::Index n = 0; n < PackedLeaf::SIZE; ++n) {
      const openvdb::Coord ijk = leaf->offsetToGlobalCoord(n);
      const VoxelState of_a = a.map().at(ijk), of_b = b.map().at(ijk);
      ASSERT_EQ(of_a.weight, of_b.weight);
      ASSERT_EQ(of_a.cleared, of_b.cleared);
      ASSERT_EQ(of_a.distance_m, of_b.distance_m);
    }
  }
  const auto of_a = a.cells().blocksInOrder(), of_b = b.cells().blocksInOrder();
  ASSERT_EQ(of_a.size(), of_b.size());
  for (std::size_t n = 0; n < of_a.size(); ++n) EXPECT_EQ(a.cells().cellsOf(of_a[n]), b.cells().cellsOf(of_b[n]));
}

}  // namespace
}  // namespace accessvdb::internal

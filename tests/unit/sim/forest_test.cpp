// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The benchmarks' forest: placed meshes against the same triangles copied, frames of a fixed size, a free lane.
#include "sim/forest.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <vector>

#include "accessvdb/error.h"
#include "sim/counter_random.h"
#include "sim/scene.h"
#include "sim/simulator.h"
#include "sim/understory.h"

namespace accessvdb::sim {
namespace {

using Eigen::Vector3d, Eigen::Vector3f;

bool sameBytes(const std::vector<Vector3f>& a, const std::vector<Vector3f>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(Vector3f)) == 0;
}

TEST(PlacedMeshes, RangesAreThoseOfTheCopiedTriangles) {
  const std::vector<TriangleMesh> meshes = {makeBox({0.4, 1.2, 0.8}).mesh, makeUndergrowth(3)};
  std::vector<PlacedMesh> placed;
  TriangleMesh copied;
  CounterRandom random({7});
  for (int n = 0; n < 20; ++n) {
    PlacedMesh each{static_cast<std::uint32_t>(n % 2), random.uniform(-4, 4), {}};
    for (double& x : each.offset_W) x = random.uniform(-5, 5);
    placed.push_back(each);
    const auto first = static_cast<std::uint32_t>(copied.vertices_W.size());
    const double c = std::cos(each.yaw_rad), s = std::sin(each.yaw_rad);
    for (const Vector3f& v : meshes[each.mesh].vertices_W) {
      const Vector3d p = v.cast<double>();
      copied.vertices_W.push_back(
          (Vector3d(c * p.x() - s * p.y(), s * p.x() + c * p.y(), p.z()) + each.offset_W).cast<float>());
    }
    for (const auto& t : meshes[each.mesh].triangles) {
      copied.triangles.push_back({first + t[0], first + t[1], first + t[2]});
    }
  }
  const RayCaster instanced(meshes, placed), flat(copied);
  const Vector3d origin(0.1, -0.2, 9);
  std::vector<Vector3f> directions(20000);
  for (Vector3f& direction : directions) {
    direction = (Vector3d(random.uniform(-6, 6), random.uniform(-6, 6), random.uniform(-6, 6)) - origin)
                    .normalized()
                    .cast<float>();
  }
  std::vector<float> a(directions.size()), b(directions.size());
  instanced.cast(origin, directions, a);
  flat.cast(origin, directions, b);
  int hits = 0, differ = 0;
  for (std::size_t n = 0; n < a.size(); ++n) {
    hits += std::isfinite(b[n]) ? 1 : 0;
    // Vertices rounded to float at 10 m are 1e-6 m off, more along a plane met almost edge-on; rays that pass
    // within as much of an edge may hit in one and miss in the other.
    if (!(std::abs(a[n] - b[n]) < 1e-4) && std::isfinite(a[n]) + std::isfinite(b[n]) > 0) ++differ;
  }
  EXPECT_GT(hits, 2000);
  EXPECT_LT(hits, 18000) << "rays must also miss, or every ray would be a hit by mistake";
  EXPECT_LE(differ, 10);
}

TEST(PlacedMeshes, RefusesWhatCannotStandAnywhere) {
  const std::vector<TriangleMesh> box = {makeBox({1, 1, 1}).mesh};
  EXPECT_THROW(RayCaster(box, {}), InvalidArgument);
  const PlacedMesh none{1, 0, {0, 0, 0}}, nowhere{0, 0, {NAN, 0, 0}};
  EXPECT_THROW(RayCaster(box, {&none, 1}), InvalidArgument);
  EXPECT_THROW(RayCaster(box, {&nowhere, 1}), InvalidArgument);
}

TEST(FrameOfReturns, HoldsTheFirstRaysThatComeBack) {
  LidarModel model;
  model.rays_per_frame = 4000;
  model.range_noise_m = 0.01;
  Helix shape;
  shape.radius_m = 2;
  const Simulator simulator(makeBox({0.02, 3, 3}, "wall"), model, orbit(shape, 3), 5);
  for (int frame = 0; frame < 3; ++frame) {
    std::vector<Vector3f> all;
    for (const Vector3f& p : simulator.frame(frame).points_S) {
      if (!p.isZero(0)) all.push_back(p);
    }
    ASSERT_GT(all.size(), 100u);
    const auto exact = simulator.frameOfReturns(frame, 100).points_S;
    all.resize(100);
    EXPECT_TRUE(sameBytes(exact, all)) << frame;
    EXPECT_TRUE(sameBytes(simulator.framesOfReturns(frame, frame + 1, 100).front().points_S, exact));
  }
  EXPECT_THROW((void)simulator.frameOfReturns(0, 4000), UnusableInput) << "the sky does not come back";
  EXPECT_THROW((void)simulator.frameOfReturns(0, 0), InvalidArgument);
  EXPECT_THROW((void)simulator.frameOfReturns(3, 10), InvalidArgument);
}

TEST(GroundTile, ContinuesInTheNext) {
  const TriangleMesh tile = makeGroundTile();
  for (const double at : {0.3, 4.7, 11.9}) {
    EXPECT_NEAR(groundHeight_m(at, 0), groundHeight_m(at, kGroundPeriod_m), 1e-9);
    EXPECT_NEAR(groundHeight_m(0, at), groundHeight_m(kGroundPeriod_m, at), 1e-9);
  }
  float lowest = 1, highest = -1;
  for (const Vector3f& v : tile.vertices_W) {
    EXPECT_NEAR(v.z(), groundHeight_m(v.x(), v.y()), 1e-4);
    lowest = std::min(lowest, v.z());
    highest = std::max(highest, v.z());
  }
  EXPECT_GT(highest - lowest, 0.2f) << "uneven";
  EXPECT_LT(std::max(highest, -lowest), 0.45f);
  // Seen from above, the tile is covered to its edges. Between its vertices, 6 cm apart, the shortest waves (16 cm, 8
  // mm high) leave the chords by h (2 pi / lambda)^2 d^2 / 8 = 12 mm at most over a diagonal, all waves together by 30
  // mm.
  const RayCaster caster(tile);
  const Vector3f down(0, 0, -1);
  for (double x = 0.001; x < kGroundPeriod_m; x += 0.731) {
    float range_m = 0;
    caster.cast({x, kGroundPeriod_m - x, 2}, {&down, 1}, {&range_m, 1});
    EXPECT_NEAR(range_m, 2 - groundHeight_m(x, kGroundPeriod_m - x), 0.03);
  }
}

/// 30 m of flight through solid foliage, as in bench.
struct Flight {
  ForestParams params;
  Forest forest;
  explicit Flight(double view_m) {
    params.path_length_m = 30;
    params.view_m = view_m;
    params.solid_foliage_m = 0.05;
    forest = makeForest(params);
  }
  [[nodiscard]] Simulator simulator(int frames, int returns) const {
    LidarModel model;
    model.rays_per_frame = 8 * returns;
    model.max_range_m = params.view_m;
    return Simulator(RayCaster(forest.meshes, forest.placed), "forest", model, forestFlight(1, 0.1, frames), 1);
  }
};

TEST(Forest, FlightIsFreeNeverTheSameAndRepeatable) {
  const Flight flight(10);
  EXPECT_GT(flight.forest.trees, 40u);
  const Simulator simulator = flight.simulator(300, 500);
  EXPECT_NO_THROW(simulator.requireClearPath(forestFlight(1, 0.1, 300)));

  const Trajectory path = forestFlight(1, 0.1, 300), longer = forestFlight(1, 0.1, 900);
  for (std::size_t n = 1; n < path.size(); ++n) {
    const double step_m = (path[n].translation() - path[n - 1].translation()).norm();
    EXPECT_GT(step_m, 0.09);
    EXPECT_LT(step_m, 0.12) << "walking pace";
    EXPECT_GT(path[n].translation().x(), path[n - 1].translation().x());
    EXPECT_EQ(path[n].matrix(), longer[n].matrix()) << "a longer flight begins with the shorter one";
    EXPECT_NEAR(path[n].linear().determinant(), 1, 1e-12);
  }

  for (const int frame : {0, 150, 299}) {
    const SimulatedFrame scan = simulator.frameOfReturns(frame, 500);
    EXPECT_EQ(scan.points_S.size(), 500u);
    double farthest_m = 0;
    for (const Vector3f& p : scan.points_S) farthest_m = std::max(farthest_m, double(p.norm()));
    EXPECT_LE(farthest_m, 10);
    EXPECT_GT(farthest_m, 5);
  }

  const Flight again(10);
  ASSERT_EQ(again.forest.placed.size(), flight.forest.placed.size());
  for (std::size_t n = 0; n < again.forest.placed.size(); ++n) {
    EXPECT_EQ(again.forest.placed[n].mesh, flight.forest.placed[n].mesh);
    EXPECT_EQ(again.forest.placed[n].offset_W, flight.forest.placed[n].offset_W);
  }
  for (std::size_t n = 0; n < again.forest.meshes.size(); ++n) {
    EXPECT_TRUE(sameBytes(again.forest.meshes[n].vertices_W, flight.forest.meshes[n].vertices_W)) << n;
  }
}

TEST(Forest, OrbitIsFreeAndLooksAtTheGroup) {
  ForestParams params;
  params.path_length_m = 1;
  params.view_m = 11;  // 6 m as at 5 mm, from 5 m around
  params.solid_foliage_m = 0.05;
  params.clearing = true;
  const Forest forest = makeForest(params);
  constexpr int kLapsFrames = 943;  // three laps of 31.4 m at 1 m/s, 10 frames per second
  const Trajectory path = forestOrbit(1, 0.1, kLapsFrames), longer = forestOrbit(1, 0.1, 2 * kLapsFrames);
  LidarModel model;
  model.rays_per_frame = 24 * 2500;
  model.max_range_m = 6;
  const RayCaster caster(forest.meshes, forest.placed);
  const Simulator simulator(RayCaster(forest.meshes, forest.placed), "forest", model, path, 1);
  EXPECT_NO_THROW(simulator.requireClearPath(path));
  double lowest_m = 99, highest_m = 0, nearest_m = 99;
  std::vector<Vector3f> all_around;
  CounterRandom random({11});
  for (int n = 0; n < 400; ++n) {
    all_around.push_back(
        Vector3d(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1)).normalized().cast<float>());
  }
  std::vector<float> ranges_m(all_around.size());
  for (std::size_t n = 0; n < path.size(); ++n) {
    EXPECT_EQ(path[n].matrix(), longer[n].matrix()) << "a longer orbit begins with the shorter one";
    EXPECT_NEAR(path[n].linear().determinant(), 1, 1e-12);
    const Vector3d p_W = path[n].translation();
    EXPECT_NEAR(p_W.head<2>().norm(), 5, 0.21);
    lowest_m = std::min(lowest_m, p_W.z());
    highest_m = std::max(highest_m, p_W.z());
    // The middle of the group is straight ahead, and near the middle of the view of a Mid-360.
    const Vector3d middle_S = path[n].inverse() * Vector3d(0, 0, 3.75);
    EXPECT_GT(middle_S.x(), 0);
    EXPECT_LT(std::abs(std::atan2(middle_S.y(), middle_S.x())) * 180 / std::numbers::pi, 5);
    EXPECT_NEAR(std::asin(middle_S.z() / middle_S.norm()) * 180 / std::numbers::pi, 22.5, 4);
    if (n > 0) {
      const double step_m = (p_W - path[n - 1].translation()).norm();
      EXPECT_GT(step_m, 0.09);
      EXPECT_LT(step_m, 0.115);
    }
    if (n % 10 != 0) continue;
    caster.cast(p_W, all_around, ranges_m);
    nearest_m = std::min(nearest_m, double(*std::min_element(ranges_m.begin(), ranges_m.end())));
  }
  EXPECT_NEAR(lowest_m, 1.5, 0.01);
  EXPECT_NEAR(highest_m, 6, 0.01);
  EXPECT_GT(nearest_m, 0.4) << "room for a drone";
  for (int frame = 0; frame < kLapsFrames; frame += 37) {
    EXPECT_EQ(simulator.frameOfReturns(frame, 2500).points_S.size(), 2500u);
  }
}

TEST(Forest, RefusesBadSizes) {
  for (const double bad : {0.0, -1.0, 2e4, std::nan("")}) {
    ForestParams params;
    params.path_length_m = bad;
    EXPECT_THROW((void)makeForest(params), InvalidArgument);
    params = {};
    params.view_m = bad;
    EXPECT_THROW((void)makeForest(params), InvalidArgument);
  }
  EXPECT_THROW((void)forestFlight(0, 0.1, 5), InvalidArgument);
  EXPECT_THROW((void)forestFlight(1, std::nan(""), 5), InvalidArgument);
  EXPECT_THROW((void)forestFlight(1, 0.1, 0), UnusableInput);
  EXPECT_THROW((void)forestOrbit(-1, 0.1, 5), InvalidArgument);
  EXPECT_THROW((void)forestOrbit(1, 0.1, 0), UnusableInput);
}

}  // namespace
}  // namespace accessvdb::sim

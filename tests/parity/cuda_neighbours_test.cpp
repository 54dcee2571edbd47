// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// The neighbours of points in awkward places, on the GPU against the CPU: at equal distances, too many for a block of
// threads, so close to a plane through the origin that their positions are no integers, or too few. Streams of a walk
// hardly have any of them.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "hostdev/surface_choice.h"
#include "parity/gpu_test.h"
#include "support/determinism_support.h"

namespace accessvdb::test {
namespace {

constexpr double kVoxel_m = 0.05;
constexpr int kFrames = 4;

/// Returns in the middle of voxels, seen from the origin.
std::vector<Eigen::Vector3f> awkwardPlaces() {
  std::vector<Eigen::Vector3f> places;
  const auto add = [&](double x, double y, double z) { places.emplace_back(Eigen::Vector3d(x, y, z).cast<float>()); };
  // A wall: many neighbours at the same distance.
  for (int x = -10; x <= 10; ++x) {
    for (int z = -10; z <= 10; ++z) add(x * kVoxel_m, 1.5, z * kVoxel_m);
  }
  // A solid ball: more points around a block than are gathered, even around a cell.
  constexpr int kRadius = 9;
  for (int x = -kRadius; x <= kRadius; ++x) {
    for (int y = -kRadius; y <= kRadius; ++y) {
      for (int z = -kRadius; z <= kRadius; ++z) {
        if (x * x + y * y + z * z <= kRadius * kRadius) add(x * kVoxel_m, 2.5 + y * kVoxel_m, z * kVoxel_m);
      }
    }
  }
  // Rows at, and just beside, a plane through the origin.
  for (int z = -10; z <= 10; ++z) {
    add(0, 1.0, z * kVoxel_m);
    add(1e-7, 1.1, z * kVoxel_m);
    add(-1e-7, 1.2, z * kVoxel_m);
  }
  // Points with few neighbours.
  for (int n = 0; n < 4; ++n) add(2 + n * kVoxel_m, 2, 0.5);
  add(-2, 2, 1);
  return places;
}

/// First all of the places, then about half of them again, away from the middle: their means move.
std::vector<std::vector<Eigen::Vector3f>> awkwardScans() {
  const std::vector<Eigen::Vector3f> places = awkwardPlaces();
  std::vector<std::vector<Eigen::Vector3f>> scans = {places};
  std::mt19937_64 random(11);
  while (static_cast<int>(scans.size()) < kFrames) {
    std::vector<Eigen::Vector3f>& scan = scans.emplace_back();
    for (const Eigen::Vector3f& place : places) {
      if (random() % 2 == 0) continue;
      const auto off = [&] { return static_cast<float>(uniform(random, -0.4, 0.4) * kVoxel_m); };
      const float x = place.x() == 0 || std::abs(place.x()) > 1e-6f ? place.x() + off() : place.x();
      scan.emplace_back(x, place.y() + off(), place.z() + off());
    }
  }
  return scans;
}

struct NeighboursCase {
  int neighbours;
  double spacing_m = 0;  ///< of the points that are scored
};
void PrintTo(const NeighboursCase& c, std::ostream* out) {
  *out << c.neighbours << " neighbours, points " << c.spacing_m << " m apart";
}

AccessibilityField fieldWith(const NeighboursCase& c, BackendKind backend) {
  FieldParams params;
  params.tsdf.voxel_size_m = kVoxel_m;
  params.origin_W = {0, 0, 0};
  params.scoring.neighbours = c.neighbours;
  params.scoring.point_spacing_m = c.spacing_m;
  params.approach.num_directions = 36;
  params.backend = backend;
  return AccessibilityField(ToolGeometry::builtin("builtin:pencil"), params);
}

class CudaNeighbours : public GpuTest, public testing::WithParamInterface<NeighboursCase> {};

TEST_P(CudaNeighbours, AreThoseOfTheCpuInAwkwardPlaces) {
  AccessibilityField cpu = fieldWith(GetParam(), BackendKind::Cpu), cuda = fieldWith(GetParam(), BackendKind::Cuda);
  int frame = 0;
  for (const std::vector<Eigen::Vector3f>& scan : awkwardScans()) {
    SCOPED_TRACE("frame " + std::to_string(frame++));
    for (AccessibilityField* field : {&cpu, &cuda}) field->integrateScan(scan, Eigen::Isometry3d::Identity());
    const UpdateStats a = cpu.update(), b = cuda.update();
    ASSERT_EQ(a.label_changes, b.label_changes);
    expectSame(cpu.snapshot(), cuda.snapshot());
    if (HasFatalFailure()) return;
  }
  expectSame(cpu.evaluateFromScratch(), cuda.evaluateFromScratch());
}

// Around the most neighbours that are found cell by cell (kMostNeighboursByCell is 220).
INSTANTIATE_TEST_SUITE_P(Neighbours, CudaNeighbours,
                         testing::Values(NeighboursCase{3}, NeighboursCase{20}, NeighboursCase{100},
                                         NeighboursCase{220}, NeighboursCase{221}, NeighboursCase{500}));
// Many points of a cell at the same height, with as many returns: voxels decide.
constexpr NeighboursCase kOfTheSurface[] = {{3, 0.2}, {20, 0.05}, {100, 0.1}, {221, 0.2}};
INSTANTIATE_TEST_SUITE_P(OfTheSurface, CudaNeighbours, testing::ValuesIn(kOfTheSurface));

/// The most points in the cell of a point on the surface, on its side: what it competes with, and some beyond the
/// window.
std::size_t mostInACell(const FieldSnapshot& field, double spacing_m) {
  const auto choice = kernels::SurfaceChoice::of(kVoxel_m, spacing_m, spacing_m);
  struct Place {
    std::int32_t voxel[3];
    Eigen::Vector3d p;
  };
  std::vector<Place> places;
  for (const SurfacePoint& point : field.points) {
    Place& place = places.emplace_back();
    place.p = point.position_W;
    for (int axis = 0; axis < 3; ++axis) {
      place.voxel[axis] = static_cast<std::int32_t>(std::floor(place.p[axis] / kVoxel_m + 0.5));
    }
  }
  std::size_t most = 0;
  for (std::size_t n = 0; n < places.size(); ++n) {
    if (field.points[n].label == PointLabel::Unscored) continue;
    int axis = 0;
    field.points[n].normal_W.cwiseAbs().maxCoeff(&axis);
    const kernels::CompetingVoxels cell(choice, places[n].voxel, axis);
    most = std::max(most, static_cast<std::size_t>(std::ranges::count_if(places, [&](const Place& other) {
                      return cell.hold(other.voxel) && (other.p[axis] > 0) == (places[n].p[axis] > 0);
                    })));
  }
  return most;
}

/// As the one below. The first has more points to a cell than a warp lists (kMostListed in competition.cu).
TEST(AwkwardNeighbours, HavePointsBesideTheSurfaceAndOthers) {
  for (const NeighboursCase& c : kOfTheSurface) {
    SCOPED_TRACE(testing::PrintToString(c));
    AccessibilityField field = fieldWith(c, BackendKind::Cpu);
    for (const std::vector<Eigen::Vector3f>& scan : awkwardScans()) {
      field.integrateScan(scan, Eigen::Isometry3d::Identity());
      field.update();
    }
    const FieldSnapshot now = field.snapshot();
    EXPECT_GT(now.reasons()[static_cast<std::size_t>(PointReason::BesideSurface)], 500u);
    EXPECT_GT(now.count(PointLabel::Accessible) + now.count(PointLabel::Blocked), 30u);
    if (&c == kOfTheSurface) {
      EXPECT_GT(mostInACell(now, c.spacing_m), 128u);
    }
  }
}

/// Checks that the places contain what they must show. Needs no GPU.
TEST(AwkwardNeighbours, GiveNormalsThatChange) {
  AccessibilityField field = fieldWith({20}, BackendKind::Cpu);
  FieldSnapshot before;
  for (const std::vector<Eigen::Vector3f>& scan : awkwardScans()) {
    field.integrateScan(scan, Eigen::Isometry3d::Identity());
    field.update();
    FieldSnapshot now = field.snapshot();
    std::size_t with_normal = 0, beside_plane = 0, changed = 0;
    for (std::size_t n = 0; n < now.points.size(); ++n) {
      const SurfacePoint& point = now.points[n];
      if (point.normal_W.isZero()) continue;
      ++with_normal;
      const double from_plane = std::abs(point.position_W.x());
      beside_plane += from_plane > 0 && from_plane < 1e-6 ? 1 : 0;
      changed += n < before.points.size() && before.points[n].normal_W != point.normal_W ? 1 : 0;
    }
    EXPECT_GT(with_normal, 3000u);
    EXPECT_GT(beside_plane, 30u);
    if (!before.points.empty()) {
      EXPECT_GT(changed, 1000u);
    }
    before = std::move(now);
  }
}

}  // namespace
}  // namespace accessvdb::test

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The level set of the surface against analytic shapes: sign, distance, band, the space beyond it, and its mesh.
#include <gtest/gtest.h>
#include <openvdb/tools/Diagnostics.h>
#include <openvdb/tools/VolumeToMesh.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <random>

#include "io/results/surface_level_set.h"

namespace accessvdb {
namespace {

using openvdb::Coord;
using openvdb::Vec3d;

constexpr double kShapeVoxel_m = 0.01;
constexpr double kBand = 3.0;     // voxels
constexpr double kSupport = 2.0;  // voxels: points blended into a distance, along the surface
const Eigen::Vector3d kShapeOrigin_W = {12.0, -7.0, 3.0};
// Not on a voxel centre on any axis.
const Eigen::Vector3d kCentre = {3.31, -5.72, 1.14};

/// A surface: points and outward normals over the unit square, and its exact signed distance. Lengths are voxels.
struct Shape {
  std::function<void(double, double, Eigen::Vector3d&, Eigen::Vector3d&)> at;
  std::function<double(const Eigen::Vector3d&)> distance;
  double area = 0;
  double least_radius = 0;  ///< least radius of curvature
};

Shape sphere(double radius) {
  Shape shape;
  shape.at = [radius](double s, double t, Eigen::Vector3d& p, Eigen::Vector3d& n) {
    const double z = 2 * s - 1, r = std::sqrt(std::max(0.0, 1 - z * z)), phi = 2 * M_PI * t;
    n = {r * std::cos(phi), r * std::sin(phi), z};
    p = kCentre + radius * n;
  };
  shape.distance = [radius](const Eigen::Vector3d& p) { return (p - kCentre).norm() - radius; };
  shape.area = 4 * M_PI * radius * radius;
  shape.least_radius = radius;
  return shape;
}

Shape torus(double ring, double tube) {
  Shape shape;
  shape.at = [ring, tube](double s, double t, Eigen::Vector3d& p, Eigen::Vector3d& n) {
    const double phi = 2 * M_PI * s, theta = 2 * M_PI * t;
    n = {std::cos(theta) * std::cos(phi), std::cos(theta) * std::sin(phi), std::sin(theta)};
    p = kCentre + ring * Eigen::Vector3d(std::cos(phi), std::sin(phi), 0) + tube * n;
  };
  shape.distance = [ring, tube](const Eigen::Vector3d& p) {
    const Eigen::Vector3d q = p - kCentre;
    return std::hypot(std::hypot(q.x(), q.y()) - ring, q.z()) - tube;
  };
  shape.area = 4 * M_PI * M_PI * ring * tube;
  shape.least_radius = tube;
  return shape;
}

/// About `density` points per square voxel; the first in each voxel is kept, as in a field.
FieldSnapshot sampled(const Shape& shape, double density = 4,
                      const std::function<bool(const Eigen::Vector3d&)>& keep = {}, double normal_sign = 1) {
  FieldSnapshot field;
  field.origin_W = kShapeOrigin_W;
  field.voxel_size_m = kShapeVoxel_m;
  std::map<std::array<int, 3>, bool> taken;
  const int count = static_cast<int>(density * shape.area);
  for (int n = 0; n < count; ++n) {
    Eigen::Vector3d p, normal;
    // Low-discrepancy points of the plastic number.
    shape.at(std::fmod(0.5 + n * 0.7548776662466927, 1.0), std::fmod(0.5 + n * 0.5698402909980532, 1.0), p, normal);
    if (keep && !keep(p)) continue;
    const std::array<int, 3> voxel = {static_cast<int>(std::floor(p.x() + 0.5)),
                                      static_cast<int>(std::floor(p.y() + 0.5)),
                                      static_cast<int>(std::floor(p.z() + 0.5))};
    if (!taken.emplace(voxel, true).second) continue;
    SurfacePoint point;
    point.id = static_cast<std::uint32_t>(field.points.size());
    point.position_W = kShapeOrigin_W + kShapeVoxel_m * p;
    point.normal_W = (normal_sign * normal).cast<float>();
    field.points.push_back(point);
  }
  return field;
}

openvdb::FloatGrid::Ptr levelSetOf(const FieldSnapshot& field) {
  openvdb::initialize();
  const SnapshotPoints points(field);
  return internal::surfaceLevelSet(points, internal::SurfaceVoxels(points));
}

Eigen::Vector3d positionOf(const Coord& ijk) { return {1.0 * ijk.x(), 1.0 * ijk.y(), 1.0 * ijk.z()}; }

/// Tangent planes of points up to s away along a surface of radius R miss it by up to s^2 / 2R, seen from the inner end
/// of the band; the floats add a few 1e-6.
double boundOf(const Shape& shape) { return kSupport * kSupport / (2 * (shape.least_radius - kBand)) + 1e-4; }

void expectSolid(const Shape& shape, const openvdb::FloatGrid& grid) {
  const double bound = boundOf(shape);
  const float background = grid.background();
  EXPECT_EQ(grid.getGridClass(), openvdb::GRID_LEVEL_SET);
  EXPECT_FLOAT_EQ(background, static_cast<float>(kBand * kShapeVoxel_m));
  double worst = 0;
  std::uint64_t wrong_sign = 0, missing = 0, beyond = 0, wrong_side = 0;
  openvdb::CoordBBox box = grid.evalActiveVoxelBoundingBox();
  box.expand(20);
  const auto read = grid.getConstAccessor();
  for (auto at = box.begin(); at; ++at) {
    const double exact = shape.distance(positionOf(*at));
    const double value = read.getValue(*at) / kShapeVoxel_m;
    if (read.isValueOn(*at)) {
      worst = std::max(worst, std::abs(value - exact));
      wrong_sign += std::abs(exact) > bound && (value < 0) != (exact < 0);
    } else {
      missing += std::abs(exact) < kBand - bound;
      beyond += std::abs(read.getValue(*at)) != background;
      wrong_side += (value < 0) != (exact < 0);
    }
  }
  EXPECT_LE(worst, bound) << "voxels";
  EXPECT_EQ(wrong_sign, 0u);
  EXPECT_EQ(missing, 0u) << "voxels of the band that are not active";
  EXPECT_EQ(beyond, 0u) << "inactive voxels without the background's value";
  EXPECT_EQ(wrong_side, 0u) << "inactive voxels with the wrong sign";
  EXPECT_EQ(openvdb::tools::checkLevelSet(grid), "");
}

/// Distances of the mesh's vertices from the shape, voxels.
std::vector<double> vertexErrors(const openvdb::FloatGrid& grid, const Shape& shape) {
  std::vector<openvdb::Vec3s> vertices;
  std::vector<openvdb::Vec4I> quads;
  openvdb::tools::volumeToMesh(grid, vertices, quads);
  EXPECT_GT(quads.size(), 100u);
  std::vector<double> errors;
  for (const openvdb::Vec3s& vertex : vertices) {
    const Vec3d ijk = grid.worldToIndex(Vec3d(vertex));
    errors.push_back(shape.distance({ijk.x(), ijk.y(), ijk.z()}));
  }
  return errors;
}

TEST(SurfaceLevelSet, SphereHasTheRightDistanceAndSignEverywhere) {
  const Shape shape = sphere(21.3);
  const auto grid = levelSetOf(sampled(shape));
  expectSolid(shape, *grid);
  for (const double error : vertexErrors(*grid, shape)) ASSERT_LE(std::abs(error), 2 * boundOf(shape));
}

TEST(SurfaceLevelSet, TorusHasTheRightDistanceAndSignEverywhere) {
  const Shape shape = torus(34.2, 12.6);
  const auto grid = levelSetOf(sampled(shape));
  expectSolid(shape, *grid);
  for (const double error : vertexErrors(*grid, shape)) ASSERT_LE(std::abs(error), 2 * boundOf(shape));
}

TEST(SurfaceLevelSet, LargeInteriorIsSolidTilesInsideAndFreeOutside) {
  const Shape shape = sphere(70.5);
  const auto grid = levelSetOf(sampled(shape, 3));
  EXPECT_LT(grid->tree().getValue(Coord(3, -6, 1)), 0.0f);
  EXPECT_LT(grid->tree().getValue(Coord(43, -6, 1)), 0.0f);
  EXPECT_GT(grid->tree().getValue(Coord(90, -6, 1)), 0.0f);
  EXPECT_GT(grid->tree().getValue(Coord(-90, 300, -4000)), 0.0f);
  EXPECT_FALSE(grid->tree().isValueOn(Coord(3, -6, 1)));
}

TEST(SurfaceLevelSet, ARoomSeenFromInsideIsFreeInside) {
  const Shape shape = sphere(25.0);
  const auto grid = levelSetOf(sampled(shape, 4, {}, -1));
  const auto read = grid->getConstAccessor();
  for (int r = 0; r < 60; ++r) {
    const Coord at(3 + r, -6, 1);
    const double behind = shape.distance(positionOf(at));  // positive inside the wall
    if (std::abs(behind) < 1) continue;
    // Free inside, a wall 3 voxels thick, free again beyond what was seen.
    EXPECT_EQ(read.getValue(at) < 0, behind > 0 && behind < kBand - boundOf(shape)) << behind;
    if (std::abs(behind - kBand) < 2 * boundOf(shape)) break;
  }
  EXPECT_GT(grid->tree().getValue(Coord(3, -6, 1)), 0.0f);
  EXPECT_GT(grid->tree().getValue(Coord(300, -6, 1)), 0.0f);
}

TEST(SurfaceLevelSet, SpaceThatNoLeafHoldsJoinsWhatStandsInIt) {
  // A shell in a room, both seen from inside. Around the shell, everything marks the space between as solid, but the
  // walls of the room, which are more, mark it as free: it is one space, joined through missing leaves.
  const Shape room = sphere(50.0), shell = sphere(9.0);
  FieldSnapshot field = sampled(room, 3, {}, -1);
  for (const SurfacePoint& point : sampled(shell, 3, {}, -1).points) field.points.push_back(point);
  const auto grid = levelSetOf(field);
  const auto read = grid->getConstAccessor();
  for (int r = 0; r < 46; ++r) {
    const Coord at(3 + r, -6, 1);
    const double behind = shell.distance(positionOf(at));
    if (std::abs(behind) < 1 || std::abs(behind - kBand) < 1) continue;
    EXPECT_EQ(read.getValue(at) < 0, behind > 0 && behind < kBand) << behind;
  }
}

TEST(SurfaceLevelSet, AnOpenSheetIsASlabAndLeaksNowhere) {
  // The cap of a large sphere: its rim is open.
  const Shape shape = sphere(60.0);
  const auto grid = levelSetOf(sampled(shape, 4, [](const Eigen::Vector3d& p) { return p.z() > kCentre.z() + 40; }));
  const auto read = grid->getConstAccessor();
  openvdb::CoordBBox box = grid->evalActiveVoxelBoundingBox();
  box.expand(40);
  std::uint64_t inside = 0, stray = 0;
  for (auto at = box.begin(); at; ++at) {
    const double value = read.getValue(*at);
    if (value >= 0) continue;
    ++inside;
    const double exact = shape.distance(positionOf(*at));
    stray += !(exact < boundOf(shape) && exact > -kBand - boundOf(shape));
  }
  EXPECT_GT(inside, 1000u);
  EXPECT_EQ(stray, 0u) << "voxels called inside although they are not just behind the sheet";
  // The seen side of the mesh is on the sphere, the rest at most one band behind it.
  std::uint64_t front = 0, others = 0;
  for (const double error : vertexErrors(*grid, shape)) {
    front += std::abs(error) < 0.25;
    others += !(error < 0.25 && error > -kBand - 1);
  }
  EXPECT_GT(front, 1000u);
  EXPECT_EQ(others, 0u);
}

TEST(SurfaceLevelSet, ASheetAtAnyPlaceInItsLeavesLeaksIntoNoTile) {
  for (int offset = 0; offset < 8; ++offset) {
    for (const float up : {-1.0f, 1.0f}) {
      FieldSnapshot field;
      field.origin_W = kShapeOrigin_W;
      field.voxel_size_m = kShapeVoxel_m;
      for (int i = offset; i < 40; ++i) {
        for (int j = offset; j < 40; ++j) {
          SurfacePoint point;
          point.position_W = kShapeOrigin_W + kShapeVoxel_m * Eigen::Vector3d(i, j, offset);
          point.normal_W = Eigen::Vector3f(0, 0, up);
          field.points.push_back(point);
        }
      }
      const auto grid = levelSetOf(field);
      std::uint64_t negative = 0;
      for (auto value = grid->cbeginValueAll(); value; ++value) {
        if (*value >= 0) continue;
        negative += value.getVoxelCount();
        EXPECT_TRUE(value.isVoxelValue() && value.isValueOn()) << "a leak at " << value.getCoord();
      }
      EXPECT_GT(negative, 1000u);
    }
  }
}

TEST(SurfaceLevelSet, HolesUpToThreeVoxelsWideAreBridged) {
  const Shape shape = sphere(30.0);
  const FieldSnapshot field = sampled(shape, 4, [](const Eigen::Vector3d& p) {
    const Eigen::Vector3d q = p - kCentre;
    return !(q.z() > 0 && std::hypot(q.x(), q.y()) < 1.5);
  });
  const auto grid = levelSetOf(field);
  EXPECT_LT(grid->tree().getValue(Coord(3, -6, 1)), 0.0f) << "the interior leaked";
}

TEST(SurfaceLevelSet, BothFacesOfAThinBoardKeepTheirSides) {
  // Two squares 1.2 voxels apart, seen from above and from below.
  FieldSnapshot field;
  field.origin_W = kShapeOrigin_W;
  field.voxel_size_m = kShapeVoxel_m;
  for (int i = 0; i < 40; ++i) {
    for (int j = 0; j < 40; ++j) {
      for (const double side : {-1.0, 1.0}) {
        SurfacePoint point;
        point.position_W = kShapeOrigin_W + kShapeVoxel_m * Eigen::Vector3d(i, j, 0.6 * side);
        point.normal_W = Eigen::Vector3f(0, 0, static_cast<float>(side));
        field.points.push_back(point);
      }
    }
  }
  const auto grid = levelSetOf(field);
  const auto read = grid->getConstAccessor();
  for (int k = -3; k <= 3; ++k) {
    EXPECT_NEAR(read.getValue(Coord(20, 20, k)) / kShapeVoxel_m, std::abs(k) - 0.6, 1e-4) << k;
  }
}

TEST(SurfaceLevelSet, PointsWithoutANormalAreLeftOut) {
  FieldSnapshot field = sampled(sphere(15));
  for (SurfacePoint& point : field.points) point.normal_W.setZero();
  EXPECT_TRUE(levelSetOf(field)->empty());
  field.points.clear();
  const auto empty = levelSetOf(field);
  EXPECT_TRUE(empty->empty());
  EXPECT_EQ(empty->getGridClass(), openvdb::GRID_LEVEL_SET);
}

TEST(SurfaceLevelSet, IsTheSameOnAnyNumberOfThreads) {
  const FieldSnapshot field = sampled(torus(30, 9));
  const auto many = levelSetOf(field);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const auto single = levelSetOf(field);
  ASSERT_TRUE(many->tree().hasSameTopology(single->tree()));
  for (auto a = many->tree().cbeginLeaf(), b = single->tree().cbeginLeaf(); a && b; ++a, ++b) {
    ASSERT_EQ(*a, *b);
  }
}

}  // namespace
}  // namespace accessvdb

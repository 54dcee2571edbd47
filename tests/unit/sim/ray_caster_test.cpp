// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Ranges against closed-form intersections, in double precision.
#include "sim/ray_caster.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <vector>

#include "accessvdb/error.h"
#include "sim/counter_random.h"
#include "sim/scene.h"

namespace accessvdb::sim {
namespace {

using Eigen::Vector3d, Eigen::Vector3f;

constexpr double kMiss = std::numeric_limits<double>::infinity();

std::vector<Vector3f> raysTowards(const Vector3d& origin, double half_m, std::size_t count, std::uint64_t seed) {
  CounterRandom random({seed});
  std::vector<Vector3f> directions(count);
  for (Vector3f& direction : directions) {
    Vector3d target;
    for (double& x : target) x = random.uniform(-half_m, half_m);
    direction = (target - origin).normalized().cast<float>();
  }
  return directions;
}

double sphereRange(const Vector3d& o, const Vector3d& d, double radius) {
  const double b = o.dot(d) / d.norm(), c = o.squaredNorm() - radius * radius;
  const double root = b * b - c;
  return root < 0 ? kMiss : (-b - std::sqrt(root)) / d.norm();
}

double boxRange(const Vector3d& o, const Vector3d& d, const Vector3d& half) {
  double enter = -kMiss, leave = kMiss;
  for (int axis = 0; axis < 3; ++axis) {
    const double t1 = (-half[axis] - o[axis]) / d[axis], t2 = (half[axis] - o[axis]) / d[axis];
    enter = std::max(enter, std::min(t1, t2));
    leave = std::min(leave, std::max(t1, t2));
  }
  return enter <= leave ? enter : kMiss;
}

/// Sphere tracing: steps of the distance itself never pass through the surface.
double marchedRange(const SignedDistance& exact, const Vector3d& o, const Vector3d& d) {
  double t = 0;
  for (int n = 0; n < 100000 && t < 10; ++n) {
    const double step = exact.at(o + t * d);
    if (step < 1e-10) return t;
    t += step;
  }
  return kMiss;
}

struct Comparison {
  int hits = 0, misses = 0, disagreements = 0;
};

/// A facet is at most `error_m` below the surface, so a range is off by that over the cosine of incidence; rays
/// that graze (cosine below 0.1) may hit one and miss the other.
template <typename Range>
Comparison compare(const Scene& scene, const Vector3d& origin, const std::vector<Vector3f>& directions, Range range) {
  std::vector<float> found(directions.size());
  RayCaster(scene.mesh).cast(origin, directions, found);
  Comparison out;
  for (std::size_t i = 0; i < found.size(); ++i) {
    const Vector3d d = directions[i].cast<double>();
    const double expected = range(d);
    const bool hit = std::isfinite(found[i]);
    if (std::isfinite(expected)) {
      const double cosine = -scene.distance->outwardNormal(origin + expected * d).dot(d.normalized());
      if (cosine < 0.1) continue;
      ++out.hits;
      const double error = std::abs(static_cast<double>(found[i]) - expected);
      if (!(error <= 1.2 * scene.tessellation_error_m / cosine + 1e-7 * expected)) {
        ++out.disagreements;
        EXPECT_LE(out.disagreements, 3) << "error " << error << ", cosine " << cosine;
      }
    } else {
      ++out.misses;
      out.disagreements += hit;
    }
  }
  return out;
}

TEST(RayCaster, SphereRanges) {
  const Vector3d origin(0.31, -0.42, 0.2);
  const Comparison seen = compare(makeSphere(0.08), origin, raysTowards(origin, 0.1, 5000, 1),
                                  [&](const Vector3d& d) { return sphereRange(origin, d, 0.08); });
  EXPECT_EQ(seen.disagreements, 0);
  EXPECT_GT(seen.hits, 1000);
  EXPECT_GT(seen.misses, 500);
}

TEST(RayCaster, BoxRangesToTheLastFloat) {
  const Vector3d origin(0.6, 0.1, -0.05), size(0.02, 0.28, 0.28);
  const Scene wall = makeBox(size, "wall");
  const Comparison seen = compare(wall, origin, raysTowards(origin, 0.2, 5000, 2),
                                  [&](const Vector3d& d) { return boxRange(origin, d, size / 2); });
  EXPECT_EQ(seen.disagreements, 0);
  EXPECT_GT(seen.hits, 1000);
  EXPECT_GT(seen.misses, 500);
}

TEST(RayCaster, TorusRangesAndItsHole) {
  const Scene torus = makeTorus(0.06, 0.02);
  const Vector3d origin(0.2, 0.1, 0.4);
  const Comparison seen = compare(torus, origin, raysTowards(origin, 0.09, 3000, 3),
                                  [&](const Vector3d& d) { return marchedRange(*torus.distance, origin, d); });
  EXPECT_EQ(seen.disagreements, 0);
  EXPECT_GT(seen.hits, 500);
  const Vector3f down(0, 0, -1);
  float range = 0;
  RayCaster(torus.mesh).cast({0, 0, 1}, {&down, 1}, {&range, 1});
  EXPECT_TRUE(std::isinf(range)) << "straight through the hole";
}

TEST(RayCaster, KeepsItsPrecisionFarFromTheOrigin) {
  // At 100 m, a float is only accurate to 4e-6 m; the ranges must not lose more than the mesh itself did.
  const Vector3d offset(100, -200, 50), origin = offset + Vector3d(0.5000001, 0.1000003, 0.0000007);
  const Scene sphere = translated(makeSphere(0.08), offset);
  const std::vector<Vector3f> directions = raysTowards({0.5, 0.1, 0}, 0.05, 500, 4);
  const Comparison seen =
      compare(sphere, origin, directions, [&](const Vector3d& d) { return sphereRange(origin - offset, d, 0.08); });
  EXPECT_EQ(seen.disagreements, 0);
  EXPECT_GT(seen.hits, 100);
}

TEST(RayCaster, TheNearestOfSeveralSurfacesCounts) {
  Scene two = makeBox({0.2, 0.2, 0.2});
  const Scene behind = translated(makeBox({0.2, 0.2, 0.2}), {-1, 0, 0});
  for (auto triangle : behind.mesh.triangles) {
    for (std::uint32_t& index : triangle) index += 8;
    two.mesh.triangles.push_back(triangle);
  }
  two.mesh.vertices_W.insert(two.mesh.vertices_W.end(), behind.mesh.vertices_W.begin(), behind.mesh.vertices_W.end());
  const RayCaster caster(two.mesh);
  const Vector3f directions[2] = {{-1, 0, 0}, {1, 0, 0}};
  float ranges[2];
  caster.cast({2, 0, 0}, directions, ranges);
  EXPECT_FLOAT_EQ(ranges[0], 1.9f);
  EXPECT_TRUE(std::isinf(ranges[1]));
  caster.cast({-0.5, 0, 0}, directions, ranges);
  EXPECT_FLOAT_EQ(ranges[0], 0.4f);
  EXPECT_FLOAT_EQ(ranges[1], 0.4f);
}

TEST(RayCaster, RefusesMeshesWithoutSense) {
  EXPECT_THROW(RayCaster(TriangleMesh{}), InvalidArgument);
  EXPECT_THROW(RayCaster(TriangleMesh{{{0, 0, 0}}, {{0, 1, 2}}}), InvalidArgument);
}

}  // namespace
}  // namespace accessvdb::sim

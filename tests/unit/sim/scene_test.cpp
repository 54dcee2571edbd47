// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Closed forms against meshes and numbers: each checks the other.
#include "sim/scene.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "accessvdb/error.h"
#include "sim/analytic_distance.h"
#include "sim/counter_random.h"
#include "sim/tessellation.h"

namespace accessvdb::sim {
namespace {

using Eigen::Vector3d;

Vector3d randomPoint(CounterRandom& random, double half_m) {
  Vector3d p;
  for (double& x : p) x = random.uniform(-half_m, half_m);
  return p;
}

/// Tries the plane, then the three edges; shares no code with the library.
double distanceToTriangle(const Vector3d& p, const Vector3d& a, const Vector3d& b, const Vector3d& c) {
  const Vector3d n = (b - a).cross(c - a);
  const auto leftOf = [&](const Vector3d& from, const Vector3d& to) { return n.dot((to - from).cross(p - from)) >= 0; };
  if (leftOf(a, b) && leftOf(b, c) && leftOf(c, a)) return std::abs(n.dot(p - a)) / n.norm();
  const auto toEdge = [&](const Vector3d& from, const Vector3d& to) {
    const double t = std::clamp((p - from).dot(to - from) / (to - from).squaredNorm(), 0.0, 1.0);
    return (p - from - t * (to - from)).norm();
  };
  return std::min({toEdge(a, b), toEdge(b, c), toEdge(c, a)});
}

Vector3d corner(const TriangleMesh& mesh, std::size_t triangle, int k) {
  return mesh.vertices_W[mesh.triangles[triangle][static_cast<std::size_t>(k)]].cast<double>();
}

double distanceToMesh(const TriangleMesh& mesh, const Vector3d& p) {
  double nearest = 1e9;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    nearest = std::min(nearest, distanceToTriangle(p, corner(mesh, t, 0), corner(mesh, t, 1), corner(mesh, t, 2)));
  }
  return nearest;
}

double volume(const TriangleMesh& mesh) {
  double sum = 0;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    sum += corner(mesh, t, 0).dot(corner(mesh, t, 1).cross(corner(mesh, t, 2))) / 6;
  }
  return sum;
}

/// Whether every edge is traversed once in each direction.
bool isClosed(const TriangleMesh& mesh) {
  std::vector<std::pair<std::uint32_t, std::uint32_t>> there, back;
  for (const auto& triangle : mesh.triangles) {
    for (std::size_t k = 0; k < 3; ++k) {
      there.emplace_back(triangle[k], triangle[(k + 1) % 3]);
      back.emplace_back(triangle[(k + 1) % 3], triangle[k]);
    }
  }
  std::sort(there.begin(), there.end());
  std::sort(back.begin(), back.end());
  return there == back && std::adjacent_find(there.begin(), there.end()) == there.end();
}

/// Largest |distance| over the middles of facets and of their edges, where facets are deepest.
double deepest(const TriangleMesh& mesh, const SignedDistance& exact) {
  double worst = 0;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const Vector3d a = corner(mesh, t, 0), b = corner(mesh, t, 1), c = corner(mesh, t, 2);
    const Vector3d middles[4] = {(a + b + c) / 3, (a + b) / 2, (b + c) / 2, (c + a) / 2};
    for (const Vector3d& p : middles) worst = std::max(worst, std::abs(exact.at(p)));
  }
  return worst;
}

/// Distance by brute force over a coarse mesh, sign by the obvious radial order of each shape.
void expectAgrees(const SignedDistance& exact, const Tessellation& coarse, double half_m, std::uint64_t seed) {
  CounterRandom random({seed});
  int inside = 0;
  for (int n = 0; n < 150; ++n) {
    const Vector3d p = randomPoint(random, half_m);
    const double d = exact.at(p);
    EXPECT_NEAR(std::abs(d), distanceToMesh(coarse.mesh, p), coarse.error_m) << p.transpose();
    inside += d < 0;
  }
  EXPECT_GT(inside, 3) << "the points do not try the inside";
}

TEST(AnalyticDistance, TorusAgreesWithItsTriangles) {
  const Tessellation coarse = tessellateTorus(0.06, 0.02, 2e-4);
  expectAgrees(TorusDistance(Vector3d::Zero(), 0.06, 0.02), coarse, 0.09, 1);
}
TEST(AnalyticDistance, SphereAgreesWithItsTriangles) {
  expectAgrees(SphereDistance(Vector3d::Zero(), 0.08), tessellateSphere(0.08, 2e-4), 0.12, 2);
}
TEST(AnalyticDistance, BoxAgreesWithItsTriangles) {
  expectAgrees(BoxDistance(Vector3d::Zero(), {0.1, 0.28, 0.2}), tessellateBox({0.1, 0.28, 0.2}), 0.18, 3);
}

TEST(AnalyticDistance, SignsAtKnownPlaces) {
  const TorusDistance torus(Vector3d(1, 2, 3), 0.06, 0.02);
  EXPECT_NEAR(torus.at({1, 2, 3}), 0.04, 1e-12) << "the hole is outside";
  EXPECT_NEAR(torus.at({1.06, 2, 3}), -0.02, 1e-12);
  EXPECT_NEAR(torus.at({1, 2.08, 3}), 0, 1e-12);
  const BoxDistance box(Vector3d::Zero(), {2, 4, 6});
  EXPECT_DOUBLE_EQ(box.at({0, 0, 0}), -1);
  EXPECT_DOUBLE_EQ(box.at({1.5, 0, 0}), 0.5);
  EXPECT_DOUBLE_EQ(box.at({1 + 3, 2 + 4, 0}), 5) << "beyond an edge";
  EXPECT_DOUBLE_EQ(SphereDistance(Vector3d(0, 0, 1), 0.5).at({0, 0, 3}), 1.5);
}

TEST(AnalyticDistance, NormalsPointWhereTheDistanceGrows) {
  const TorusDistance torus(Vector3d(0.1, 0, 0), 0.06, 0.02);
  const SphereDistance sphere(Vector3d(0, 0.1, 0), 0.08);
  const BoxDistance box(Vector3d(0, 0, 0.1), {0.1, 0.15, 0.2});
  CounterRandom random({4});
  for (const SignedDistance* exact :
       {static_cast<const SignedDistance*>(&torus), static_cast<const SignedDistance*>(&sphere),
        static_cast<const SignedDistance*>(&box)}) {
    for (int n = 0; n < 200; ++n) {
      const Vector3d p = randomPoint(random, 0.15);
      const Vector3d normal = exact->outwardNormal(p);
      EXPECT_NEAR(normal.norm(), 1, 1e-12);
      const double step = 1e-7;
      EXPECT_NEAR((exact->at(p + step * normal) - exact->at(p - step * normal)) / (2 * step), 1, 1e-5) << p.transpose();
    }
  }
}

struct Shape {
  const char* name;
  Scene scene;
  double volume_m3;
};

std::vector<Shape> shapes() {
  constexpr double pi = std::numbers::pi;
  return {{"torus", makeTorus(0.06, 0.02), 2 * pi * pi * 0.06 * 0.02 * 0.02},
          {"ring", makeTorus(0.06, 0.0015), 2 * pi * pi * 0.06 * 0.0015 * 0.0015},
          {"sphere", makeSphere(0.08), 4.0 / 3 * pi * 0.08 * 0.08 * 0.08},
          {"wall", makeBox({0.02, 0.28, 0.28}, "wall"), 0.02 * 0.28 * 0.28}};
}

TEST(Scene, MeshesAreClosedAndFaceOutwards) {
  for (const Shape& shape : shapes()) {
    SCOPED_TRACE(shape.name);
    EXPECT_TRUE(isClosed(shape.scene.mesh));
    EXPECT_NEAR(volume(shape.scene.mesh) / shape.volume_m3, 1, 3e-3);  // the ring: 2e-6 m of a tube of 1.5 mm
  }
}

TEST(Scene, TessellationErrorIsKeptAndNotOverstated) {
  for (const Shape& shape : shapes()) {
    SCOPED_TRACE(shape.name);
    const double worst = deepest(shape.scene.mesh, *shape.scene.distance);
    EXPECT_LE(worst, shape.scene.tessellation_error_m);
    EXPECT_LE(shape.scene.tessellation_error_m, 2.1e-6) << "the aim, plus rounding to float";
    if (shape.scene.name != "wall") {
      EXPECT_GT(worst, 0.3 * shape.scene.tessellation_error_m) << "a bound that says nothing";
    }
    for (const Eigen::Vector3f& vertex : shape.scene.mesh.vertices_W) {
      ASSERT_LE(std::abs(shape.scene.distance->at(vertex.cast<double>())), 2e-8) << "vertices lie on the shape";
    }
  }
}

TEST(Scene, MovesWithItsDistance) {
  const Vector3d offset(0.0012345, -0.0034, 0.5);
  const Scene still = makeSphere(0.05), moved = translated(makeSphere(0.05), offset);
  EXPECT_NEAR(moved.distance->at(offset), -0.05, 1e-12);
  EXPECT_TRUE(moved.centre_W.isApprox(offset));
  EXPECT_LE(deepest(moved.mesh, *moved.distance), moved.tessellation_error_m);
  EXPECT_GT(moved.tessellation_error_m, still.tessellation_error_m);
  EXPECT_NE(moved.description, still.description);
}

TEST(Scene, RefusesImpossibleSizes) {
  EXPECT_THROW((void)makeTorus(0.02, 0.06), InvalidArgument);
  EXPECT_THROW((void)makeTorus(0.06, 0), InvalidArgument);
  EXPECT_THROW((void)makeSphere(-1), InvalidArgument);
  EXPECT_THROW((void)makeSphere(std::nan("")), InvalidArgument);
  EXPECT_THROW((void)makeBox({0.1, 0.1, 0}), InvalidArgument);
  EXPECT_THROW((void)translated(makeSphere(1), {std::nan(""), 0, 0}), InvalidArgument);
}

}  // namespace
}  // namespace accessvdb::sim

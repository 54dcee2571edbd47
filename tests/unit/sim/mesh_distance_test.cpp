// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Oracles: analytic distances; a loop over all triangles with a least-squares projection; the winding number as a sum
// of solid angles (Van Oosterom and Strackee 1983), which casts no ray.
#include "sim/mesh_distance.h"

#include <gtest/gtest.h>
#include <tbb/parallel_for.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "sim/closed_mesh.h"
#include "sim/pine_tessellation.h"

namespace accessvdb::sim {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

/// A closed grid of triangles, wrapped around along both axes: a torus with vertical axis.
TriangleMesh torusMesh(double major_m, double minor_m, int around, int across) {
  TriangleMesh mesh;
  for (int n = 0; n < around; ++n)
    for (int k = 0; k < across; ++k) {
      const double a = 2 * std::numbers::pi * n / around, b = 2 * std::numbers::pi * k / across;
      const double level = major_m + minor_m * std::cos(b);
      mesh.vertices_W.push_back(
          Vector3d(level * std::cos(a), level * std::sin(a), minor_m * std::sin(b)).cast<float>());
    }
  const auto id = [&](int n, int k) { return std::uint32_t((n % around) * across + k % across); };
  for (int n = 0; n < around; ++n)
    for (int k = 0; k < across; ++k) {
      mesh.triangles.push_back({id(n, k), id(n + 1, k), id(n + 1, k + 1)});
      mesh.triangles.push_back({id(n, k), id(n + 1, k + 1), id(n, k + 1)});
    }
  return mesh;
}

TriangleMesh boxMesh(const Vector3f& low, const Vector3f& high) {
  TriangleMesh mesh;
  for (int n = 0; n < 8; ++n)
    mesh.vertices_W.emplace_back(n & 1 ? high.x() : low.x(), n & 2 ? high.y() : low.y(), n & 4 ? high.z() : low.z());
  for (const auto& quad : std::vector<std::array<std::uint32_t, 4>>{
           {0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}}) {
    mesh.triangles.push_back({quad[0], quad[1], quad[2]});
    mesh.triangles.push_back({quad[0], quad[2], quad[3]});
  }
  return mesh;
}

TriangleMesh sphereMesh(const Vector3d& centre, double radius_m) {
  TriangleMesh mesh;  // a round cone of hardly any length
  appendRoundCone({centre - Vector3d(0, 0, 1e-6), centre + Vector3d(0, 0, 1e-6), radius_m, radius_m}, 0.01 * radius_m,
                  mesh);
  return mesh;
}

void append(TriangleMesh& mesh, const TriangleMesh& other, bool turned = false) {
  const auto base = std::uint32_t(mesh.vertices_W.size());
  mesh.vertices_W.insert(mesh.vertices_W.end(), other.vertices_W.begin(), other.vertices_W.end());
  for (const auto& t : other.triangles)
    mesh.triangles.push_back({base + t[0], base + t[turned ? 2 : 1], base + t[turned ? 1 : 2]});
}

/// Distance to a triangle: the projection on its plane by least squares if that is inside, else the nearest of 3
/// edges.
double triangleDistance(const std::array<Vector3d, 3>& t, const Vector3d& p) {
  Eigen::Matrix<double, 3, 2> basis;
  basis << t[1] - t[0], t[2] - t[0];
  const Eigen::Vector2d uv = basis.colPivHouseholderQr().solve(p - t[0]);
  if (uv[0] >= 0 && uv[1] >= 0 && uv.sum() <= 1) return (t[0] + basis * uv - p).norm();
  double best = std::numeric_limits<double>::infinity();
  for (int k = 0; k < 3; ++k) {
    const Vector3d a = t[std::size_t(k)], along = t[std::size_t((k + 1) % 3)] - a;
    const double share = std::clamp(along.dot(p - a) / along.dot(along), 0.0, 1.0);
    best = std::min(best, (a + share * along - p).norm());
  }
  return best;
}

struct BruteForce {
  double distance_m = std::numeric_limits<double>::infinity();
  double winding = 0;
};

BruteForce bruteForce(const TriangleMesh& mesh, const Vector3d& p) {
  BruteForce result;
  for (const auto& index : mesh.triangles) {
    std::array<Vector3d, 3> t;
    for (std::size_t k = 0; k < 3; ++k) t[k] = mesh.vertices_W[index[k]].cast<double>();
    result.distance_m = std::min(result.distance_m, triangleDistance(t, p));
    const Vector3d a = t[0] - p, b = t[1] - p, c = t[2] - p;
    const double volume = a.dot(b.cross(c)), na = a.norm(), nb = b.norm(), nc = c.norm();
    result.winding +=
        std::atan2(volume, na * nb * nc + a.dot(b) * nc + b.dot(c) * na + c.dot(a) * nb) / (2 * std::numbers::pi);
  }
  return result;
}

std::vector<Vector3d> randomPoints(int count, const Vector3d& low, const Vector3d& high, std::uint32_t seed) {
  std::mt19937 generator(seed);
  std::vector<Vector3d> points;
  for (int n = 0; n < count; ++n) {
    Vector3d p;
    for (int axis = 0; axis < 3; ++axis) p[axis] = low[axis] + (high[axis] - low[axis]) * (generator() * 0x1p-32);
    points.push_back(p);
  }
  return points;
}

std::shared_ptr<const SignedDistance> closedDistance(const TriangleMesh& mesh) {
  std::string why_not;
  auto distance = makeMeshDistance(mesh, why_not);
  EXPECT_TRUE(distance != nullptr) << why_not;
  EXPECT_TRUE(why_not.empty()) << why_not;
  return distance;
}

std::string refusal(const TriangleMesh& mesh) {
  std::string why_not;
  EXPECT_EQ(makeMeshDistance(mesh, why_not), nullptr);
  return why_not;
}

/// Against brute force: the distance to a billionth of a metre (both are double), the sign where the solid angle is
/// far from its jump at the surface.
void expectBruteForce(const TriangleMesh& mesh, const std::vector<Vector3d>& points) {
  const auto distance = closedDistance(mesh);
  ASSERT_TRUE(distance);
  int inside = 0;
  for (const Vector3d& p : points) {
    const BruteForce truth = bruteForce(mesh, p);
    const double d = distance->at(p);
    ASSERT_NEAR(std::abs(d), truth.distance_m, 1e-9) << p.transpose();
    ASSERT_EQ(d<0, truth.winding> 0.5) << p.transpose() << " winding " << truth.winding;
    inside += d < 0;
    for (const double r : {0.5, 0.999999, 1.000001, 3.0})
      ASSERT_EQ(distance->surfaceNearerThan(p, r * std::abs(d)), r > 1) << p.transpose() << " factor " << r;
  }
  EXPECT_GT(inside, int(points.size()) / 100);
  EXPECT_LT(inside, int(points.size()) * 99 / 100);
}

TEST(MeshDistance, TorusIsBruteForceAndAnalytic) {
  const TriangleMesh mesh = torusMesh(0.06, 0.02, 48, 24);
  const auto points = randomPoints(300, {-0.1, -0.1, -0.04}, {0.1, 0.1, 0.04}, 1);
  expectBruteForce(mesh, points);
  const auto distance = closedDistance(mesh);
  // Chords: r (1 - cos(pi / 24)) across, (R + r) (1 - cos(pi / 48)) around.
  const double chord_m = 0.02 * (1 - std::cos(std::numbers::pi / 24)) + 0.08 * (1 - std::cos(std::numbers::pi / 48));
  for (const Vector3d& p : points) {
    const double exact = std::hypot(std::hypot(p.x(), p.y()) - 0.06, p.z()) - 0.02;
    EXPECT_NEAR(distance->at(p), exact, chord_m + 1e-8) << p.transpose();
  }
}

TEST(MeshDistance, BoxIsExactInsideOutsideAndOnALattice) {
  const Vector3d half(0.05, 0.1, 0.15);
  const auto distance = closedDistance(boxMesh(-half.cast<float>(), half.cast<float>()));
  const Vector3d rounded = half.cast<float>().cast<double>();
  auto points = randomPoints(2000, {-0.2, -0.2, -0.2}, {0.2, 0.2, 0.2}, 2);
  // From lattice points, vertices, edges and face diagonals are in round directions.
  for (int x = -7; x <= 7; ++x)
    for (int y = -7; y <= 7; ++y)
      for (int z = -7; z <= 7; ++z) points.emplace_back(0.0251 * x, 0.0251 * y, 0.0251 * z);
  for (const Vector3d& p : points) {
    const Vector3d q = p.cwiseAbs() - rounded;
    const double exact = q.cwiseMax(0.0).norm() + std::min(q.maxCoeff(), 0.0);
    EXPECT_NEAR(distance->at(p), exact, 1e-12) << p.transpose();
  }
}

TEST(MeshDistance, OverlappingCapsulesAreTheirUnion) {
  const std::vector<RoundCone> cones = {{{0, 0, 0}, {0, 0, 0.5}, 0.05, 0.03},
                                        {{0, 0, 0.2}, {0.3, 0.1, 0.3}, 0.03, 0.01},
                                        {{0, 0, 0.2}, {-0.2, 0.1, 0.35}, 0.03, 0.01},
                                        {{0.02, 0, 0.0}, {0.02, 0.0, 0.4}, 0.05, 0.04}};
  TriangleMesh mesh;
  for (const RoundCone& cone : cones) appendRoundCone(cone, 0.001, mesh);
  EXPECT_EQ(partCount(mesh), cones.size());
  auto points = randomPoints(500, {-0.25, -0.1, -0.1}, {0.35, 0.15, 0.6}, 3);
  for (const Vector3d& p : randomPoints(500, {-0.03, -0.03, 0.1}, {0.05, 0.03, 0.3}, 4)) points.push_back(p);
  expectBruteForce(mesh, points);
}

TEST(MeshDistance, FarFromTheOriginThePlacesOfFloatAreTheMesh) {
  TriangleMesh mesh;
  appendRoundCone({{800, -600, 40}, {800.3, -600.1, 40.4}, 0.05, 0.02}, 0.001, mesh);
  expectBruteForce(mesh, randomPoints(500, {799.95, -600.12, 39.95}, {800.32, -599.95, 40.42}, 5));
}

TEST(MeshDistance, PointsFromWhichEveryRayMeetsAnEdge) {
  // A box of grains: each far smaller than the box, so that a ray cannot pass between edges with certainty.
  TriangleMesh mesh = boxMesh({-500, -500, -500}, {-499.999f, -499.999f, -499.999f});
  append(mesh, boxMesh({499.999f, 499.999f, 499.999f}, {500, 500, 500}));
  const auto distance = closedDistance(mesh);
  EXPECT_LT(distance->at({-499.9995, -499.9995, -499.9995}), 0);
  EXPECT_LT(distance->at({499.9995, 499.9996, 499.9994}), 0);
  EXPECT_GT(distance->at({499.9985, 499.9996, 499.9994}), 0);
}

TEST(MeshDistance, CavityIsOutside) {
  TriangleMesh mesh = sphereMesh({0, 0, 0}, 0.1);
  append(mesh, sphereMesh({0, 0, 0}, 0.05), true);
  expectBruteForce(mesh, randomPoints(300, {-0.11, -0.11, -0.11}, {0.11, 0.11, 0.11}, 6));
  EXPECT_GT(closedDistance(mesh)->at({0, 0, 0}), 0.049);
}

TEST(MeshDistance, WeldsVerticesByPlace) {
  const TriangleMesh box = boxMesh({-1, -1, -1}, {1, 1, 1});
  TriangleMesh loose;
  for (const auto& t : box.triangles)
    for (const std::uint32_t v : t) loose.vertices_W.push_back(box.vertices_W[v]);
  for (std::uint32_t n = 0; n < loose.vertices_W.size(); n += 3) loose.triangles.push_back({n, n + 1, n + 2});
  loose.triangles.push_back({0, 1, 1});  // without area
  EXPECT_NEAR(closedDistance(loose)->at({0, 0, 0.25}), -0.75, 1e-12);
}

TEST(MeshDistance, SaysWhyNot) {
  EXPECT_NE(refusal({}).find("no triangles"), std::string::npos);
  TriangleMesh mesh = torusMesh(0.06, 0.02, 12, 8);
  TriangleMesh broken = mesh;
  broken.triangles.pop_back();
  EXPECT_NE(refusal(broken).find("not closed: 3 edges"), std::string::npos) << refusal(broken);
  broken = mesh;
  std::swap(broken.triangles[5][0], broken.triangles[5][1]);
  EXPECT_NE(refusal(broken).find("flipped triangles: 3 edges"), std::string::npos) << refusal(broken);
  broken = mesh;
  broken.vertices_W[3].y() = std::numeric_limits<float>::quiet_NaN();
  EXPECT_NE(refusal(broken).find("not finite"), std::string::npos);
  broken = mesh;
  broken.triangles[0][0] = std::uint32_t(mesh.vertices_W.size());
  EXPECT_NE(refusal(broken).find("missing vertices"), std::string::npos);
  broken = {};
  append(broken, mesh, true);
  EXPECT_NE(refusal(broken).find("inside out"), std::string::npos);
  // One good part and a flipped one beside it.
  broken = mesh;
  append(broken, sphereMesh({1, 0, 0}, 0.1), true);
  EXPECT_NE(refusal(broken).find("inside out"), std::string::npos);
}

TEST(MeshDistance, BadPointsCollide) {
  const auto distance = closedDistance(torusMesh(0.06, 0.02, 12, 8));
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
  for (const Vector3d& p : {Vector3d(nan, 0, 0), Vector3d(0, infinity, 0), Vector3d(0, 0, -infinity)}) {
    EXPECT_LT(distance->at(p), 0);
    EXPECT_TRUE(distance->surfaceNearerThan(p, 0.01));
  }
}

TEST(MeshDistance, NormalsPointOutwards) {
  const auto box = closedDistance(boxMesh({-1, -1, -1}, {1, 1, 1}));
  const auto expectNormal = [&](const Vector3d& p, const Vector3d& expected) {
    EXPECT_LT((box->outwardNormal(p) - expected.normalized()).norm(), 1e-6) << p.transpose();
  };
  expectNormal({1, 0.3, 0.2}, {1, 0, 0});    // on a face
  expectNormal({1.2, 0.3, 0.2}, {1, 0, 0});  // off it
  expectNormal({0.9, 0.3, 0.2}, {1, 0, 0});  // below it
  expectNormal({1, 1, 0.2}, {1, 1, 0});      // an edge: between its faces
  expectNormal({1, 1, 1}, {1, 1, 1});        // a corner, whatever the diagonals of its faces
  expectNormal({-1, 1, -1}, {-1, 1, -1});
  expectNormal({1.2, 1.1, 1.3}, {0.2, 0.1, 0.3});  // off a corner: away from it
  const auto torus = closedDistance(torusMesh(0.06, 0.02, 192, 96));
  for (int n = 0; n < 100; ++n) {
    const double a = 0.7 * n, b = 1.3 * n;
    const Vector3d out(std::cos(b) * std::cos(a), std::cos(b) * std::sin(a), std::sin(b));
    const Vector3d p = 0.06 * Vector3d(std::cos(a), std::sin(a), 0) + 0.02 * out;
    // A facet leans by half of its widest angle at most, 2 pi / 96 / 2, about both axes; 0.06 covers their sum.
    EXPECT_LT((torus->outwardNormal(p) - out).norm(), 0.06);
  }
}

TEST(MeshDistance, ThreadsAgree) {
  const auto distance = closedDistance(torusMesh(0.06, 0.02, 64, 32));
  const auto points = randomPoints(4000, {-0.1, -0.1, -0.04}, {0.1, 0.1, 0.04}, 7);
  std::vector<double> alone, together(points.size());
  for (const Vector3d& p : points) alone.push_back(distance->at(p));
  tbb::parallel_for(std::size_t(0), points.size(), [&](std::size_t n) { together[n] = distance->at(points[n]); });
  EXPECT_EQ(alone, together);
}

}  // namespace
}  // namespace accessvdb::sim

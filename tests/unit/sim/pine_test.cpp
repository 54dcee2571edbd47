// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/pine.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <random>

#include "accessvdb/error.h"
#include "sim/closed_mesh.h"
#include "sim/pine_skeleton.h"
#include "sim/pine_tessellation.h"

namespace accessvdb::sim {
namespace {

using Eigen::Vector3d;

/// Exact: the spheres between the two ends, of which the nearest is found by golden section (the distance is convex).
double roundConeDistance(const RoundCone& cone, const Vector3d& p) {
  const auto at = [&](double s) {
    return (p - cone.a_W - s * (cone.b_W - cone.a_W)).norm() - cone.radius_a_m -
           s * (cone.radius_b_m - cone.radius_a_m);
  };
  double low = 0, high = 1;
  for (int n = 0; n < 80; ++n) {
    const double a = low + 0.381966011250105 * (high - low), b = low + 0.618033988749895 * (high - low);
    (at(a) < at(b) ? high : low) = at(a) < at(b) ? b : a;
  }
  return std::min({at(low), at(0), at(1)});
}

bool sameBytes(const TriangleMesh& a, const TriangleMesh& b) {
  return a.vertices_W.size() == b.vertices_W.size() && a.triangles == b.triangles &&
         std::memcmp(a.vertices_W.data(), b.vertices_W.data(), a.vertices_W.size() * sizeof(a.vertices_W[0])) == 0;
}

TEST(PineTessellation, RoundConesStayWithinTheChordError) {
  std::mt19937 generator(1);
  const auto uniform = [&](double low, double high) { return low + (high - low) * (generator() * 0x1p-32); };
  for (int n = 0; n < 60; ++n) {
    const double radius_m = std::exp(uniform(std::log(0.003), std::log(0.15)));
    const Vector3d a(uniform(-3, 3), uniform(-3, 3), uniform(0, 12));
    const Vector3d b = a + uniform(0.1, 0.5) * Vector3d(uniform(-1, 1), uniform(-1, 1), uniform(0.2, 1)).normalized();
    const RoundCone cone{a, b, radius_m, radius_m * uniform(0.5, 1.2)};
    if ((b - a).norm() < 1.2 * std::abs(cone.radius_a_m - cone.radius_b_m)) continue;
    const double chord_m = 0.001;
    TriangleMesh mesh;
    appendRoundCone(cone, chord_m, mesh);
    ASSERT_EQ(whyNotClosed(mesh), "");
    ASSERT_EQ(partCount(mesh), 1u);
    ASSERT_TRUE(insideOutCandidates(mesh).empty());
    for (const auto& vertex : mesh.vertices_W)  // float precision of up to 12 m
      ASSERT_NEAR(roundConeDistance(cone, vertex.cast<double>()), 0, 2e-6);
    for (const auto& t : mesh.triangles)
      for (int k = 0; k < 4; ++k) {
        double u = uniform(0, 1), v = uniform(0, 1);
        if (u + v > 1) u = 1 - u, v = 1 - v;
        const Vector3d p = ((1 - u - v) * mesh.vertices_W[t[0]].cast<double>() +
                            u * mesh.vertices_W[t[1]].cast<double>() + v * mesh.vertices_W[t[2]].cast<double>());
        const double d = roundConeDistance(cone, p);
        ASSERT_LE(d, 2e-6);
        ASSERT_GE(d, -chord_m - 2e-6) << "radius " << radius_m;
      }
  }
}

TEST(PineTessellation, NeedlesAreClosedAndInsideTheirCone) {
  const RoundCone needle{{1, 2, 3}, {1.05, 2.03, 3.08}, 0.0015, 0.0002};
  TriangleMesh mesh;
  appendNeedle(needle, mesh);
  EXPECT_EQ(mesh.triangles.size(), 4u);
  EXPECT_EQ(whyNotClosed(mesh), "");
  EXPECT_TRUE(insideOutCandidates(mesh).empty());
  for (const auto& vertex : mesh.vertices_W) EXPECT_LE(roundConeDistance(needle, vertex.cast<double>()), 1e-6);
}

TEST(Pine, SameSeedSameBytesOtherSeedsDiffer) {
  const Scene one = makePine({3.0, 7}), again = makePine({3.0, 7}), other = makePine({3.0, 8});
  EXPECT_TRUE(sameBytes(one.mesh, again.mesh));
  EXPECT_EQ(one.description, again.description);
  EXPECT_FALSE(sameBytes(one.mesh, other.mesh));
}

TEST(Pine, HasTheDimensionsOfTheDocument) {
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    const PineSkeleton tree = growPine({12.0, seed});
    EXPECT_NEAR(tree.trunk_diameter_m, 0.216, 1e-9);
    EXPECT_EQ(tree.trunk.size(), std::size_t(tree.whorls) + 1);
    EXPECT_GE(tree.whorls, 22);
    EXPECT_LE(tree.whorls, 34);
    EXPECT_GE(tree.branch_count, 4 * tree.whorls);
    EXPECT_LE(tree.branch_count, 7 * tree.whorls);
    for (std::size_t n = 1; n + 1 < tree.trunk.size(); ++n) {
      const RoundCone& piece = tree.trunk[n];
      EXPECT_EQ(piece.a_W, tree.trunk[n - 1].b_W);
      EXPECT_GE(piece.radius_a_m, piece.radius_b_m) << "taper";
      const double internode_m = piece.b_W.z() - piece.a_W.z();
      EXPECT_GE(internode_m, 0.2);
      EXPECT_LE(internode_m, 0.7);
    }
    EXPECT_NEAR(tree.trunk.back().b_W.z(), 12.0, 1e-9);
    double widest_m = 0, highest_m = 0, lowest_branch_m = 12;
    for (const RoundCone& branch : tree.branches) {
      widest_m = std::max(widest_m, branch.b_W.head<2>().norm());
      lowest_branch_m = std::min(lowest_branch_m, branch.a_W.z());
      EXPECT_LE(branch.radius_a_m, 0.025);
      EXPECT_GE(branch.radius_b_m, 0.003);
    }
    for (const RoundCone& needle : tree.needles) {
      highest_m = std::max(highest_m, needle.b_W.z());
      const double length_m = (needle.b_W - needle.a_W).norm();
      ASSERT_GE(length_m, 0.075 - 1e-9);
      ASSERT_LE(length_m, 0.15 + 1e-9);
    }
    EXPECT_GE(widest_m, 1.6);
    EXPECT_LE(widest_m, 2.8);
    EXPECT_GE(highest_m, 12.0);
    EXPECT_LE(highest_m, 12.5);
    EXPECT_NEAR(lowest_branch_m, 1.2, 0.1);
    EXPECT_GE(tree.needles.size(), 100000u);
  }
}

TEST(Pine, EveryPartIsClosedAndThereIsOneForEachCone) {
  const PineSkeleton tree = growPine({4.0, 5});
  const Scene scene = makePine({4.0, 5});
  EXPECT_EQ(whyNotClosed(scene.mesh), "");
  EXPECT_TRUE(insideOutCandidates(scene.mesh).empty());
  EXPECT_EQ(partCount(scene.mesh),
            tree.trunk.size() + tree.branches.size() + tree.twigs.size() + tree.shoots.size() + tree.needles.size());
  ASSERT_TRUE(scene.distance);
  EXPECT_FALSE(scene.distance_note.empty());
  EXPECT_EQ(scene.tessellation_error_m, 0);
}

TEST(Pine, FullSizeStaysBelowThreeMillionTriangles) {
  std::size_t most = 0;
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    const PineSkeleton tree = growPine({12.0, seed});
    TriangleMesh mesh;
    for (const auto* order : {&tree.trunk, &tree.branches, &tree.twigs, &tree.shoots})
      for (const RoundCone& cone : *order) appendRoundCone(cone, 0.001, mesh);
    most = std::max(most, mesh.triangles.size() + 4 * tree.needles.size());
  }
  EXPECT_LT(most, 3000000u);
}

TEST(Pine, DistanceIsThatToItsTriangles) {
  const PineSkeleton tree = growPine({2.0, 3});
  const Scene scene = makePine({2.0, 3});
  std::mt19937 generator(11);
  const auto uniform = [&](double low, double high) { return low + (high - low) * (generator() * 0x1p-32); };
  int inside = 0;
  for (int n = 0; n < 150; ++n) {
    // Half of the points anywhere, half in the wood or close to it.
    Vector3d p(uniform(-0.6, 0.6), uniform(-0.6, 0.6), uniform(0, 2.2));
    if (n % 2 == 1) {
      const auto& pieces = n % 4 == 1 ? tree.trunk : tree.branches;
      const RoundCone& piece = pieces[generator() % pieces.size()];
      p = piece.a_W + uniform(0, 1) * (piece.b_W - piece.a_W) +
          1.2 * piece.radius_a_m * Vector3d(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1));
    }
    double nearest_m = std::numeric_limits<double>::infinity();
    for (const auto& t : scene.mesh.triangles) {  // upper bound by corners first; exact by dense search on the few left
      const Vector3d a = scene.mesh.vertices_W[t[0]].cast<double>(), b = scene.mesh.vertices_W[t[1]].cast<double>(),
                     c = scene.mesh.vertices_W[t[2]].cast<double>();
      const Vector3d normal = (b - a).cross(c - a).normalized();
      const double height = normal.dot(p - a);
      if (std::abs(height) >= nearest_m) continue;
      const Vector3d q = p - height * normal;
      const bool above = (b - a).cross(q - a).dot(normal) >= 0 && (c - b).cross(q - b).dot(normal) >= 0 &&
                         (a - c).cross(q - c).dot(normal) >= 0;
      if (above) {
        nearest_m = std::abs(height);
        continue;
      }
      for (const auto& [from, to] : {std::pair(a, b), std::pair(b, c), std::pair(c, a)}) {
        const Eigen::ParametrizedLine<double, 3> line = Eigen::ParametrizedLine<double, 3>::Through(from, to);
        const double along = std::clamp(line.direction().dot(p - from), 0.0, (to - from).norm());
        nearest_m = std::min(nearest_m, (line.pointAt(along) - p).norm());
      }
    }
    const double d = scene.distance->at(p);
    ASSERT_NEAR(std::abs(d), nearest_m, 1e-9) << p.transpose();
    // The sign, where the cones determine it beyond their chords (needles: beyond their radius, they are pyramids).
    double wood_m = std::numeric_limits<double>::infinity(), needles_m = wood_m;
    for (const auto* order : {&tree.trunk, &tree.branches, &tree.twigs, &tree.shoots})
      for (const RoundCone& cone : *order) wood_m = std::min(wood_m, roundConeDistance(cone, p));
    for (const RoundCone& needle : tree.needles) {
      if ((p - 0.5 * (needle.a_W + needle.b_W)).norm() > 0.1) continue;
      needles_m = std::min(needles_m, roundConeDistance(needle, p));
    }
    if (wood_m < -0.0011) {
      EXPECT_LT(d, 0) << p.transpose();
      ++inside;
    } else if (wood_m > 0 && needles_m > 0) {
      EXPECT_GT(d, 0) << p.transpose();
    }
  }
  EXPECT_GE(inside, 15);
}

TEST(Pine, RefusesHeightsThatNoPineHas) {
  for (const double height_m :
       {0.0, 1.9, 61.0, -12.0, std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()})
    EXPECT_THROW((void)makePine({height_m, 1}), InvalidArgument) << height_m;
}

}  // namespace
}  // namespace accessvdb::sim

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The scenes for tilted tools: each distance against its mesh, and the parts that are said to be hidden.
#include "sim/tilt_scenes.h"

#include <gtest/gtest.h>

#include <cmath>

#include "accessvdb/error.h"
#include "sim/composite_distance.h"
#include "sim/counter_random.h"
#include "sim/mesh_distance.h"
#include "sim/scene_catalogue.h"

namespace accessvdb::sim {
namespace {

using Eigen::Vector3d;

TEST(TiltScenes, DistancesAreThoseOfTheMesh) {
  for (const std::string& name : tiltSceneNames()) {
    SCOPED_TRACE(name);
    const Scene scene = benchmarkScene(name, 0.002).scene;
    std::string why_not;
    const auto mesh = makeMeshDistance(scene.mesh, why_not);
    ASSERT_NE(mesh, nullptr) << why_not;
    CounterRandom random({8});
    int inside = 0, near = 0;
    for (int n = 0; n < 4000; ++n) {
      const Vector3d p(random.uniform(-0.15, 0.25), random.uniform(-0.15, 0.15), random.uniform(-0.12, 0.12));
      const double exact = scene.distance->at(p), of_mesh = mesh->at(p);
      // The mesh distance is computed in float, at coordinates below 0.5 m.
      const double tolerance_m = scene.tessellation_error_m + mesh->errorBound_m() + 1e-7;
      // Faces within the material, where boxes overlap, count as surface for the mesh alone.
      if (exact > 0 || name == "cone_well") {
        EXPECT_NEAR(exact, of_mesh, tolerance_m) << p.transpose();
      } else {
        EXPECT_LE(of_mesh, tolerance_m) << p.transpose();
        EXPECT_LE(exact, of_mesh + tolerance_m) << p.transpose();
      }
      inside += exact < 0;
      near += std::abs(exact) < 0.01;
    }
    EXPECT_GT(inside, 100) << "the points do not try the inside";
    EXPECT_GT(near, 200) << "or the surface";
  }
}

TEST(TiltScenes, NormalsPointWhereTheDistanceGrows) {
  for (const std::string& name : tiltSceneNames()) {
    SCOPED_TRACE(name);
    const Scene scene = tiltScene(name)->scene;
    CounterRandom random({9});
    int tried = 0, off = 0;
    for (int n = 0; n < 1000; ++n) {
      const Vector3d p(random.uniform(-0.15, 0.25), random.uniform(-0.15, 0.15), random.uniform(-0.12, 0.12));
      const Vector3d normal = scene.distance->outwardNormal(p);
      EXPECT_NEAR(normal.norm(), 1, 1e-12);
      constexpr double kStep_m = 1e-7;
      const double growth =
          (scene.distance->at(p + kStep_m * normal) - scene.distance->at(p - kStep_m * normal)) / (2 * kStep_m);
      off += std::abs(growth - 1) > 1e-5;
      ++tried;
    }
    // Between two faces equally far away, one step lies on each side; few random points are that near.
    EXPECT_LE(off, tried / 200);
  }
}

TEST(TiltScenes, ATurnedSolidHasItsNormalOnTheSurfaceToo) {
  const TurnedDistance cone({{0, 0}, {1, 0}, {0, 1}});
  EXPECT_NEAR(cone.at({0.5, 0, 0.5}), 0, 1e-12);
  EXPECT_TRUE(cone.outwardNormal({0.5, 0, 0.5}).isApprox(Vector3d(1, 0, 1).normalized(), 1e-9));
  EXPECT_TRUE(cone.outwardNormal({0, -0.5, 0.5}).isApprox(Vector3d(0, -1, 1).normalized(), 1e-9));
  EXPECT_TRUE(cone.outwardNormal({0, 0, 0}).isApprox(Vector3d(0, 0, -1), 1e-9));
  EXPECT_NEAR(cone.at({0, 0, 0.1}), -0.1, 1e-12) << "the axis is no surface";
  EXPECT_NEAR(cone.at({0, 0, 3}), 2, 1e-12);
}

TEST(TiltScenes, HiddenPartsHoldSurfaceAndOnlyThat) {
  for (const std::string& name : tiltSceneNames()) {
    SCOPED_TRACE(name);
    const Scene scene = tiltScene(name)->scene;
    const HiddenPart part = hiddenPart(name, 0.006, 0.002);
    CounterRandom random({10});
    int on_it = 0;
    for (int n = 0; n < 30000; ++n) {
      Vector3d p(random.uniform(-0.1, 0.2), random.uniform(-0.1, 0.1), random.uniform(-0.08, 0.08));
      p -= scene.distance->at(p) * scene.distance->outwardNormal(p);
      if (std::abs(scene.distance->at(p)) < 1e-6 && part.holds(scene, p)) ++on_it;
    }
    EXPECT_GT(on_it, 20);
    EXPECT_FALSE(part.holds(scene, {0, 0, 0.5}));
  }
  const Scene table = tiltScene("table_underside")->scene;
  const HiddenPart underside = hiddenPart("table_underside", 0.006, 0.002);
  EXPECT_TRUE(underside.holds(table, {0.05, 0, 0.0299}));
  EXPECT_FALSE(underside.holds(table, {0.05, 0, 0.05})) << "the top";
  EXPECT_FALSE(underside.holds(table, {0.08, 0.09, 0.0299})) << "a leg";
  EXPECT_THROW((void)hiddenPart("torus", 0.006, 0.002), InvalidArgument);
  EXPECT_FALSE(tiltScene("torus").has_value());
}

TEST(TiltScenes, PathsStayOutsideAndSeeFromAboveAndBelow) {
  for (const std::string& name : tiltSceneNames()) {
    const BenchmarkScene view = benchmarkScene(name, 0.002);
    ASSERT_EQ(static_cast<int>(view.trajectory.size()), view.frames);
    double highest = 0, lowest = 0;
    for (const Eigen::Isometry3d& T_W_S : view.trajectory) {
      EXPECT_GT(view.scene.distance->at(T_W_S.translation()), 0.05) << name;
      highest = std::max(highest, T_W_S.translation().z());
      lowest = std::min(lowest, T_W_S.translation().z());
    }
    EXPECT_GT(highest, 0.7);
    EXPECT_LT(lowest, -0.7);
  }
}

}  // namespace
}  // namespace accessvdb::sim

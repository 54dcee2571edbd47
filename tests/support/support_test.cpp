// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The sample-scan generator against hand calculation and against implicit functions of its shapes.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <numbers>
#include <sstream>

#include "accessvdb/error.h"
#include "sample_scans/random_stream.h"
#include "support/walk_generator.h"

namespace accessvdb::test {
namespace {

using Eigen::Vector3d;
using samples::Box;
using samples::Bump;
using samples::Capsule;
using samples::enterDistance;
using samples::Ray;
using samples::TaperedCylinder;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kExact = 1e-12;  // a handful of roundings of lengths of a few metres

Ray ray(const Vector3d& origin, const Vector3d& direction) { return {origin, direction.normalized()}; }

TEST(AnalyticScene, GroundPlane) {
  const AnalyticScene scene({});
  EXPECT_NEAR(scene.castRay(ray({3, 4, 1.5}, {0, 0, -1})), 1.5, kExact);
  EXPECT_NEAR(scene.castRay(ray({0, 0, 1}, {1, 0, -1})), std::sqrt(2.0), kExact);
  EXPECT_EQ(scene.castRay(ray({0, 0, 1}, {1, 0, 0})), kInfinity);
  EXPECT_EQ(scene.castRay(ray({0, 0, 1}, {1, 0, 1})), kInfinity);
}

TEST(AnalyticScene, TaperedCylinder) {
  const TaperedCylinder straight{{0, 0, 0}, 2.0, 0.5, 0.5};
  EXPECT_NEAR(enterDistance(straight, ray({-2, 0, 1}, {1, 0, 0})), 1.5, kExact);
  EXPECT_NEAR(enterDistance(straight, ray({-2, 0.3, 1}, {1, 0, 0})), 1.6, kExact);  // 2 - sqrt(0.25 - 0.09)
  EXPECT_NEAR(enterDistance(straight, ray({0.2, 0, 5}, {0, 0, -1})), 3.0, kExact);  // top
  EXPECT_EQ(enterDistance(straight, ray({-2, 0.51, 1}, {1, 0, 0})), kInfinity);
  EXPECT_EQ(enterDistance(straight, ray({-2, 0, 2.01}, {1, 0, 0})), kInfinity);
  EXPECT_EQ(enterDistance(straight, ray({-2, 0, 1}, {-1, 0, 0})), kInfinity);  // behind

  const TaperedCylinder tapered{{0, 0, 0}, 2.0, 0.5, 0.1};
  EXPECT_NEAR(enterDistance(tapered, ray({-2, 0, 1}, {1, 0, 0})), 1.7, kExact);  // radius 0.3 half way up
  EXPECT_NEAR(enterDistance(tapered, ray({0.3, 0, 5}, {0, 0, -1})), 4.0, kExact);
}

TEST(AnalyticScene, CapsuleBoxAndBump) {
  const Capsule capsule{{0, -1, 0}, {0, 1, 0}, 0.25};
  EXPECT_NEAR(enterDistance(capsule, ray({-2, 0.5, 0}, {1, 0, 0})), 1.75, kExact);
  EXPECT_NEAR(enterDistance(capsule, ray({0, 3, 0}, {0, -1, 0})), 1.75, kExact);  // along its axis
  EXPECT_NEAR(enterDistance(capsule, ray({-2, 1.15, 0}, {1, 0, 0})), 1.8,
              kExact);  // round end: 2 - sqrt(1/16 - 0.15^2)
  EXPECT_EQ(enterDistance(capsule, ray({-2, 1.26, 0}, {1, 0, 0})), kInfinity);

  const Box box{{0, 0, 1}, {0.5, 0.5, 1}, std::numbers::pi / 4};
  EXPECT_NEAR(enterDistance(box, ray({-2, 0, 1}, {1, 0, 0})), 2.0 - std::sqrt(0.5), kExact);  // its edge
  EXPECT_NEAR(enterDistance(box, ray({-2, 0.2, 1}, {1, 0, 0})), 2.2 - std::sqrt(0.5), kExact);
  EXPECT_EQ(enterDistance(box, ray({-2, 0, 2.5}, {1, 0, 0})), kInfinity);

  EXPECT_NEAR(enterDistance(Bump{1, 2, 0.1, 5}, ray({1, 2, 3}, {0, 0, -1})), 2.9, kExact);
}

TEST(AnalyticScene, HierarchyFindsWhatALoopOverAllShapesFinds) {
  const WalkGenerator walk({.frames = 20, .seed = 7});
  const AnalyticScene& scene = walk.scene();
  ASSERT_GT(scene.shapes().size(), 500u);
  samples::RandomStream random(5);
  int on_shapes = 0;
  for (int i = 0; i < 3000; ++i) {
    const Ray r = ray({random.uniform(-2, 4), 0.3, 1.3},
                      {random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-0.4, 0.6)});
    const double ground = r.direction.z() < 0 ? -r.origin.z() / r.direction.z() : kInfinity;
    double nearest = ground;
    for (const auto& shape : scene.shapes()) nearest = std::min(nearest, enterDistance(shape, r));
    ASSERT_EQ(scene.castRay(r), nearest) << "ray " << i;
    if (nearest < ground) ++on_shapes;
  }
  EXPECT_GT(on_shapes, 500);
}

/// Signed distance-like function of a shape, zero on its surface: written without the ray formulas.
double implicitValue(const samples::Shape& shape, const Vector3d& p) {
  if (const auto* capsule = std::get_if<Capsule>(&shape)) {
    const Vector3d span = capsule->end - capsule->begin;
    const double t = std::clamp((p - capsule->begin).dot(span) / span.squaredNorm(), 0.0, 1.0);
    return (p - capsule->begin - t * span).norm() - capsule->radius;
  }
  if (const auto* cylinder = std::get_if<TaperedCylinder>(&shape)) {
    const Vector3d q = p - cylinder->base;
    const double radius =
        cylinder->base_radius + (cylinder->top_radius - cylinder->base_radius) * q.z() / cylinder->height;
    return std::max({q.head<2>().norm() - radius, -q.z(), q.z() - cylinder->height});
  }
  if (const auto* box = std::get_if<Box>(&shape)) {
    const Eigen::AngleAxisd turn(-box->yaw_rad, Vector3d::UnitZ());
    return ((turn * (p - box->centre)).cwiseAbs() - box->half_size).maxCoeff();
  }
  const auto& bump = std::get<Bump>(shape);
  return (p - Vector3d(bump.x, bump.y, bump.height - bump.sphere_radius)).norm() - bump.sphere_radius;
}

TEST(WalkGenerator, EveryReturnLiesOnASurfaceAndInNone) {
  const WalkGenerator walk({.frames = 10, .rays_per_frame = 4000, .seed = 3, .offset_W = {100, -50, 7}});
  const WalkFrame frame = walk.frame(6);
  ASSERT_EQ(frame.points_S.size(), 4000u);
  int returns = 0, ground = 0;
  for (const Eigen::Vector3f& point_S : frame.points_S) {
    if (point_S == Eigen::Vector3f::Zero()) continue;
    ++returns;
    const Vector3d p = frame.T_W_S * point_S.cast<double>() - Vector3d(100, -50, 7);
    double nearest = p.z();
    for (const auto& shape : walk.scene().shapes()) nearest = std::min(nearest, implicitValue(shape, p));
    ASSERT_NEAR(nearest, 0.0, 5e-6) << p.transpose();  // points are float32 at up to 30 m: steps of 1.9e-6
    if (std::abs(p.z()) < 5e-6) ++ground;
    const Vector3d direction = point_S.cast<double>().normalized();
    const double elevation = std::asin(direction.z()) * 180 / std::numbers::pi;
    ASSERT_GE(elevation, -7.001);
    ASSERT_LE(elevation, 52.001);
  }
  EXPECT_GT(returns, 1500);
  EXPECT_LT(returns, 4000);  // the sky gives none
  EXPECT_GT(ground, 100);
  EXPECT_GT(returns - ground, 500);
}

TEST(WalkGenerator, SameOptionsSameFrames) {
  const WalkOptions options{.frames = 5, .rays_per_frame = 500, .range_noise_m = 0.02, .seed = 9};
  const WalkGenerator a(options), b(options);
  (void)a.frame(0);  // the order of requests must not matter
  EXPECT_EQ(a.frame(3).points_S, b.frame(3).points_S);
  EXPECT_TRUE(a.pose(3).matrix() == b.pose(3).matrix());
  EXPECT_NE(a.frame(3).points_S, a.frame(4).points_S);
  WalkOptions other = options;
  other.seed = 10;
  EXPECT_NE(a.frame(3).points_S, WalkGenerator(other).frame(3).points_S);
}

TEST(WalkGenerator, PatternContinuesOverFrames) {
  const WalkGenerator walk({.frames = 2, .rays_per_frame = 100});
  EXPECT_NE(walk.rayDirection_S(0, 5), walk.rayDirection_S(1, 5));
  EXPECT_EQ(walk.rayDirection_S(1, 0), walk.rayDirection_S(0, 100));
  // Halton index 1 in bases 2 and 3: azimuth 1/2 of 360, elevation a third of [-7, 52] degrees.
  const Vector3d first = walk.rayDirection_S(0, 0);
  EXPECT_NEAR(std::atan2(first.y(), first.x()), std::numbers::pi, kExact);
  EXPECT_NEAR(std::asin(first.z()) * 180 / std::numbers::pi, -7.0 + 59.0 / 3.0, 1e-9);
}

TEST(WalkGenerator, RangeNoiseHasTheSigmaAskedFor) {
  WalkOptions options{.frames = 1, .rays_per_frame = 20000, .seed = 4};
  const WalkFrame clean = WalkGenerator(options).frame(0);
  options.range_noise_m = 0.03;
  const WalkFrame noisy = WalkGenerator(options).frame(0);
  double sum = 0, sum2 = 0;
  int n = 0;
  for (std::size_t i = 0; i < clean.points_S.size(); ++i) {
    const double c = clean.points_S[i].cast<double>().norm(), d = noisy.points_S[i].cast<double>().norm();
    if (c == 0 || d == 0 || c > 29.0) continue;  // near the maximum range, only the short ones are returned
    ASSERT_NEAR(clean.points_S[i].cast<double>().normalized().dot(noisy.points_S[i].cast<double>().normalized()), 1.0,
                1e-9);
    sum += d - c;
    sum2 += (d - c) * (d - c);
    ++n;
  }
  ASSERT_GT(n, 8000);
  // Four standard errors of the mean and of the standard deviation.
  EXPECT_NEAR(sum / n, 0.0, 4 * 0.03 / std::sqrt(n));
  EXPECT_NEAR(std::sqrt(sum2 / n), 0.03, 4 * 0.03 / std::sqrt(2.0 * n));
}

TEST(WalkGenerator, RefusesBadOptions) {
  EXPECT_THROW(WalkGenerator({.frames = 0}), InvalidArgument);
  EXPECT_THROW(WalkGenerator({.range_noise_m = std::nan("")}), InvalidArgument);
  EXPECT_THROW(WalkGenerator({.max_range_m = -1}), InvalidArgument);
}

class ScanFolder : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
    folder_ = std::filesystem::path(::testing::TempDir()) / (std::string("accessvdb_scan_folder_") + info->name());
    std::filesystem::remove_all(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  static std::string content(const std::filesystem::path& path) {
    std::ifstream stream(path, std::ios::binary);
    std::stringstream text;
    text << stream.rdbuf();
    return text.str();
  }
  std::filesystem::path folder_;
};

TEST_F(ScanFolder, HoldsTheFramesBitForBit) {
  const WalkGenerator walk({.frames = 3, .rays_per_frame = 50, .range_noise_m = 0.02});
  writeScanFolder(folder_ / "deep", walk);
  const std::string pcd = content(folder_ / "deep" / "000002.pcd");
  const std::size_t data = pcd.find("DATA binary\n");
  ASSERT_NE(data, std::string::npos);
  EXPECT_NE(pcd.find("\nPOINTS 50\n"), std::string::npos);
  const std::vector<Eigen::Vector3f> expected = walk.frame(2).points_S;
  ASSERT_EQ(pcd.size() - data - 12, 50 * 12u);
  EXPECT_EQ(std::memcmp(pcd.data() + data + 12, expected.data(), 50 * 12), 0);

  std::istringstream poses(content(folder_ / "deep" / "poses.txt"));
  std::string comment;
  std::getline(poses, comment);
  for (int i = 0; i < 3; ++i) {
    double t, x, y, z, qx, qy, qz, qw;
    ASSERT_TRUE(poses >> t >> x >> y >> z >> qx >> qy >> qz >> qw);
    EXPECT_NEAR(t, 0.1 * i, 1e-6);
    EXPECT_TRUE(walk.pose(i).translation().isApprox(Vector3d(x, y, z), 1e-11));
    EXPECT_TRUE(walk.pose(i).linear().isApprox(Eigen::Quaterniond(qw, qx, qy, qz).toRotationMatrix(), 1e-12));
  }
  EXPECT_EQ(content(folder_ / "deep" / "range_noise.txt"), "0.02\n");
}

TEST_F(ScanFolder, NamesByStampAndRefusesToMix) {
  const WalkGenerator walk({.frames = 2, .rays_per_frame = 10});
  writeScanFolder(folder_, walk, ScanNames::TimeStamp);
  EXPECT_TRUE(std::filesystem::exists(folder_ / "0000000000.100000.pcd"));
  EXPECT_NO_THROW(writeScanFolder(folder_, walk, ScanNames::TimeStamp));  // overwrites its own files
  EXPECT_THROW(writeScanFolder(folder_, walk, ScanNames::FrameNumber), OutputError);
}

}  // namespace
}  // namespace accessvdb::test

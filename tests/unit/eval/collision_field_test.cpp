// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "eval/collision_field.h"

#include <gtest/gtest.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <vector>

#include "accessvdb/error.h"
#include "sim/pine.h"

namespace accessvdb::eval {
namespace {

using Eigen::AlignedBox3d;
using Eigen::Vector3d;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// A ball and a slab; counts its evaluations.
class BallAndSlab final : public sim::SignedDistance {
 public:
  double at(const Vector3d& p) const override {
    ++asked;
    return std::min((p - Vector3d(0.1, 0.2, 0.3)).norm() - 0.15, std::abs(p.z() + 0.3) - 0.02);
  }
  Vector3d outwardNormal(const Vector3d&) const override { return Vector3d::UnitZ(); }
  mutable std::atomic<std::uint64_t> asked{0};
};

std::vector<Vector3d> randomPoints(int count, const AlignedBox3d& box, std::uint32_t seed) {
  std::mt19937 generator(seed);
  std::vector<Vector3d> points;
  for (int n = 0; n < count; ++n) {
    Vector3d share;
    for (int axis = 0; axis < 3; ++axis) share[axis] = generator() * 0x1p-32;
    points.push_back(box.min() + share.cwiseProduct(box.sizes()));
  }
  return points;
}

AlignedBox3d boxOf(const sim::TriangleMesh& mesh) {
  AlignedBox3d box;
  for (const auto& vertex : mesh.vertices_W) box.extend(vertex.cast<double>());
  return box;
}

TEST(CollisionField, AnswersAsTheDistanceDoes) {
  const auto distance = std::make_shared<BallAndSlab>();
  const AlignedBox3d box(Vector3d(-0.5, -0.5, -0.5), Vector3d(0.5, 0.5, 0.6));
  for (const double cell_m : {0.003, 0.01, 0.07, 5.0}) {
    const CollisionField field(distance, box, cell_m);
    AlignedBox3d around = box;
    around.extend(Vector3d(-1, -1, -1)).extend(Vector3d(1, 1, 1));  // outside the box too
    for (const Vector3d& p : randomPoints(4000, around, 1)) {
      const double d = distance->at(p);
      for (const double r : {-0.05, 0.0, std::numeric_limits<double>::denorm_min(), 0.0005, 0.005, 0.3, 2.0})
        ASSERT_EQ(field.below(p, r), d < r) << p.transpose() << " r " << r << " cell " << cell_m;
      ASSERT_EQ(field.below(p, d), false) << "not below itself";
      ASSERT_EQ(field.below(p, std::nextafter(d, kInfinity)), true);
      const CollisionField::Bounds bounds = field.bounds(p);
      ASSERT_LE(bounds.lower_m, d);
      ASSERT_GE(bounds.upper_m, d);
    }
  }
}

TEST(CollisionField, BoundsAreAsFineAsAsked) {
  const auto distance = std::make_shared<BallAndSlab>();
  const CollisionField field(distance, {Vector3d(-0.5, -0.5, -0.5), Vector3d(0.5, 0.5, 0.5)}, 0.01);
  const Vector3d p(0.1, 0.2, 0.0);  // 0.15 m below the ball
  const CollisionField::Bounds finest = field.bounds(p);
  EXPECT_LE(finest.upper_m - finest.lower_m, 0.0174);  // sqrt(3) cells
  EXPECT_GE(field.bounds(p, -kInfinity, 0.13).lower_m, 0.13);
  const CollisionField other(distance, {Vector3d(-0.5, -0.5, -0.5), Vector3d(0.5, 0.5, 0.5)}, 0.01);
  const std::uint64_t before = distance->asked;
  EXPECT_GE(other.bounds(p, -kInfinity, -0.2).lower_m, -0.2);
  EXPECT_EQ(distance->asked - before, 1u) << "one coarse cell says that much";
}

TEST(CollisionField, AsksLittleOnceCellsAreFilled) {
  const auto distance = std::make_shared<BallAndSlab>();
  const AlignedBox3d box(Vector3d(-0.5, -0.5, -0.5), Vector3d(0.5, 0.5, 0.5));
  const CollisionField field(distance, box, 0.01);
  const auto points = randomPoints(300000, box, 2);
  for (const Vector3d& p : points) (void)field.below(p, 0.005);
  const std::uint64_t before = distance->asked;
  for (const Vector3d& p : points) (void)field.below(p, 0.005);
  // Undecided: within sqrt(3)/2 cells of the surface d = r, about 4 % of this box at most.
  EXPECT_LT(distance->asked - before, points.size() / 25);
  EXPECT_GT(field.work().left_open, 0u);
  EXPECT_GT(field.bytes(), 0u);
}

TEST(CollisionField, PineHasNoMismatch) {
  const sim::Scene scene = sim::makePine({2.0, 4});
  const CollisionField field(scene.distance, boxOf(scene.mesh), 0.01);
  std::uint64_t below = 0;
  auto points = randomPoints(20000, boxOf(scene.mesh), 3);
  // Close to the surface, where answers are difficult.
  std::mt19937 generator(5);
  const auto near = randomPoints(20000, {Vector3d(-0.012, -0.012, -0.012), Vector3d(0.012, 0.012, 0.012)}, 6);
  for (const Vector3d& offset : near)
    points.push_back(scene.mesh.vertices_W[generator() % scene.mesh.vertices_W.size()].cast<double>() + offset);
  for (const Vector3d& p : points) {
    const double d = scene.distance->at(p);
    for (const double r : {0.0, 0.005, 0.02}) {
      ASSERT_EQ(field.below(p, r), d < r) << p.transpose() << " r " << r;
      below += d < r;
    }
  }
  EXPECT_GT(below, 10000u);
  EXPECT_LT(below, 100000u);
}

TEST(CollisionField, ThreadsAgree) {
  const sim::Scene scene = sim::makePine({2.0, 4});
  const auto points = randomPoints(20000, boxOf(scene.mesh), 8);
  const CollisionField one(scene.distance, boxOf(scene.mesh), 0.01), many(scene.distance, boxOf(scene.mesh), 0.01);
  std::vector<char> alone, together(points.size());
  for (const Vector3d& p : points) alone.push_back(one.below(p, 0.005));
  tbb::parallel_for(std::size_t(0), points.size(), [&](std::size_t n) { together[n] = many.below(points[n], 0.005); });
  EXPECT_EQ(alone, together);
}

TEST(CollisionField, LittleMemoryIsSlowNotWrong) {
  const auto distance = std::make_shared<BallAndSlab>();
  const AlignedBox3d box(Vector3d(-0.5, -0.5, -0.5), Vector3d(0.5, 0.5, 0.5));
  const std::uint64_t limit = 20000;
  const CollisionField field(distance, box, 0.01, limit);
  for (const Vector3d& p : randomPoints(20000, box, 9)) ASSERT_EQ(field.below(p, 0.005), distance->at(p) < 0.005);
  EXPECT_LE(field.bytes(), limit);
  EXPECT_THROW(CollisionField(distance, box, 0.0005, limit), ResourceLimit);
}

TEST(CollisionField, BadDataCollidesAndBadArgumentsAreRefused) {
  const auto distance = std::make_shared<BallAndSlab>();
  const AlignedBox3d box(Vector3d(-0.5, -0.5, -0.5), Vector3d(0.5, 0.5, 0.5));
  const CollisionField field(distance, box, 0.01);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(field.below({nan, 0, 0}, 0.005));
  EXPECT_TRUE(field.below({0, kInfinity, 0}, 0.005));
  EXPECT_THROW(CollisionField(nullptr, box, 0.01), InvalidArgument);
  EXPECT_THROW(CollisionField(distance, box, 0), InvalidArgument);
  EXPECT_THROW(CollisionField(distance, box, nan), InvalidArgument);
  EXPECT_THROW(CollisionField(distance, AlignedBox3d(), 0.01), InvalidArgument);
  EXPECT_THROW(CollisionField(distance, {Vector3d(0, 0, 0), Vector3d(1, nan, 1)}, 0.01), InvalidArgument);
}

}  // namespace
}  // namespace accessvdb::eval

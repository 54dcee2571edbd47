// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Batch queries at points against the map's own look-ups, one voxel at a time, and a search through all points.
#include "accessvdb/batch_query.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "accessvdb/error.h"
#include "accessvdb/tsdf_volume.h"
#include "support/query_world.h"

namespace accessvdb::test {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

class BatchQueryAt : public testing::Test {
 protected:
  QueryWorld world_;
  const FieldSnapshot snapshot_ = world_.field.snapshot();

  /// The point that answers for a position, by exhaustive search.
  const SurfacePoint* expectedPoint(const Eigen::Vector3d& p_W) const {
    const Eigen::Vector3i voxel = world_.voxelOf(p_W);
    const SurfacePoint* nearest = nullptr;
    double nearest_m = kPointRadiusVoxels * QueryWorld::kVoxel_m;
    for (const SurfacePoint& point : snapshot_.points) {
      if (world_.voxelOf(point.position_W) == voxel) return &point;
      const double distance_m = (point.position_W - p_W).norm();
      if (distance_m > nearest_m) continue;
      nearest_m = distance_m;
      nearest = &point;
    }
    return nearest;
  }

  void expectRight(const PointAnswer& answer, const Eigen::Vector3d& p_W) const {
    const Eigen::Vector3i ijk = world_.voxelOf(p_W);
    const VoxelState voxel = world_.field.volume().at({ijk.x(), ijk.y(), ijk.z()});
    EXPECT_EQ(answer.weight, voxel.weight);
    EXPECT_EQ(answer.cleared, voxel.cleared);
    EXPECT_EQ(answer.unknown, voxel.weight == 0 && !voxel.cleared);
    if (voxel.weight > 0) {
      EXPECT_EQ(answer.distance_m, voxel.distance_m);
    } else {
      EXPECT_TRUE(std::isnan(answer.distance_m));
    }
    const SurfacePoint* point = expectedPoint(p_W);
    ASSERT_EQ(answer.point_id, point == nullptr ? kNoPoint : point->id);
    if (point == nullptr) {
      EXPECT_TRUE(std::isnan(answer.point_distance_m));
      EXPECT_EQ(answer.label, PointLabel::Unscored);
      return;
    }
    EXPECT_NEAR(answer.point_distance_m, (point->position_W - p_W).norm(), 1e-6);
    EXPECT_EQ(answer.label, point->label);
    EXPECT_EQ(answer.reason, point->reason);
    EXPECT_EQ(answer.score, point->score);
    EXPECT_EQ(answer.direction, point->direction);
    EXPECT_EQ(answer.direction_W, point->direction_W);
  }
};

TEST_F(BatchQueryAt, EqualsLookingAtEverything) {
  std::vector<Eigen::Vector3d> points_W;
  for (const double off_m : {0.0, 0.01, 0.1, 0.25}) {
    const auto more = world_.nearSurface(snapshot_, 500, off_m, 3);
    points_W.insert(points_W.end(), more.begin(), more.end());
  }
  std::vector<PointAnswer> answers(points_W.size());
  world_.field.batchQuery().at(points_W, answers);
  std::size_t unknown = 0, cleared = 0, observed = 0, own = 0, near = 0, none = 0;
  std::array<std::size_t, kNumPointLabels> labels = {};
  for (std::size_t n = 0; n < points_W.size(); ++n) {
    SCOPED_TRACE(n);
    expectRight(answers[n], points_W[n]);
    if (HasFatalFailure() || HasNonfatalFailure()) return;
    unknown += answers[n].unknown;
    cleared += answers[n].cleared;
    observed += answers[n].weight > 0;
    const bool has = answers[n].point_id != kNoPoint;
    own += has && world_.field.pointAt(points_W[n]).has_value();
    near += has && !world_.field.pointAt(points_W[n]).has_value();
    none += !has;
    ++labels[static_cast<std::size_t>(answers[n].label)];
  }
  // Every kind of answer occurred often.
  for (const std::size_t count : {unknown, cleared, observed, own, near, none, labels[0], labels[1], labels[2]}) {
    EXPECT_GT(count, 30u);
  }
}

TEST_F(BatchQueryAt, BadPositionsAreUnknown) {
  const Eigen::Vector3d good = snapshot_.points[0].position_W;
  const std::vector<Eigen::Vector3d> points_W = {{kNan, good.y(), good.z()},           {good.x(), kNan, good.z()},
                                                 {good.x(), good.y(), kNan},           {kInfinity, good.y(), good.z()},
                                                 {good.x(), -kInfinity, good.z()},     {1e300, good.y(), good.z()},
                                                 {good.x() + 1e6, good.y(), good.z()}, good};
  std::vector<PointAnswer> answers(points_W.size());
  world_.field.batchQuery().at(points_W, answers);
  for (std::size_t n = 0; n + 1 < points_W.size(); ++n) {
    EXPECT_TRUE(answers[n].unknown) << n;
    EXPECT_FALSE(answers[n].cleared) << n;
    EXPECT_EQ(answers[n].weight, 0u) << n;
    EXPECT_TRUE(std::isnan(answers[n].distance_m)) << n;
    EXPECT_EQ(answers[n].point_id, kNoPoint) << n;
    EXPECT_NE(answers[n].label, PointLabel::Accessible) << n;
  }
  EXPECT_EQ(answers.back().point_id, 0u);  // and the valid one among them is answered
}

TEST_F(BatchQueryAt, ColumnsOfAMatrix) {
  const auto points_W = world_.nearSurface(snapshot_, 100, 0.1, 4);
  Eigen::Matrix3Xd columns(3, 100), every_second(3, 200);
  for (int n = 0; n < 100; ++n) {
    columns.col(n) = points_W[static_cast<std::size_t>(n)];
    every_second.col(2 * n) = columns.col(n);
    every_second.col(2 * n + 1).setConstant(kNan);
  }
  const BatchQuery query = world_.field.batchQuery();
  std::vector<PointAnswer> answers(100);
  query.at(points_W, answers);
  const auto of_columns = query.at(columns);
  const auto of_gaps = query.at(
      Eigen::Map<Eigen::Matrix3Xd, 0, Eigen::OuterStride<>>(every_second.data(), 3, 100, Eigen::OuterStride<>(6)));
  ASSERT_EQ(of_columns.size(), 100u);
  ASSERT_EQ(of_gaps.size(), 100u);
  for (std::size_t n = 0; n < 100; ++n) {
    EXPECT_EQ(of_columns[n].point_id, answers[n].point_id);
    EXPECT_EQ(of_columns[n].weight, answers[n].weight);
    EXPECT_EQ(of_gaps[n].point_id, answers[n].point_id);
    EXPECT_EQ(of_gaps[n].weight, answers[n].weight);
  }
}

TEST_F(BatchQueryAt, ThreadsGiveTheSameBytes) {
  QueryWorld one(1);
  const auto points_W = world_.nearSurface(snapshot_, 20000, 0.15, 5);
  std::vector<PointAnswer> a(points_W.size()), b(points_W.size());
  world_.field.batchQuery().at(points_W, a);
  one.field.batchQuery().at(points_W, b);
  for (std::size_t n = 0; n < a.size(); ++n) {
    ASSERT_EQ(a[n].point_id, b[n].point_id);
    ASSERT_EQ(std::memcmp(&a[n].distance_m, &b[n].distance_m, sizeof(float)), 0);
    ASSERT_EQ(a[n].label, b[n].label);
  }
}

TEST_F(BatchQueryAt, SizesMustAgree) {
  const BatchQuery query = world_.field.batchQuery();
  std::vector<PointAnswer> answers(2);
  try {
    query.at(std::vector<Eigen::Vector3d>(3), answers);
    FAIL() << "no error";
  } catch (const InvalidArgument& error) {
    EXPECT_EQ(error.id(), "query.sizes");
  }
  query.at(std::span<const Eigen::Vector3d>(), std::span<PointAnswer>());  // an empty query is valid too
}

TEST_F(BatchQueryAt, EndsWhenTheFieldChanges) {
  const auto stale = [](const BatchQuery& query) {
    try {
      (void)query.at(Eigen::Matrix3Xd::Zero(3, 1));
    } catch (const InvalidArgument& error) {
      return error.id() == "query.stale" && !query.current();
    }
    return false;
  };
  AccessibilityField& field = world_.field;
  const BatchQuery before = field.batchQuery();
  EXPECT_TRUE(before.current());
  EXPECT_EQ(before.revision(), field.revision());
  field.update();
  EXPECT_TRUE(stale(before));
  const BatchQuery after = field.batchQuery();
  EXPECT_FALSE(stale(after));
  EXPECT_FALSE(stale(field.batchQuery()));
  world_.integrate(1);
  EXPECT_TRUE(stale(after));

  const BatchQuery of_moved = field.batchQuery();
  std::optional<AccessibilityField> elsewhere(std::move(field));
  EXPECT_FALSE(stale(of_moved));  // the field lives on, in another place
  elsewhere.reset();
  EXPECT_TRUE(stale(of_moved));
}

TEST_F(BatchQueryAt, NewPointsAreUnscoredUntilTheUpdate) {
  world_.field.update();
  const auto known = world_.field.snapshot().points.size();
  // A plate in the air, in previously empty space.
  std::vector<Eigen::Vector3d> plate, origin = {world_.origin() + Eigen::Vector3d(0, 0, 6)};
  for (int x = 0; x < 20; ++x) plate.push_back(world_.origin() + Eigen::Vector3d(0.05 * x, 0, 5));
  world_.field.integrateRays(plate, origin);
  const auto answers = world_.field.batchQuery().at(Eigen::Map<Eigen::Matrix3Xd>(plate[0].data(), 3, 20));
  for (const PointAnswer& answer : answers) {
    EXPECT_GE(answer.point_id, known);
    EXPECT_NE(answer.point_id, kNoPoint);
    EXPECT_EQ(answer.label, PointLabel::Unscored);
    EXPECT_EQ(answer.reason, PointReason::Confidence);
  }
}

TEST(BatchQueryEmpty, NothingIsKnown) {
  const AccessibilityField field(ToolGeometry::builtin("builtin:pencil"), {.tsdf = {.voxel_size_m = 0.05}});
  const auto answers = field.batchQuery().at(Eigen::Matrix3Xd::Random(3, 50));
  for (const PointAnswer& answer : answers) {
    EXPECT_TRUE(answer.unknown);
    EXPECT_EQ(answer.point_id, kNoPoint);
  }
  const CapsuleQuery capsule{{0, 0, 0}, {1, 0, 0}, 0.1};
  const CapsuleAnswer answer = field.batchQuery().along({&capsule, 1})[0];
  EXPECT_TRUE(answer.unknown && answer.valid && !answer.collision);
  EXPECT_TRUE(std::isnan(answer.min_distance_m));
}

}  // namespace
}  // namespace accessvdb::test

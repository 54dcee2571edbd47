// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Batch queries in C: they give the same answers as in C++ for every version of the structs, and refuse bad calls.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <span>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/batch_query.h"
#include "accessvdb/c_api.h"
#include "accessvdb/pose_query.h"
#include "package/walked_fields.h"

namespace {

class CApiQuery : public accessvdb::test::WalkedFields {
 protected:
  void SetUp() override {
    WalkedFields::SetUp();
    if (HasFatalFailure()) return;
    int n = 0;
    for (const auto& point : cpp_.snapshot().points) {  // at, beside and above the surface
      points_W_.emplace_back(point.position_W + Eigen::Vector3d(0.04 * (n % 5), 0.05 * (n % 3), 0.1 * (n % 4)));
      capsules_.push_back({{points_W_.back().x(), points_W_.back().y(), points_W_.back().z()},
                           {points_W_.back().x(), points_W_.back().y() + 0.3, points_W_.back().z() + 0.1 * (n % 7)},
                           0.03 * (n % 4)});
      ++n;
    }
    points_W_[3].x() = std::nan("");
    capsules_[5].radius_m = -1;
    ASSERT_GT(points_W_.size(), 500u);
  }

  static bool same(float a, float b) { return a == b || (std::isnan(a) && std::isnan(b)); }

  std::vector<Eigen::Vector3d> points_W_;
  std::vector<accessvdb_capsule> capsules_;
};

TEST_F(CApiQuery, PointsAsInCpp) {
  struct Later {
    accessvdb_point_answer known;
    std::uint64_t of_tomorrow;
  };
  std::vector<accessvdb_point_answer> c(points_W_.size());
  std::vector<Later> later(points_W_.size(), Later{{}, 9});
  std::vector<accessvdb::PointAnswer> cpp(points_W_.size());
  cpp_.batchQuery().at(points_W_, cpp);
  ASSERT_EQ(accessvdb_field_query_points(c_, points_W_[0].data(), c.size(), c.data(), sizeof c[0]), ACCESSVDB_OK);
  ASSERT_EQ(accessvdb_field_query_points(c_, points_W_[0].data(), c.size(), &later[0].known, sizeof later[0]),
            ACCESSVDB_OK);
  std::size_t accessible = 0, unknown = 0;
  for (std::size_t n = 0; n < c.size(); ++n) {
    ASSERT_TRUE(same(c[n].distance_m, cpp[n].distance_m));
    ASSERT_TRUE(same(c[n].point_distance_m, cpp[n].point_distance_m));
    for (int axis = 0; axis < 3; ++axis) ASSERT_EQ(c[n].direction_W[axis], cpp[n].direction_W[axis]);
    ASSERT_EQ(c[n].point_id, cpp[n].point_id);
    ASSERT_EQ(c[n].weight, cpp[n].weight);
    ASSERT_EQ(c[n].direction, cpp[n].direction);
    ASSERT_EQ(c[n].score, cpp[n].score);
    ASSERT_EQ(c[n].label, static_cast<std::uint8_t>(cpp[n].label));
    ASSERT_EQ(c[n].reason, static_cast<std::uint8_t>(cpp[n].reason));
    ASSERT_EQ(c[n].unknown, std::uint8_t{cpp[n].unknown});
    ASSERT_EQ(c[n].cleared, std::uint8_t{cpp[n].cleared});
    ASSERT_EQ(std::memcmp(&c[n], &later[n].known, sizeof c[n]), 0);
    ASSERT_EQ(later[n].of_tomorrow, 0u);
    accessible += c[n].label == ACCESSVDB_ACCESSIBLE;
    unknown += c[n].unknown;
  }
  EXPECT_GT(accessible, 50u);
  EXPECT_GT(unknown, 10u);
  EXPECT_EQ(c[3].unknown, 1);
}

TEST_F(CApiQuery, CapsulesAsInCpp) {
  struct Later {
    accessvdb_capsule known;
    std::uint64_t of_tomorrow;
  };
  std::vector<accessvdb::CapsuleQuery> questions;
  std::vector<Later> later;
  for (const accessvdb_capsule& c : capsules_) {
    questions.push_back({Eigen::Vector3d(c.a_W), Eigen::Vector3d(c.b_W), c.radius_m});
    later.push_back({c, 0});
  }
  const auto cpp = cpp_.batchQuery().along(questions);
  std::vector<accessvdb_capsule_answer> c(capsules_.size()), of_later(capsules_.size());
  ASSERT_EQ(accessvdb_field_query_capsules(c_, capsules_.data(), sizeof capsules_[0], c.size(), c.data(), sizeof c[0]),
            ACCESSVDB_OK);
  ASSERT_EQ(
      accessvdb_field_query_capsules(c_, &later[0].known, sizeof later[0], c.size(), of_later.data(), sizeof c[0]),
      ACCESSVDB_OK);
  std::size_t collisions = 0;
  for (std::size_t n = 0; n < c.size(); ++n) {
    ASSERT_TRUE(same(c[n].min_distance_m, cpp[n].min_distance_m));
    ASSERT_TRUE(same(c[n].first_hit_t, cpp[n].first_hit_t));
    ASSERT_EQ(c[n].collision, std::uint8_t{cpp[n].collision});
    ASSERT_EQ(c[n].unknown, std::uint8_t{cpp[n].unknown});
    ASSERT_EQ(c[n].valid, std::uint8_t{cpp[n].valid});
    ASSERT_EQ(std::memcmp(&c[n], &of_later[n], sizeof c[n]), 0);
    collisions += c[n].collision;
  }
  EXPECT_GT(collisions, 50u);
  EXPECT_EQ(c[5].valid, 0);
  later[2].of_tomorrow = 1;  // requests something that this library cannot provide
  expectUsage(
      accessvdb_field_query_capsules(c_, &later[0].known, sizeof later[0], c.size(), of_later.data(), sizeof c[0]),
      "c_api.unknown_fields");
}

TEST_F(CApiQuery, FitsAsInCpp) {
  struct Later {
    accessvdb_fit known;
    std::uint64_t of_tomorrow;
  };
  std::vector<Eigen::Isometry3d> T_WT;
  std::vector<double> rows;
  for (std::size_t n = 0; n < 300; ++n) {
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.translation() = n == 3 ? Eigen::Vector3d(1e9, 0, 0) : points_W_[n];
    pose.linear() = Eigen::AngleAxisd(0.1 * static_cast<double>(n), Eigen::Vector3d(1, 2, 3).normalized()).matrix();
    T_WT.push_back(pose);
    for (Eigen::Index row = 0; row < 4; ++row)
      for (Eigen::Index column = 0; column < 4; ++column) rows.push_back(pose.matrix()(row, column));
  }
  for (const int contact : {0, 1}) {
    const auto cpp = cpp_.poseQuery().fits(T_WT, {.contact = contact != 0});
    std::vector<accessvdb_fit> c(T_WT.size());
    std::vector<Later> later(T_WT.size(), Later{{}, 9});
    ASSERT_EQ(accessvdb_field_fits(c_, rows.data(), c.size(), 0, contact, c.data(), sizeof c[0]), ACCESSVDB_OK);
    ASSERT_EQ(accessvdb_field_fits(c_, rows.data(), c.size(), 0, contact, &later[0].known, sizeof later[0]),
              ACCESSVDB_OK);
    std::size_t collisions = 0;
    for (std::size_t n = 0; n < c.size(); ++n) {
      ASSERT_EQ(c[n].collisions, cpp[n].collisions);
      ASSERT_EQ(c[n].collision_limit, cpp[n].collision_limit);
      ASSERT_EQ(c[n].unknown_voxels, cpp[n].unknown_voxels);
      ASSERT_EQ(c[n].collision, std::uint8_t{cpp[n].collision()});
      ASSERT_EQ(c[n].unknown, std::uint8_t{cpp[n].unknown()});
      ASSERT_EQ(c[n].free, std::uint8_t{cpp[n].free()});
      ASSERT_EQ(c[n].valid, n == 3 ? 0 : 1);
      ASSERT_EQ(std::memcmp(&c[n], &later[n].known, sizeof c[n]), 0);
      ASSERT_EQ(later[n].of_tomorrow, 0U);
      collisions += c[n].collision;
    }
    EXPECT_GT(collisions, contact == 0 ? 50U : 0U);
  }
  const std::span<const Eigen::Isometry3d> way(T_WT.data() + 10, 5);
  const accessvdb::PathFitAnswer along = cpp_.poseQuery().fitsAlong(way);
  accessvdb_path_fit c = {};
  c.struct_size = sizeof c;
  ASSERT_EQ(accessvdb_field_fits_along(c_, rows.data() + 160, 5, 0, &c), ACCESSVDB_OK);
  EXPECT_EQ(c.valid, 1);
  EXPECT_EQ(c.collision, std::uint8_t{along.collision});
  EXPECT_TRUE(c.first_hit == along.first_hit || (std::isnan(c.first_hit) && std::isnan(along.first_hit)));
  accessvdb_fit fit = {};
  expectUsage(accessvdb_field_fits(c_, nullptr, 1, 0, 0, &fit, sizeof fit), "c_api.null");
  expectUsage(accessvdb_field_fits(c_, rows.data(), 1, 0, 0, nullptr, sizeof fit), "c_api.null");
  expectUsage(accessvdb_field_fits(c_, rows.data(), 1, 0, 0, &fit, 4), "c_api.struct_size");
  expectUsage(accessvdb_field_fits(c_, rows.data(), 1, 0, 2, &fit, sizeof fit), "c_api.value");
  expectUsage(accessvdb_field_fits(c_, rows.data(), 1, 7, 0, &fit, sizeof fit), "tool.index");
  expectUsage(accessvdb_field_fits_along(c_, rows.data(), 1, 0, nullptr), "c_api.null");
  rows[12] = 1;
  EXPECT_NE(accessvdb_field_fits(c_, rows.data(), 1, 0, 0, &fit, sizeof fit), ACCESSVDB_OK);
}

TEST_F(CApiQuery, Refusals) {
  accessvdb_point_answer answer = {};
  accessvdb_capsule_answer capsule_answer = {};
  const double p_W[3] = {0, 0, 0};
  expectUsage(accessvdb_field_query_points(c_, nullptr, 1, &answer, sizeof answer), "c_api.null");
  expectUsage(accessvdb_field_query_points(c_, p_W, 1, nullptr, sizeof answer), "c_api.null");
  expectUsage(accessvdb_field_query_points(c_, p_W, 1, &answer, 8), "c_api.struct_size");
  expectUsage(accessvdb_field_query_points(c_, p_W, static_cast<std::size_t>(-1), &answer, sizeof answer),
              "c_api.count");
  expectUsage(
      accessvdb_field_query_capsules(c_, nullptr, sizeof(accessvdb_capsule), 1, &capsule_answer, sizeof capsule_answer),
      "c_api.null");
  expectUsage(accessvdb_field_query_capsules(c_, capsules_.data(), 4, 1, &capsule_answer, sizeof capsule_answer),
              "c_api.struct_size");
  expectUsage(accessvdb_field_query_capsules(c_, capsules_.data(), sizeof(accessvdb_capsule), 1, &capsule_answer, 0),
              "c_api.struct_size");
  EXPECT_EQ(accessvdb_field_query_points(nullptr, p_W, 1, &answer, sizeof answer), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(accessvdb_field_query_points(c_, nullptr, 0, nullptr, sizeof answer), ACCESSVDB_OK);  // nothing to query
}

}  // namespace

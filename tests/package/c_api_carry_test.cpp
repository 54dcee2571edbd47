// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What returns carry, in C: as in C++, and bad calls are refused.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/c_api.h"

namespace accessvdb {
namespace {

/// A wall 2 m away, of two trees side by side.
struct Wall {
  std::vector<float> points_S;
  std::vector<std::int32_t> rows;  ///< a tree and a class of each
  Wall() {
    for (int n = 0; n < 1600; ++n) {
      const float y = 0.05f * static_cast<float>(n % 40 - 20) + 0.01f, z = 0.05f * static_cast<float>(n / 40 - 20);
      points_S.insert(points_S.end(), {2, y, z});
      rows.insert(rows.end(), {y < 0 ? 7 : 8, n % 9 == 4 ? kNoAttribute : 5});
    }
  }
};

TEST(CApiCarry, IsAsInCpp) {
  const Wall wall;
  accessvdb_tool* tool = nullptr;
  accessvdb_field* field = nullptr;
  ASSERT_EQ(accessvdb_tool_builtin("builtin:pencil", &tool, nullptr), ACCESSVDB_OK);
  accessvdb_params params = {};
  params.struct_size = sizeof params;
  ASSERT_EQ(accessvdb_params_defaults(&params), ACCESSVDB_OK);
  params.voxel_size_m = 0.1;
  params.backend = ACCESSVDB_BACKEND_CPU;
  params.carry = "tree_id class";
  ASSERT_EQ(accessvdb_field_create(tool, &params, &field, nullptr), ACCESSVDB_OK);
  const double T_W_S[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  const double sensor_W[3] = {0, 0, 0};
  const std::vector<double> points_W(wall.points_S.begin(), wall.points_S.end());
  ASSERT_EQ(accessvdb_field_integrate_scan_carrying(field, wall.points_S.data(), 1600, T_W_S, NAN, wall.rows.data(),
                                                    wall.rows.size(), nullptr),
            ACCESSVDB_OK);
  ASSERT_EQ(accessvdb_field_integrate_rays_carrying(field, points_W.data(), 1600, sensor_W, 1, NAN, wall.rows.data(),
                                                    wall.rows.size(), nullptr),
            ACCESSVDB_OK);
  EXPECT_EQ(accessvdb_field_integrate_scan_carrying(field, wall.points_S.data(), 1600, T_W_S, NAN, wall.rows.data(), 5,
                                                    nullptr),
            ACCESSVDB_ERROR_USAGE);
  EXPECT_STREQ(accessvdb_field_error_id(field), "carry.sizes");

  FieldParams in_cpp;
  in_cpp.tsdf.voxel_size_m = 0.1;
  in_cpp.backend = BackendKind::Cpu;
  in_cpp.carry = {{"tree_id", Keep::Majority}, {"class", Keep::Majority}};
  AccessibilityField same(ToolGeometry::builtin("builtin:pencil"), in_cpp);
  std::vector<Eigen::Vector3f> p;
  for (std::size_t n = 0; n < 1600; ++n) p.emplace_back(wall.points_S.data() + 3 * n);
  std::vector<Eigen::Vector3d> p_W;
  for (const Eigen::Vector3f& each : p) p_W.push_back(each.cast<double>());
  same.integrateScan(p, Eigen::Isometry3d::Identity(), NAN, wall.rows);
  same.integrateRays(p_W, std::vector<Eigen::Vector3d>{{0, 0, 0}}, NAN, wall.rows);
  const FieldSnapshot snapshot = same.snapshot();
  std::size_t count = 0;
  ASSERT_EQ(accessvdb_field_take_snapshot(field, &count), ACCESSVDB_OK);
  ASSERT_EQ(count, snapshot.points.size());
  ASSERT_EQ(snapshot.attributes.size(), 2u);
  for (std::size_t c = 0; c < 2; ++c) {
    std::vector<std::int32_t> values(count);
    ASSERT_EQ(accessvdb_field_copy_attribute(field, c, 0, count, values.data()), ACCESSVDB_OK);
    EXPECT_EQ(values, snapshot.attributes[c].values);
  }
  for (std::size_t n = 0; n < count; ++n) {
    EXPECT_EQ(snapshot.attributes[0].values[n], snapshot.points[n].position_W.y() < 0 ? 7 : 8);
    EXPECT_EQ(snapshot.attributes[1].values[n], 5);  // most of the returns in each voxel have it
    EXPECT_EQ(same.attributesAt(snapshot.points[n].position_W)[0], snapshot.attributes[0].values[n]);
  }
  EXPECT_TRUE(same.attributesAt({50, 0, 0}).empty());
  std::int32_t one = 0;
  EXPECT_EQ(accessvdb_field_copy_attribute(field, 2, 0, 1, &one), ACCESSVDB_ERROR_USAGE);
  EXPECT_STREQ(accessvdb_field_error_id(field), "carry.column");
  EXPECT_EQ(accessvdb_field_copy_attribute(field, 0, count, 1, &one), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(accessvdb_field_copy_attribute(field, 0, 0, 1, nullptr), ACCESSVDB_ERROR_USAGE);
  accessvdb_field_free(field);
  params.carry = "x";
  accessvdb_error error = {};
  error.struct_size = sizeof error;
  EXPECT_EQ(accessvdb_field_create(tool, &params, &field, &error), ACCESSVDB_ERROR_USAGE);
  EXPECT_STREQ(error.id, "carry.name");
  accessvdb_tool_free(tool);
}

}  // namespace
}  // namespace accessvdb

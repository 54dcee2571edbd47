// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The same short walk in a field of the C interface and in one of C++.
#pragma once

#include <gtest/gtest.h>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/c_api.h"
#include "sample_scans/walk_generator.h"

namespace accessvdb::test {

class WalkedFields : public testing::Test {
 protected:
  void SetUp() override {
    accessvdb_tool* tool = nullptr;
    ASSERT_EQ(accessvdb_tool_builtin("builtin:pencil", &tool, nullptr), ACCESSVDB_OK);
    accessvdb_params params = {};
    params.struct_size = sizeof params;
    ASSERT_EQ(accessvdb_params_defaults(&params), ACCESSVDB_OK);
    params.voxel_size_m = 0.1;
    ASSERT_EQ(accessvdb_field_create(tool, &params, &c_, nullptr), ACCESSVDB_OK);
    accessvdb_tool_free(tool);
    const samples::WalkGenerator walk({.frames = 3, .rays_per_frame = 5000, .max_range_m = 8});
    for (int n = 0; n < walk.frames(); ++n) {
      const auto frame = walk.frame(n);
      const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> pose = frame.T_W_S.matrix();
      cpp_.integrateScan(frame.points_S, frame.T_W_S);
      ASSERT_EQ(
          accessvdb_field_integrate_scan(c_, frame.points_S[0].data(), frame.points_S.size(), pose.data(), nullptr),
          ACCESSVDB_OK);
    }
    cpp_.update();
    ASSERT_EQ(accessvdb_field_update(c_, nullptr), ACCESSVDB_OK);
  }
  void TearDown() override { accessvdb_field_free(c_); }

  void expectUsage(int code, const char* id) const {
    EXPECT_EQ(code, ACCESSVDB_ERROR_USAGE);
    EXPECT_STREQ(accessvdb_field_error_id(c_), id);
  }

  accessvdb_field* c_ = nullptr;
  AccessibilityField cpp_{ToolGeometry::builtin("builtin:pencil"), {.tsdf = {.voxel_size_m = 0.1}}};
};

}  // namespace accessvdb::test

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Tools of the C interface are those of C++: from triangles, from meshes, several in a field.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/c_api.h"
#include "accessvdb/tool_spec.h"
#include "accessvdb/tool_tables.h"
#include "sample_scans/walk_generator.h"

namespace {

using accessvdb::AccessibilityField;
using accessvdb::FieldParams;
using accessvdb::FieldSnapshot;
using accessvdb::OrientationSet;
using accessvdb::ToolGeometry;
using accessvdb::samples::WalkFrame;
using accessvdb::samples::WalkGenerator;

TEST(CApiParity, ToolOfTriangles) {
  const ToolGeometry cpp = ToolGeometry::builtin("builtin:pruner");
  accessvdb_tool *from_triangles = nullptr, *builtin = nullptr;
  ASSERT_EQ(
      accessvdb_tool_from_triangles(cpp.vertices_T()[0].data(), cpp.vertices_T().size(), cpp.triangles()[0].data(),
                                    cpp.triangles().size(), "mine", &from_triangles, nullptr),
      ACCESSVDB_OK);
  ASSERT_EQ(accessvdb_tool_builtin("builtin:pruner", &builtin, nullptr), ACCESSVDB_OK);
  EXPECT_STREQ(accessvdb_tool_name(from_triangles), "mine");
  EXPECT_STREQ(accessvdb_tool_name(builtin), cpp.name().c_str());
  EXPECT_EQ(std::string(accessvdb_tool_sha256(builtin)), cpp.sha256());
  EXPECT_EQ(accessvdb_tool_sha256(from_triangles),
            ToolGeometry::fromTriangles(cpp.vertices_T(), cpp.triangles(), "mine").sha256());
  accessvdb_tool_info info = {};
  info.struct_size = sizeof info;
  ASSERT_EQ(accessvdb_tool_get_info(from_triangles, &info), ACCESSVDB_OK);
  EXPECT_EQ(info.vertex_count, cpp.vertices_T().size());
  EXPECT_EQ(info.triangle_count, cpp.triangles().size());
  EXPECT_EQ(info.reach_m, cpp.reach_m());
  EXPECT_EQ(info.watertight != 0, cpp.watertight());
  EXPECT_EQ(accessvdb_tool_opening_m(from_triangles), 0);
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_EQ(info.min_T[axis], cpp.min_T()[axis]);
    EXPECT_EQ(info.max_T[axis], cpp.max_T()[axis]);
  }
  accessvdb_tool_free(from_triangles);
  accessvdb_tool_free(builtin);
}

TEST(CApiParity, WhatIsWrongWithATool) {
  const ToolGeometry pruner = ToolGeometry::builtin("builtin:pruner");
  accessvdb_tool* open = nullptr;
  ASSERT_EQ(accessvdb_tool_from_triangles(pruner.vertices_T()[0].data(), pruner.vertices_T().size(),
                                          pruner.triangles()[0].data(), pruner.triangles().size() - 1, "open", &open,
                                          nullptr),
            ACCESSVDB_OK);
  EXPECT_GT(accessvdb_tool_opening_m(open), 0.1);
  EXPECT_TRUE(std::isnan(accessvdb_tool_opening_m(nullptr)));
  accessvdb_params params = {};
  params.struct_size = sizeof params;
  ASSERT_EQ(accessvdb_params_defaults(&params), ACCESSVDB_OK);
  params.voxel_size_m = 0.05;
  accessvdb_field* field = nullptr;
  ASSERT_EQ(accessvdb_field_create(open, &params, &field, nullptr), ACCESSVDB_OK);
  double share = -1;
  ASSERT_EQ(accessvdb_field_tool_share_hidden(field, &share), ACCESSVDB_OK);
  const ToolGeometry cpp = ToolGeometry::fromTriangles(
      pruner.vertices_T(), {pruner.triangles().begin(), pruner.triangles().end() - 1}, "open");
  FieldParams cpp_params;
  cpp_params.tsdf.voxel_size_m = 0.05;
  EXPECT_EQ(share, AccessibilityField(cpp, cpp_params).toolShareHidden());
  EXPECT_EQ(share, accessvdb::toolShareHidden(cpp, cpp_params));
  EXPECT_GT(share, 0);
  EXPECT_EQ(accessvdb_field_tool_share_hidden(field, nullptr), ACCESSVDB_ERROR_USAGE);
  accessvdb_field_free(field);
  accessvdb_tool_free(open);
}

/// A box of 40 x 20 x 10 units, so that units, tip and axes can be distinguished.
std::filesystem::path boxFile() {
  const std::filesystem::path path = std::filesystem::path(testing::TempDir()) / "c_api_box.obj";
  std::ofstream out(path);
  for (int corner = 0; corner < 8; ++corner) {
    out << "v " << 40 * (corner & 1) << ' ' << 20 * (corner >> 1 & 1) << ' ' << 10 * (corner >> 2 & 1) << '\n';
  }
  for (const char* face : {"1 3 4 2", "5 6 8 7", "1 2 6 5", "3 7 8 4", "1 5 7 3", "2 4 8 6"})
    out << "f " << face << '\n';
  return path;
}

TEST(CApiParity, ToolOfMesh) {
  const std::filesystem::path path = boxFile();
  accessvdb_tool_pose pose = {};
  pose.struct_size = sizeof pose;
  pose.has_tip = 1;
  const double tip[3] = {40, 10, 5}, axis[3] = {-1, 0, 0}, up[3] = {0, 1, 0};
  std::copy(tip, tip + 3, pose.tip);
  std::copy(axis, axis + 3, pose.axis);
  std::copy(up, up + 3, pose.up);
  using accessvdb::LengthUnit;
  const std::pair<std::int32_t, LengthUnit> units[] = {{ACCESSVDB_CENTIMETRE, LengthUnit::Centimetre},
                                                       {ACCESSVDB_MILLIMETRE, LengthUnit::Millimetre},
                                                       {ACCESSVDB_INCH, LengthUnit::Inch}};
  for (const auto& [c_unit, unit] : units) {
    for (const bool posed : {false, true}) {
      accessvdb::ToolPose cpp_pose;
      if (posed) cpp_pose = {Eigen::Vector3d(tip), Eigen::Vector3d(axis), Eigen::Vector3d(up)};
      const ToolGeometry cpp = ToolGeometry::fromMesh(path, unit, cpp_pose);
      accessvdb_error error = {};
      error.struct_size = sizeof error;
      accessvdb_tool* c = nullptr;
      ASSERT_EQ(accessvdb_tool_from_mesh(path.c_str(), c_unit, posed ? &pose : nullptr, &c, &error), ACCESSVDB_OK)
          << error.text;
      EXPECT_EQ(accessvdb_tool_sha256(c), cpp.sha256());
      accessvdb_tool_free(c);
    }
  }
}

/// A field of several tools, the same as in C++; saved, and refused with another list.
TEST(CApiParity, SeveralTools) {
  accessvdb_error error = {};
  error.struct_size = sizeof error;
  std::array<accessvdb_tool*, 2> tools = {};
  ASSERT_EQ(accessvdb_tool_builtin("builtin:pruner", tools.data(), &error), ACCESSVDB_OK);
  ASSERT_EQ(accessvdb_tool_builtin("builtin:pencil", &tools[1], &error), ACCESSVDB_OK);
  std::array<accessvdb_tool_spec, 3> specs = {};
  specs[0] = {tools[0], "arm", nullptr, 0, -1, 0};
  specs[1] = {tools[0], nullptr, nullptr, 0, -1, 0.16};
  specs[2] = {tools[1], nullptr, "sphere:30", 0, 0, 0};
  accessvdb_params params = {};
  params.struct_size = sizeof params;
  ASSERT_EQ(accessvdb_params_defaults(&params), ACCESSVDB_OK);
  params.voxel_size_m = 0.08;
  params.backend = ACCESSVDB_BACKEND_CPU;
  accessvdb_field* field = nullptr;
  ASSERT_EQ(accessvdb_field_create_tools(specs.data(), sizeof specs[0], 3, &params, &field, &error), ACCESSVDB_OK)
      << error.text;
  FieldParams given;
  given.tsdf.voxel_size_m = 0.08;
  given.backend = accessvdb::BackendKind::Cpu;
  AccessibilityField expected({{ToolGeometry::builtin("builtin:pruner"), OrientationSet::yaw(), 0, "arm", -1},
                               {ToolGeometry::builtin("builtin:pruner").grownBy(0.16), {}, 0, {}, -1},
                               {ToolGeometry::builtin("builtin:pencil"), OrientationSet::sphere(30), 0, {}, 0}},
                              given);
  accessvdb::samples::WalkOptions options;
  options.rays_per_frame = 1500;
  const WalkGenerator walk(options);
  for (int n = 0; n < 3; ++n) {
    const WalkFrame frame = walk.frame(n);
    expected.integrateScan(frame.points_S, frame.T_W_S);
    const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> pose = frame.T_W_S.matrix();
    ASSERT_EQ(
        accessvdb_field_integrate_scan(field, frame.points_S[0].data(), frame.points_S.size(), pose.data(), nullptr),
        ACCESSVDB_OK);
  }
  expected.update();
  ASSERT_EQ(accessvdb_field_update(field, nullptr), ACCESSVDB_OK);
  EXPECT_EQ(accessvdb_field_tool_count(field), 3u);
  EXPECT_STREQ(accessvdb_field_tool_name(field, 0), "arm");
  EXPECT_STREQ(accessvdb_field_tool_name(field, 1), "pruner_160mm");
  EXPECT_STREQ(accessvdb_field_tool_name(field, 2), "pencil");
  EXPECT_STREQ(accessvdb_field_tool_name(field, 3), "");
  const auto expectEqual = [&](const FieldSnapshot& snapshot) {
    std::vector<accessvdb_point> points(snapshot.points.size());
    ASSERT_EQ(accessvdb_field_copy_points(field, 0, points.size(), points.data(), sizeof points[0]), ACCESSVDB_OK);
    std::size_t others = 0;
    for (std::size_t n = 0; n < points.size(); ++n) {
      ASSERT_EQ(points[n].tool, snapshot.points[n].tool);
      ASSERT_EQ(points[n].tools, snapshot.points[n].tools);
      ASSERT_EQ(points[n].margin_m, snapshot.points[n].margin_m);
      ASSERT_EQ(points[n].access_probability, snapshot.points[n].access_probability);
      ASSERT_EQ(points[n].score, snapshot.points[n].score);
      others += points[n].tool;
    }
    if (snapshot.points.front().tools != 0) {
      EXPECT_GT(others, 0u);
    }
  };
  std::size_t count = 0;
  ASSERT_EQ(accessvdb_field_take_snapshot(field, &count), ACCESSVDB_OK);
  ASSERT_EQ(count, expected.snapshot().points.size());
  expectEqual(expected.snapshot());
  ASSERT_EQ(accessvdb_field_take_tool_snapshot(field, 2, &count), ACCESSVDB_OK);
  expectEqual(expected.toolSnapshot(2));
  EXPECT_NE(accessvdb_field_take_tool_snapshot(field, 3, &count), ACCESSVDB_OK);
  EXPECT_STREQ(accessvdb_field_error_id(field), "tool.index");

  const std::string file = testing::TempDir() + "several_tools.state";
  ASSERT_EQ(accessvdb_field_save_state(field, file.c_str()), ACCESSVDB_OK);
  accessvdb_field* again = nullptr;
  EXPECT_EQ(accessvdb_field_load_state_tools(file.c_str(), specs.data(), sizeof specs[0], 3, ACCESSVDB_BACKEND_CPU, 0,
                                             &again, &error),
            ACCESSVDB_OK);
  accessvdb_field_free(again);
  specs[0].max_collisions = 3;
  EXPECT_EQ(accessvdb_field_load_state_tools(file.c_str(), specs.data(), sizeof specs[0], 3, ACCESSVDB_BACKEND_CPU, 0,
                                             &again, &error),
            ACCESSVDB_ERROR_UNUSABLE);
  EXPECT_STREQ(error.id, "state.tool");
  std::filesystem::remove(file);
  specs[1].tool = nullptr;
  EXPECT_EQ(accessvdb_field_create_tools(specs.data(), sizeof specs[0], 3, &params, &again, &error),
            ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(accessvdb_field_create_tools(specs.data(), sizeof specs[0], 0, &params, &again, &error),
            ACCESSVDB_ERROR_USAGE);
  EXPECT_STREQ(error.id, "tool.count");
  EXPECT_EQ(accessvdb_field_create_tools(specs.data(), 8, 2, &params, &again, &error), ACCESSVDB_ERROR_USAGE);
  accessvdb_field_free(field);
  for (accessvdb_tool* tool : tools) accessvdb_tool_free(tool);
}

}  // namespace

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Structs of the C interface, and its points beside those of C++, field by field.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/c_api.h"

namespace accessvdb::test {

template <typename Struct>
Struct sized(std::size_t bytes = sizeof(Struct)) {
  Struct out = {};
  out.struct_size = static_cast<std::uint32_t>(bytes);
  return out;
}

inline accessvdb_params defaults() {
  auto params = sized<accessvdb_params>();
  EXPECT_EQ(accessvdb_params_defaults(&params), ACCESSVDB_OK);
  return params;
}

inline std::array<double, 16> rowMajor(const Eigen::Isometry3d& pose) {
  std::array<double, 16> out;
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column) out[std::size_t(4 * row + column)] = pose.matrix()(row, column);
  }
  return out;
}

inline void expectSame(const accessvdb_point& c, const SurfacePoint& p) {
  ASSERT_EQ(c.id, p.id);
  for (int axis = 0; axis < 3; ++axis) {
    ASSERT_EQ(c.position_W[axis], p.position_W[axis]) << "point " << p.id;
    ASSERT_EQ(c.normal_W[axis], p.normal_W[axis]) << "point " << p.id;
    ASSERT_EQ(c.direction_W[axis], p.direction_W[axis]) << "point " << p.id;
  }
  ASSERT_EQ(c.yaw_rad, p.yaw_rad) << "point " << p.id;
  const Eigen::Quaternionf& q = p.orientation_WT;
  ASSERT_EQ(Eigen::Vector4f(c.orientation_WT), Eigen::Vector4f(q.w(), q.x(), q.y(), q.z())) << "point " << p.id;
  ASSERT_EQ(c.weight, p.weight) << "point " << p.id;
  ASSERT_EQ(c.confidence, p.confidence) << "point " << p.id;
  ASSERT_EQ(c.stability, p.stability) << "point " << p.id;
  ASSERT_EQ(c.access_probability, p.access_probability) << "point " << p.id;
  ASSERT_EQ(c.direction, p.direction) << "point " << p.id;
  ASSERT_EQ(c.roll, p.roll) << "point " << p.id;
  ASSERT_EQ(c.tool, p.tool) << "point " << p.id;
  ASSERT_EQ(c.tools, p.tools) << "point " << p.id;
  ASSERT_EQ(c.score, p.score) << "point " << p.id;
  ASSERT_EQ(c.label, static_cast<std::uint8_t>(p.label)) << "point " << p.id;
  ASSERT_EQ(c.reason, static_cast<std::uint8_t>(p.reason)) << "point " << p.id;
  ASSERT_EQ(c.confident, std::uint8_t{p.confident}) << "point " << p.id;
}

inline void expectSame(const std::vector<accessvdb_point>& c, const FieldSnapshot& cpp) {
  ASSERT_EQ(c.size(), cpp.points.size());
  ASSERT_GT(cpp.count(PointLabel::Accessible), 50u);  // otherwise the comparison means little
  ASSERT_GT(cpp.count(PointLabel::Blocked), 50u);
  for (std::size_t n = 0; n < c.size(); ++n) ASSERT_NO_FATAL_FAILURE(expectSame(c[n], cpp.points[n]));
}

}  // namespace accessvdb::test

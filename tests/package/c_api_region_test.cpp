// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Parts of a map taken out by hand, in C: the same as in C++, and bad calls are refused.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/c_api.h"
#include "accessvdb/what_if.h"
#include "package/walked_fields.h"

namespace {

using accessvdb::Region;
using accessvdb::RemovedAs;

class CApiRegion : public accessvdb::test::WalkedFields {
 protected:
  void SetUp() override {
    WalkedFields::SetUp();
    if (HasFatalFailure()) return;
    const accessvdb::FieldSnapshot snapshot = cpp_.snapshot();
    for (const auto& point : snapshot.points) {
      if (point.reason == accessvdb::PointReason::Arm || point.reason == accessvdb::PointReason::Tool) {
        centre_W_ = point.position_W + Eigen::Vector3d(0.3, 0, 0.1);
      }
      if ((point.position_W - centre_W_).norm() < 0.8) ids_.push_back(point.id);
    }
    ASSERT_FALSE(ids_.empty());
  }
  [[nodiscard]] accessvdb_region box(double half_m) const {
    accessvdb_region region = {};
    region.kind = ACCESSVDB_REGION_BOX;
    for (int axis = 0; axis < 3; ++axis) {
      region.min_W[axis] = centre_W_[axis] - half_m;
      region.max_W[axis] = centre_W_[axis] + half_m;
    }
    return region;
  }

  Eigen::Vector3d centre_W_ = {0, 0, 0};
  std::vector<std::uint32_t> ids_;
};

TEST_F(CApiRegion, SaysWhatCppSays) {
  const Eigen::Vector3d half = Eigen::Vector3d::Constant(0.5);
  // A tetrahedron, its faces anticlockwise from outside.
  const std::vector<Eigen::Vector3d> vertices = {centre_W_, centre_W_ + Eigen::Vector3d(1, 0, 0),
                                                 centre_W_ + Eigen::Vector3d(0, 1, 0),
                                                 centre_W_ + Eigen::Vector3d(0, 0, 1)};
  const std::vector<std::array<std::uint32_t, 3>> faces = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  accessvdb_region all[3] = {box(0.5), {}, {}};
  all[1].kind = ACCESSVDB_REGION_MESH;
  all[1].vertices_W = vertices[0].data();
  all[1].vertex_count = vertices.size();
  all[1].triangles = faces[0].data();
  all[1].triangle_count = faces.size();
  all[2].kind = ACCESSVDB_REGION_POINTS;
  all[2].ids = ids_.data();
  all[2].id_count = ids_.size();
  const std::vector<Region> regions = {Region::box(centre_W_ - half, centre_W_ + half), Region::mesh(vertices, faces),
                                       Region::points(ids_)};
  const accessvdb::WhatIf expected = cpp_.whatIf(regions);
  accessvdb_what_if found = {};
  found.struct_size = sizeof found;
  ASSERT_EQ(accessvdb_field_what_if(c_, all, sizeof all[0], 3, &found), ACCESSVDB_OK) << accessvdb_field_error_text(c_);
  EXPECT_EQ(found.opens, expected.opens.size());
  EXPECT_EQ(found.voxels, expected.voxels);
  EXPECT_EQ(found.colliding_voxels, expected.colliding_voxels);
  EXPECT_EQ(found.points_gone, expected.points_gone);
  EXPECT_EQ(found.points_tried, expected.points_tried);
  EXPECT_EQ(found.direction_tests, expected.direction_tests);
  EXPECT_GT(found.points_gone, 0u);
  std::vector<accessvdb_point> points(expected.opens.size());
  ASSERT_EQ(accessvdb_field_copy_opened(c_, 0, points.size(), points.data(), sizeof(accessvdb_point)), ACCESSVDB_OK);
  for (std::size_t n = 0; n < points.size(); ++n) {
    EXPECT_EQ(points[n].id, expected.opens[n].id);
    EXPECT_EQ(points[n].label, ACCESSVDB_ACCESSIBLE);
    EXPECT_EQ(points[n].direction, expected.opens[n].direction);
  }
  expectUsage(accessvdb_field_copy_opened(c_, points.size(), 1, points.data(), sizeof(accessvdb_point)),
              points.empty() ? "c_api.null" : "snapshot.range");

  for (int n = 0; n < 3; ++n) {
    const accessvdb::Removal removal = cpp_.removeRegion(regions[static_cast<std::size_t>(n)], RemovedAs::Free);
    accessvdb_removal c = {};
    c.struct_size = sizeof c;
    const int code = accessvdb_field_remove_region(c_, &all[n], sizeof all[n], ACCESSVDB_REMOVED_AS_FREE, &c);
    ASSERT_EQ(code, ACCESSVDB_OK) << accessvdb_field_error_text(c_);
    EXPECT_EQ(c.removed_as, ACCESSVDB_REMOVED_AS_FREE);
    EXPECT_EQ(c.voxels, removal.voxels);
    EXPECT_EQ(c.colliding_voxels, removal.colliding_voxels);
    EXPECT_EQ(c.points, removal.points);
    EXPECT_EQ(c.flipped_voxels, removal.flipped_voxels);
    if (n < 2) continue;
    // What is gone is gone: the map has observed nothing of it any more.
    EXPECT_EQ(accessvdb_field_remove_region(c_, &all[0], sizeof all[0], ACCESSVDB_REMOVED_AS_FREE, nullptr),
              ACCESSVDB_ERROR_UNUSABLE);
    EXPECT_STREQ(accessvdb_field_error_id(c_), "region.outside");
  }
  expectUsage(accessvdb_field_what_if(c_, all, sizeof all[0], 1, nullptr), "region.stale");
}

TEST_F(CApiRegion, RefusesBadCalls) {
  accessvdb_region region = box(0.5);
  const auto remove = [&](std::size_t size, std::int32_t as) {
    return accessvdb_field_remove_region(c_, &region, size, as, nullptr);
  };
  expectUsage(remove(sizeof region - 1, 0), "c_api.struct_size");
  expectUsage(remove(sizeof region, 2), "c_api.value");
  expectUsage(remove(sizeof region, -1), "c_api.value");
  region.kind = 3;
  expectUsage(remove(sizeof region, 0), "c_api.value");
  region = box(-0.5);
  expectUsage(remove(sizeof region, 0), "region.box");
  region = box(std::nan(""));
  expectUsage(remove(sizeof region, 0), "region.box");
  region = {};
  region.kind = ACCESSVDB_REGION_POINTS;
  expectUsage(remove(sizeof region, 0), "region.empty");
  region.id_count = 3;
  expectUsage(remove(sizeof region, 0), "c_api.null");
  region = {};
  region.kind = ACCESSVDB_REGION_MESH;
  EXPECT_EQ(remove(sizeof region, 0), ACCESSVDB_ERROR_UNUSABLE);
  EXPECT_STREQ(accessvdb_field_error_id(c_), "region.mesh");
  expectUsage(accessvdb_field_remove_region(c_, nullptr, sizeof region, 0, nullptr), "c_api.null");
  accessvdb_what_if small = {};
  small.struct_size = 8;
  region = box(0.5);
  expectUsage(accessvdb_field_what_if(c_, &region, sizeof region, 1, &small), "c_api.struct_size");
  EXPECT_EQ(accessvdb_field_what_if(nullptr, &region, sizeof region, 1, nullptr), ACCESSVDB_ERROR_USAGE);
}

}  // namespace

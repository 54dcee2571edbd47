// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb/pcl.h against PCL's own results for the same clouds.
#include "accessvdb/pcl.h"

#include <gtest/gtest.h>
#include <pcl/common/transforms.h>

#include <cmath>
#include <limits>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"

namespace {

/// Only coordinates, which pcl.h reads without a copy.
struct Bare {
  float x, y, z;
};

pcl::PointCloud<pcl::PointXYZ> wall() {
  pcl::PointCloud<pcl::PointXYZ> cloud;
  for (int y = -20; y <= 20; ++y)
    for (int z = -10; z <= 10; ++z)
      cloud.push_back({2.0F, 0.05F * static_cast<float>(y), 0.05F * static_cast<float>(z)});
  return cloud;
}

TEST(PclHeader, KeepsEveryPointInOrder) {
  const auto cloud = wall();
  const accessvdb::PclScan scan(cloud);
  ASSERT_EQ(scan.points_S().size(), cloud.size());
  EXPECT_TRUE(scan.copied());
  for (std::size_t i = 0; i < cloud.size(); ++i) EXPECT_EQ(scan.points_S()[i], cloud[i].getVector3fMap());
}

TEST(PclHeader, ReadsBareCoordinatesWhereTheyLie) {
  pcl::PointCloud<Bare> cloud;
  cloud.points = {{1, 2, 3}, {4, 5, 6}};
  const accessvdb::PclScan scan(cloud);
  EXPECT_FALSE(scan.copied());
  ASSERT_EQ(scan.points_S().size(), 2U);
  EXPECT_EQ(static_cast<const void*>(scan.points_S().data()), static_cast<const void*>(cloud.points.data()));
  EXPECT_EQ(scan.points_S()[1], Eigen::Vector3f(4, 5, 6));
}

TEST(PclHeader, EmptyCloudsAreEmptyScans) {
  EXPECT_TRUE(accessvdb::PclScan(pcl::PointCloud<pcl::PointXYZ>()).points_S().empty());
}

TEST(PclHeader, PosesMovePointsAsPclDoes) {
  auto cloud = wall();
  cloud.sensor_origin_ = Eigen::Vector4f(1, -2, 0.5F, 1);
  cloud.sensor_orientation_ = Eigen::Quaternionf(0.6F, 0.1F, -0.2F, 0.7F).normalized();
  const Eigen::Isometry3d T_W_S = accessvdb::poseFromPcl(cloud);
  Eigen::Matrix4f matrix = Eigen::Matrix4f::Identity();
  matrix.topLeftCorner<3, 3>() = cloud.sensor_orientation_.toRotationMatrix();
  matrix.topRightCorner<3, 1>() = cloud.sensor_origin_.head<3>();
  pcl::PointCloud<pcl::PointXYZ> moved;
  pcl::transformPointCloud(cloud, moved, matrix);
  const Eigen::Isometry3d of_matrix = accessvdb::poseFromPcl(matrix);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3d p_S = cloud[i].getVector3fMap().cast<double>();
    // PCL computes in float32: about 1e-7 of coordinates below 4 m.
    EXPECT_LT((T_W_S * p_S - moved[i].getVector3fMap().cast<double>()).norm(), 3e-6);
    EXPECT_LT((of_matrix * p_S - moved[i].getVector3fMap().cast<double>()).norm(), 3e-6);
  }
}

TEST(PclHeader, AMatrixThatIsNoPoseIsRefused) {
  accessvdb::AccessibilityField field(accessvdb::ToolGeometry::builtin("builtin:pencil"), {});
  const auto cloud = wall();
  const accessvdb::PclScan scan(cloud);
  Eigen::Matrix4f scaled = Eigen::Matrix4f::Identity();
  scaled.topLeftCorner<3, 3>() *= 1.5F;
  EXPECT_THROW(field.integrateScan(scan.points_S(), accessvdb::poseFromPcl(scaled)), accessvdb::UnusableInput);
  Eigen::Matrix4f missing = Eigen::Matrix4f::Identity();
  missing(0, 3) = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(field.integrateScan(scan.points_S(), accessvdb::poseFromPcl(missing)), accessvdb::UnusableInput);
}

TEST(PclHeader, InvalidPointsAreCountedAndLabelsComeBack) {
  auto cloud = wall();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  cloud.push_back({nan, nan, nan});
  accessvdb::AccessibilityField field(accessvdb::ToolGeometry::builtin("builtin:pencil"),
                                      {.tsdf = {.voxel_size_m = 0.05}});
  const accessvdb::PclScan scan(cloud);
  accessvdb::FrameStats stats;
  for (int n = 0; n < 5; ++n) stats = field.integrateScan(scan.points_S(), accessvdb::poseFromPcl(cloud));
  field.update();
  EXPECT_EQ(stats.dropped[static_cast<int>(accessvdb::DropReason::NonFinite)], 1U);

  const accessvdb::FieldSnapshot snapshot = field.snapshot();
  const auto labelled = accessvdb::labelledCloud(snapshot);
  ASSERT_EQ(labelled.size(), snapshot.points.size());
  ASSERT_GT(snapshot.accessible().size(), 100U);
  std::size_t accessible = 0;
  for (std::size_t i = 0; i < labelled.size(); ++i) {
    const Eigen::Vector3d p_W = labelled[i].getVector3fMap().cast<double>() + snapshot.origin_W;
    EXPECT_LT((p_W - snapshot.points[i].position_W).norm(), 1e-6);  // float32 of coordinates below 4 m
    accessible += labelled[i].label == 1 && labelled[i].g > labelled[i].r ? 1 : 0;
  }
  EXPECT_EQ(accessible, snapshot.accessible().size());
}

}  // namespace

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Input of clouds and poses of the Point Cloud Library, output of labelled clouds. Header only, for programs that have
/// PCL: the library neither needs nor links it, and no other header includes this one. Link pcl_common yourself.
#pragma once

#include <pcl/point_cloud.h>
#include <pcl/point_types.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>
#include <vector>

#include "accessvdb/types.h"

namespace accessvdb {

/// The returns of a PCL cloud as AccessibilityField::integrateScan() takes them: [n] float32, sensor frame, metres.
/// Point types that hold only x, y, z (12 bytes) are read in place; PCL's own types are padded to 16 bytes or more, so
/// their coordinates are copied once. Points that PCL marks as invalid (NaN) stay in: the field counts and drops them.
class PclScan {
 public:
  /// @param cloud  must outlive this if its points are read in place (see copied())
  template <typename PointT>
  explicit PclScan(const pcl::PointCloud<PointT>& cloud) {
    if constexpr (sizeof(PointT) == sizeof(Eigen::Vector3f) && std::is_trivially_copyable_v<PointT>) {
      static_assert(offsetof(PointT, x) == 0 && offsetof(PointT, y) == 4 && offsetof(PointT, z) == 8);
      points_S_ = {reinterpret_cast<const Eigen::Vector3f*>(cloud.points.data()), cloud.points.size()};
    } else {
      copy_.reserve(cloud.points.size());
      for (const PointT& point : cloud.points) copy_.emplace_back(point.x, point.y, point.z);
      points_S_ = copy_;
    }
  }
  PclScan(const PclScan&) = delete;
  PclScan& operator=(const PclScan&) = delete;

  [[nodiscard]] std::span<const Eigen::Vector3f> points_S() const { return points_S_; }
  [[nodiscard]] bool copied() const { return !copy_.empty(); }

 private:
  std::vector<Eigen::Vector3f> copy_;
  std::span<const Eigen::Vector3f> points_S_;
};

/// The pose that a PCL cloud carries (VIEWPOINT in a PCD file: sensor_origin_, sensor_orientation_), sensor to world.
/// The rotation is normalised; PCL keeps it in float32. integrateScan() refuses one that is not finite.
template <typename PointT>
[[nodiscard]] Eigen::Isometry3d poseFromPcl(const pcl::PointCloud<PointT>& cloud) {
  Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
  T_W_S.linear() = cloud.sensor_orientation_.template cast<double>().normalized().toRotationMatrix();
  T_W_S.translation() = cloud.sensor_origin_.template head<3>().template cast<double>();
  return T_W_S;
}

/// A pose as PCL's registration returns it (Matrix4f, Affine3f::matrix(), or their double forms), sensor to world.
/// Float32 rotations are slightly off; the nearest rotation is taken. integrateScan() refuses a pose that is not rigid.
template <typename Scalar>
[[nodiscard]] Eigen::Isometry3d poseFromPcl(const Eigen::Matrix<Scalar, 4, 4>& T_W_S_pcl) {
  Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
  const Eigen::Matrix3d turn = T_W_S_pcl.template topLeftCorner<3, 3>().template cast<double>();
  const Eigen::Quaterniond nearest(turn);
  // Corrects only what rounding explains; anything else is passed on unchanged, and refused.
  const Eigen::Matrix3d rotation = nearest.normalized().toRotationMatrix();
  T_W_S.linear() = (rotation - turn).cwiseAbs().maxCoeff() < 1e-5 ? rotation : turn;
  T_W_S.translation() = T_W_S_pcl.template topRightCorner<3, 1>().template cast<double>();
  return T_W_S;
}

/// Surface points with their labels: x, y, z are p_W - origin_W (PCL's float32 cannot hold survey coordinates), label
/// is PointLabel (0 unscored, 1 accessible, 2 blocked), colours are those of points.ply. Same order as the snapshot.
/// @param origin_W  world position of the cloud's origin; the field's own origin by default
[[nodiscard]] inline pcl::PointCloud<pcl::PointXYZRGBL> labelledCloud(const FieldSnapshot& field,
                                                                      const Eigen::Vector3d& origin_W) {
  constexpr std::array<std::array<std::uint8_t, 3>, 3> kColours = {{{150, 152, 156}, {46, 160, 67}, {215, 58, 60}}};
  pcl::PointCloud<pcl::PointXYZRGBL> cloud;
  cloud.reserve(field.points.size());
  for (const SurfacePoint& point : field.points) {
    const Eigen::Vector3f p = (point.position_W - origin_W).cast<float>();
    const auto label = static_cast<std::uint32_t>(point.label);
    pcl::PointXYZRGBL labelled;
    labelled.getVector3fMap() = p;
    labelled.r = kColours[label][0];
    labelled.g = kColours[label][1];
    labelled.b = kColours[label][2];
    labelled.label = label;
    cloud.push_back(labelled);
  }
  return cloud;
}
[[nodiscard]] inline pcl::PointCloud<pcl::PointXYZRGBL> labelledCloud(const FieldSnapshot& field) {
  return labelledCloud(field, field.origin_W);
}

}  // namespace accessvdb

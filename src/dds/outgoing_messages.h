// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The messages that a live map publishes, as ROS 2 lays them out.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "accessvdb/surface_points.h"

namespace accessvdb::dds {

/// Bytes of one point in the clouds below.
inline constexpr std::size_t kPointBytes = 44;

/// Of several tools each point also says which of them reach it.
inline constexpr std::size_t kToolBytes = 4;

/// What all points of a message share.
struct OutgoingFrame {
  std::string name;                           ///< the one that the poses are in
  std::optional<Eigen::Matrix3d> R_L_W = {};  ///< LiveSession::levelling(): points are turned back by it
  bool several_tools = false;
};

/// sensor_msgs/PointCloud2 with x y z rgb id label reason score confidence dx dy dz access_probability, and tools if
/// there are several.
[[nodiscard]] std::string cloudMessage(const SurfacePoints& points, std::int64_t stamp_ns, const OutgoingFrame& frame);
[[nodiscard]] std::string cloudMessage(std::span<const SurfacePoint> points, std::int64_t stamp_ns,
                                       const OutgoingFrame& frame);

/// geometry_msgs/PoseArray
[[nodiscard]] std::string posesMessage(std::span<const Eigen::Isometry3d> T_WT, std::int64_t stamp_ns,
                                       const OutgoingFrame& frame);

/// std_msgs/String
[[nodiscard]] std::string textMessage(const std::string& text);

}  // namespace accessvdb::dds

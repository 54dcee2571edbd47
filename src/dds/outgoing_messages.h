// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The messages that a live map publishes, as ROS 2 lays them out.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "accessvdb/surface_points.h"

namespace accessvdb::dds {

/// Bytes of one point in the clouds below.
inline constexpr std::size_t kPointBytes = 40;

/// sensor_msgs/PointCloud2 with x y z rgb id label reason score confidence dx dy dz.
/// @param frame  the one that the poses are in
[[nodiscard]] std::string cloudMessage(const SurfacePoints& points, std::int64_t stamp_ns, const std::string& frame);
[[nodiscard]] std::string cloudMessage(std::span<const SurfacePoint> points, std::int64_t stamp_ns,
                                       const std::string& frame);

/// std_msgs/String
[[nodiscard]] std::string textMessage(const std::string& text);

}  // namespace accessvdb::dds

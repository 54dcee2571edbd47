// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Hidden Point Removal, the visibility baseline of the paper (Katz, Tal, Basri: Direct Visibility of Point Sets, 2007;
/// docs/PAPER_MAP.md, "Baselines"): flip the points across a sphere around the viewer; those on the convex hull are
/// visible.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

namespace accessvdb::eval {

/// Radius of the flipping sphere, times the distance of the farthest point (docs/PAPER_MAP.md, "Baselines"). A denser
/// cloud needs a larger one: a point is found if the flipped cloud is less curved there than the sphere.
inline constexpr double kFlipRadius = 100;

/// Which points one viewer sees: 1 or 0. Duplicates get the same result. A point at the viewpoint is seen and hides
/// nothing. If all points and the viewer are in one plane or on one line, the hull is that of the plane or line, so of
/// two points in one direction the nearer is seen. The same for any order of the points, up to ties in Qhull.
/// @param points_W  [n] metres
/// @throws InvalidArgument for a coordinate that is not finite; InternalError if Qhull fails
[[nodiscard]] std::vector<std::uint8_t> visibleFrom(std::span<const Eigen::Vector3d> points_W,
                                                    const Eigen::Vector3d& viewpoint_W,
                                                    double flip_radius = kFlipRadius);

/// Which points at least one of the viewers sees; none without viewers. In parallel over viewers.
[[nodiscard]] std::vector<std::uint8_t> visibleFromAny(std::span<const Eigen::Vector3d> points_W,
                                                       std::span<const Eigen::Vector3d> viewpoints_W,
                                                       double flip_radius = kFlipRadius);

}  // namespace accessvdb::eval

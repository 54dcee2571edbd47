// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The points of one file, and the readers that make them, one per format. Readers pass on bad values (NaN, 1e30,
/// (0,0,0)) unchanged: the integrator counts them.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace accessvdb::io {

struct PointCloud {
  std::vector<Eigen::Vector3d> points;       ///< frame and units of the file
  std::vector<Eigen::Vector3d> ray_vectors;  ///< [n] sensor minus point, only with ReadOptions::rays
  std::vector<double> stamps_s;              ///< [n] only with ReadOptions::rays, if the file has them
  std::uint64_t truncated_points = 0;        ///< records announced by the header but missing in the file
  std::uint64_t unbounded_rays = 0;          ///< skipped rays that hit nothing (ray clouds: alpha 0)
  std::vector<std::string> notices;
};

struct ReadOptions {
  bool allow_truncated = false;
  bool rays = false;  ///< PLY: nx ny nz are required, and lead back to the sensor
};

enum class ScanKind { Pcd, Ply, KittiBin, Las, Xyz };

/// All: @throws InputError naming the file.
[[nodiscard]] PointCloud readPcd(const std::filesystem::path& path, const ReadOptions& options);
[[nodiscard]] PointCloud readPly(const std::filesystem::path& path, const ReadOptions& options);
[[nodiscard]] PointCloud readKittiBin(const std::filesystem::path& path, const ReadOptions& options);
[[nodiscard]] PointCloud readLas(const std::filesystem::path& path, const ReadOptions& options);
[[nodiscard]] PointCloud readXyz(const std::filesystem::path& path, const ReadOptions& options);
[[nodiscard]] PointCloud readCloud(const std::filesystem::path& path, ScanKind kind, const ReadOptions& options);

/// tx ty tz qw qx qy qz of a PCD's VIEWPOINT line, unchecked; empty if the file has none.
[[nodiscard]] std::optional<std::array<double, 7>> readPcdViewpoint(const std::filesystem::path& path);

}  // namespace accessvdb::io

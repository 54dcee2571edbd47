// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Points, square metres and reasons of a field, as a whole and for each value of what its returns carried: one row per
/// tree or class.
/// Made for the program `accessvdb`: unlike the headers above this folder, it may change with every version.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/export.h"
#include "accessvdb/field_io.h"
#include "accessvdb/types.h"

namespace accessvdb::io {

class OutputCheck;

/// Square metres as a whole number, so that no sum depends on the order of its points: in 1e-12 where voxels are below
/// 10 mm, else in 1e-9. More than 1.8e7 or 1.8e10 square metres are not counted.
struct ACCESSVDB_API ExactArea {
  std::uint64_t steps = 0;
  /// @param voxel_size_m  of the field, which decides what a step is
  [[nodiscard]] double m2(double voxel_size_m) const;
  /// All decimals, "12.5".
  [[nodiscard]] std::string text(double voxel_size_m) const;
};

/// Of the surface that a point stands for (docs/report.md, "Area"). @param origin_W  of the map
/// @param cell_m  pointCell_m() of the map
[[nodiscard]] ACCESSVDB_API ExactArea areaOf(const SurfacePoint& point, const Eigen::Vector3d& origin_W,
                                             double voxel_size_m, double cell_m);
/// Edge of the cells of which a map has one scored point each, by its metadata; 0 where every point is scored.
[[nodiscard]] ACCESSVDB_API double pointCell_m(const FieldMetadata& metadata, double voxel_size_m);

/// What one of several tools reaches.
struct ReachedByTool {
  std::uint64_t points = 0;
  ExactArea area = {};
};

struct ACCESSVDB_API PointRow {
  std::string attribute = {};           ///< empty: the whole field
  std::optional<std::int32_t> id = {};  ///< nothing: the whole, or points without the attribute
  std::array<std::uint64_t, kNumPointLabels> points = {};
  std::array<ExactArea, kNumPointReasons> area = {};  ///< None is what is accessible
  ExactArea unscored = {};                            ///< those of the reasons of unscored points
  std::uint64_t score_sum = 0, scored = 0;            ///< over the points that have one
  Eigen::AlignedBox3d box_W = {};
  std::vector<ReachedByTool> tools = {};  ///< of several, in their order; with one tool empty

  [[nodiscard]] std::uint64_t allPoints() const;
  [[nodiscard]] ExactArea allArea() const;
};

/// The whole first, then each attribute's values in ascending order, and last its points without one.
struct PointTable {
  double voxel_size_m = 0;
  std::vector<std::string> tools = {};  ///< names of several; with one tool empty
  std::vector<PointRow> rows = {};
};

/// Of an output folder of `map`, whole or in tiles, one after the other: a row takes 400 bytes, and its line as much
/// again.
/// @throws InputError  @param check  begins with the files
[[nodiscard]] ACCESSVDB_API PointTable pointTable(const std::filesystem::path& folder, OutputCheck& check);

/// The table as CSV: a line of names, then one per row (docs/file_formats.md, "table.csv").
[[nodiscard]] ACCESSVDB_API std::string csvOf(const PointTable& table);
/// How each such file begins.
inline constexpr const char* kTableBegin = "attribute,id,points,area_m2,accessible_m2,accessible_share,";

}  // namespace accessvdb::io

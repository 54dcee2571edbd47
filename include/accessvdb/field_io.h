// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Writing a field to files and reading it back. Every file appears whole or not at all.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <iosfwd>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/export.h"
#include "accessvdb/survey_frame.h"
#include "accessvdb/types.h"

namespace accessvdb {
class SurfacePoints;
class TsdfVolume;
class ToolGeometry;
}  // namespace accessvdb

namespace accessvdb::io {

class OutputCheck;

/// Calls `body` with a checked stream on a temporary file next to `path`; then flush, fsync, rename, fsync of the
/// folder. Nothing is left behind when anything fails. @throws OutputError (disk full, permission, ...)
ACCESSVDB_API void writeFileDurably(const std::filesystem::path& path, const std::function<void(std::ostream&)>& body);

/// Makes the folder if needed and proves that a file can be created in it. @throws OutputError
ACCESSVDB_API void prepareOutputFolder(const std::filesystem::path& folder);

/// Name and text pairs that go into the metadata of the .vdb files, in order ("voxel_size_m", "0.01", ...).
using FieldMetadata = std::vector<std::pair<std::string, std::string>>;

/// field.vdb: density, accessible, blocked, confidence, score, best_direction, distance, weight, cleared
/// (docs/file_formats.md).
ACCESSVDB_API void writeFieldVdb(const std::filesystem::path& path, const TsdfVolume& volume,
                                 const FieldSnapshot& field, const FieldMetadata& metadata);
/// field_points.vdb: one PointDataGrid for Houdini.
ACCESSVDB_API void writePointsVdb(const std::filesystem::path& path, const FieldSnapshot& field,
                                  const FieldMetadata& metadata);
/// points.ply: binary little endian, positions in the world frame as doubles.
ACCESSVDB_API void writePointsPly(const std::filesystem::path& path, const FieldSnapshot& field,
                                  const FieldMetadata& metadata);
ACCESSVDB_API void writePointsPly(const std::filesystem::path& path, const SurfacePoints& points,
                                  const FieldMetadata& metadata);
/// points.las: LAS 1.4, point format 7, in steps of at most 0.0001 m from the field's origin; label, reason, score,
/// confidence, yaw (degrees) and what the returns carried as extra bytes, the label's colour as RGB, GPS time and class
/// of the first return. @param frame  its coordinate system, in whose unit the coordinates are  @throws OutputError
ACCESSVDB_API void writePointsLas(const std::filesystem::path& path, const SurfacePoints& points,
                                  const SurveyFrame& frame = {});
/// Reads points.ply back, with origin and voxel size from its header comments. @throws InputError
[[nodiscard]] ACCESSVDB_API FieldSnapshot readPointsPly(const std::filesystem::path& path);
/// Every n-th point of it alone, for a picture; ids are the points' numbers in the file.
[[nodiscard]] ACCESSVDB_API FieldSnapshot readPointsPly(const std::filesystem::path& path, std::uint64_t every);

/// What points.ply says before its points.
struct PointsHeader {
  std::uint64_t points = 0;
  Eigen::Vector3d origin_W = {0, 0, 0};
  double voxel_size_m = 0;
  FieldMetadata metadata;                    ///< the other comments, in order
  std::vector<std::string> attributes = {};  ///< names of what the returns carried
};
/// @throws InputError
[[nodiscard]] ACCESSVDB_API PointsHeader readPointsHeader(const std::filesystem::path& path);
/// Hands over one point after the other, so that they are never in memory together. @throws InputError
ACCESSVDB_API PointsHeader visitPoints(const std::filesystem::path& path,
                                       const std::function<void(const SurfacePoint&)>& take);
/// The same with what each point's returns carried.
using TakeCarryingPoint = std::function<void(const SurfacePoint&, std::span<const std::int32_t> attributes)>;
ACCESSVDB_API PointsHeader visitCarryingPoints(const std::filesystem::path& path, const TakeCarryingPoint& take);

/// What `info` prints about a grid.
struct GridSummary {
  std::string name, type, grid_class;
  std::uint64_t active_voxels = 0, leaves = 0, bytes = 0;
  std::array<std::int32_t, 3> min_ijk = {}, max_ijk = {};  ///< of active voxels
  Eigen::Vector3d voxel_size_m = {0, 0, 0};
  std::vector<std::pair<std::string, std::string>> metadata;
};
struct VdbSummary {
  std::string creator;
  std::vector<GridSummary> grids;
  std::vector<std::pair<std::string, std::string>> metadata;
};
/// Reads any .vdb file. @throws InputError (not a .vdb, damaged)
[[nodiscard]] ACCESSVDB_API VdbSummary summarizeVdb(const std::filesystem::path& path);

/// Answers about the map at world positions, from field.vdb of an output folder.
class ACCESSVDB_API StoredField {
 public:
  struct Answer {
    Eigen::Vector3d position_W;
    std::optional<SurfacePoint> point;  ///< the surface point of that voxel, else the nearest within 3 voxels
    double point_distance_m = 0;        ///< from the position to that point
    std::vector<std::pair<std::string, std::int32_t>> attributes = {};  ///< of that point: what its returns carried
    bool observed = false, cleared = false;
    float distance_m = 0, weight = 0;
  };
  /// @throws InputError if the folder holds no field written by this library; "output.changed" if a file is not as it
  ///         was written (output_check.h)
  static StoredField open(const std::filesystem::path& folder);
  /// The same, told more of. @param check  may allow what has changed, and has the warnings
  static StoredField open(const std::filesystem::path& folder, OutputCheck& check);
  ~StoredField();
  StoredField(StoredField&&) noexcept;
  [[nodiscard]] Answer at(const Eigen::Vector3d& p_W) const;
  [[nodiscard]] const FieldSnapshot& points() const;

 private:
  struct Impl;
  explicit StoredField(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace accessvdb::io

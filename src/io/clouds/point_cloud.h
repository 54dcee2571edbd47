// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The points of one file, and how to read them: whole, or part by part with the memory of one part. Readers pass on
/// bad values (NaN, 1e30, (0,0,0)) unchanged: the integrator counts them.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/survey_frame.h"
#include "io/clouds/carried_fields.h"

namespace accessvdb::io {

/// Points of a LAS file that its maker deleted, made up or took for noise; each counts once.
struct NoiseCounts {
  std::uint64_t withheld = 0, synthetic = 0, noise = 0;
  [[nodiscard]] std::uint64_t all() const { return withheld + synthetic + noise; }
  /// "12 withheld points and 3 points of the noise classes 7 and 18"
  [[nodiscard]] std::string inWords() const;
};

struct PointCloud {
  std::vector<Eigen::Vector3d> points;       ///< frame of the file; of LAS in metres, else in the file's units
  std::vector<Eigen::Vector3d> ray_vectors;  ///< [n] sensor minus point, only with ReadOptions::rays
  std::vector<Eigen::Vector3d> sensors;      ///< [n] PTX: where the scanner of each point was
  std::vector<double> stamps_s;              ///< [n] only with ReadOptions::rays or times, if the file has them
  std::vector<std::int32_t> attributes;      ///< [n x ReadOptions::carry], row by row
  std::vector<double> times;                 ///< [n] only with ReadOptions::point_times: in the file's own unit
  std::uint64_t truncated_points = 0;        ///< records announced by the header but missing in the file
  std::uint64_t unbounded_rays = 0;          ///< skipped rays that hit nothing (ray clouds: alpha 0)
  std::uint64_t outside_points = 0;          ///< points outside the header's bounding box (LAS)
  NoiseCounts left_out = {};                 ///< not among the points
  std::vector<std::string> notices;
};

struct ReadOptions {
  bool allow_truncated = false;
  bool rays = false;                    ///< PLY: nx ny nz are required, and lead back to the sensor
  bool times = false;                   ///< a time for each point is required
  bool point_times = false;             ///< PCD, PLY: the time of each point within a scan, if the file has it
  bool keep_noise = false;              ///< LAS: see NoiseCounts
  std::vector<std::string> carry = {};  ///< attributes of the returns, see CarriedFields; others than PCD, PLY and LAS
                                        ///< have none
  std::int32_t scan = 0;                ///< number of the file among those that are read, for ReadOptions::carry
  std::string crs_wkt = {};             ///< LAS: counts instead of what the file says of its coordinate system
  std::string laz_command = {};         ///< writes a LAZ file as LAS to its standard output, see decoder_pipe.h
};

/// The last three are recordings: many clouds and their poses in one file, see recording_steps.h.
enum class ScanKind { Pcd, Ply, KittiBin, Las, Xyz, Laz, Ptx, Mcap, RosBag, Sqlite };

/// Counts over all parts of a cloud.
struct CloudTotals {
  std::uint64_t points = 0, truncated_points = 0, unbounded_rays = 0, outside_points = 0;
  NoiseCounts left_out = {};
  void add(const PointCloud& part);
};

/// One file, opened for reading part by part. Holds a part of the file, not all of it (but all of a compressed PCD).
class CloudReader {
 public:
  /// Where the reader stands. Only a place of the same file may be returned to.
  struct Place {
    std::uint64_t byte = 0, record = 0, line = 0;
    std::uint64_t section = 0, section_line = 0;  ///< PTX: where the header of the station begins
  };

  virtual ~CloudReader() = default;
  CloudReader() = default;
  CloudReader(const CloudReader&) = delete;
  CloudReader& operator=(const CloudReader&) = delete;

  /// The next `count` points; fewer only at the end of the cloud, and then with the count of truncated points.
  /// @throws InputError naming the file
  [[nodiscard]] virtual PointCloud next(std::size_t count) = 0;
  [[nodiscard]] virtual Place place() const = 0;
  virtual void seek(const Place& place) = 0;
  /// Points to come, for reserving memory: no more than the file can contain; 0 if unknown.
  [[nodiscard]] virtual std::uint64_t expectedPoints() const { return 0; }
  /// Memory between parts that grows with the file; 0 for all but compressed PCD.
  [[nodiscard]] virtual std::uint64_t heldBytes() const { return 0; }
  /// The field with the time of each point, with ReadOptions::point_times; empty if there is none.
  [[nodiscard]] virtual std::string timeField() const { return {}; }
  /// Where ReadOptions::carry is in the records; null for a format that has no such fields.
  [[nodiscard]] virtual const CarriedFields* carried() const { return nullptr; }
  /// The coordinate system that the file says; null for a format that says none.
  [[nodiscard]] virtual const SurveyFrame* frame() const { return nullptr; }
  /// Metres in one unit of the file's x, y and z; what else is given in the cloud's frame has the same units.
  [[nodiscard]] virtual Eigen::Vector3d unit_m() const { return {1, 1, 1}; }
  /// Distance of coordinates that are next to each other, where the file says it; 0 where it does not.
  [[nodiscard]] virtual double step_m() const { return 0; }
  /// What the file says of its units and could not be read, in words; empty if there is nothing.
  [[nodiscard]] virtual std::string unitDoubt() const { return {}; }
  /// What is wrong with what the file says of its coordinate system, in words; empty if there is nothing.
  [[nodiscard]] virtual std::string systemDoubt() const { return {}; }
  /// What is to be told about the cloud as a whole. @param totals  over all its parts
  [[nodiscard]] virtual std::vector<std::string> notices(const CloudTotals& totals) const;
};

/// Opens a file and checks its header and size. @throws InputError naming the file
[[nodiscard]] std::unique_ptr<CloudReader> openCloud(const std::filesystem::path& path, ScanKind kind,
                                                     const ReadOptions& options);

/// One format each. @throws as openCloud
[[nodiscard]] std::unique_ptr<CloudReader> openPcd(const std::filesystem::path& path, const ReadOptions& options);
[[nodiscard]] std::unique_ptr<CloudReader> openPly(const std::filesystem::path& path, const ReadOptions& options);
[[nodiscard]] std::unique_ptr<CloudReader> openKittiBin(const std::filesystem::path& path, const ReadOptions& options);
[[nodiscard]] std::unique_ptr<CloudReader> openLas(const std::filesystem::path& path, const ReadOptions& options);
[[nodiscard]] std::unique_ptr<CloudReader> openLaz(const std::filesystem::path& path, const ReadOptions& options);
[[nodiscard]] std::unique_ptr<CloudReader> openPtx(const std::filesystem::path& path, const ReadOptions& options);
[[nodiscard]] std::unique_ptr<CloudReader> openXyz(const std::filesystem::path& path, const ReadOptions& options);

/// The whole file at once. @throws InputError naming the file
[[nodiscard]] PointCloud readCloud(const std::filesystem::path& path, ScanKind kind, const ReadOptions& options);
[[nodiscard]] PointCloud readWhole(CloudReader& reader);

/// tx ty tz qw qx qy qz of a PCD's VIEWPOINT line, unchecked; empty if the file has none.
[[nodiscard]] std::optional<std::array<double, 7>> readPcdViewpoint(const std::filesystem::path& path);

}  // namespace accessvdb::io

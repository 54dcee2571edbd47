// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Reading scans and poses from files, and matching them to each other.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/export.h"
#include "accessvdb/survey_frame.h"

namespace accessvdb::io {

/// Auto looks at the file's name and content. Viewpoint: the VIEWPOINT line of each PCD.
enum class PoseFormat { Auto, Tum, Kitti, Balm, Hba, Viewpoint };

/// How poses of a file are matched to scans. Auto tries names, times and the order, and the matching rule says which;
/// the others insist: numbers in names are those of poses, names or times.txt are times, or one follows the other.
enum class Match { Auto, Order, Name, Time };

/// Whether the sensor's motion within a scan is removed: each return is placed by the pose at its own time. Auto: where
/// returns have times and poses are dense enough; the matching rule says which.
enum class Deskew { Auto, On, Off };

/// How the frame of the poses is tilted: the world is turned so that z points up.
struct Level {
  bool from_imu = false;               ///< by the gravity that the recording's IMU felt at the start
  double roll_rad = 0, pitch_rad = 0;  ///< else: of the frame that the poses are in, turned about y by pitch, then x
};

/// LAS and LAZ: points that are flagged as withheld or synthetic or are of the noise classes 7 and 18 are left out
/// unless keep_noise is set. Coordinates in feet are converted to metres, and with them those of `sensor_at_W`,
/// `trajectory` and `stations`, which are taken to be in the units of the cloud.
struct ScanInputOptions {
  std::filesystem::path scans = {};  ///< a folder of scans, one file, or a recording
  std::filesystem::path poses = {};  ///< may be empty (VIEWPOINT, ray cloud, sensor_at)
  PoseFormat pose_format = PoseFormat::Auto;
  Match match = Match::Auto;  ///< for scans with a pose file
  /// Longest time without poses, or positions of a trajectory, over which they are interpolated: 0.001 .. 10 s.
  double max_gap_s = 0.2;
  std::filesystem::path calib = {};                 ///< KITTI calib.txt, if the poses are the camera's
  std::optional<Eigen::Vector3d> sensor_at_W = {};  ///< one sensor position for one cloud in the world frame
  int every = 1;                                    ///< use every n-th scan
  bool allow_truncated = false;                     ///< keep the complete records of a truncated file
  bool keep_noise = false;                          ///< LAS: keep withheld and synthetic points and noise, see below
  bool sort_poses = false;                          ///< accept pose files whose stamps run backwards, by sorting them
  std::size_t rays_per_step = 20000;                ///< a cloud in the world frame is read in steps of this many
  /// Where the sensor was at the time of each return of LAS, LAZ or PLY in the world frame: text with time x y z, TUM,
  /// or columns named by a header.
  std::filesystem::path trajectory = {};
  /// Added to the stamps of clouds and scans before a trajectory or poses with time stamps are looked up.
  double time_offset_s = 0;
  /// Scanners on tripods: a line "file x y z" for each cloud in the world frame, names relative to `scans`.
  std::filesystem::path stations = {};
  /// Writes a LAZ file as LAS to its standard output; run without a shell, split at blanks, with the file's name as
  /// last argument. Empty: `laszip -stdout` or `las2las -stdout`, whichever is in PATH.
  std::string laz_command = {};
  /// Recordings (.mcap, .db3, .bag): which topic has the clouds, and which the poses. Empty: the only one; odometry
  /// before transforms.
  std::string topic = {}, pose_topic = {};
  /// Recordings: the frame of the result. Empty: the one that the odometry is in, or the top of the transforms.
  std::string fixed_frame = {};
  /// Pose of the sensor in the frame whose poses are given (an IMU, a body): T_W_S becomes T_W_B * T_B_S.
  std::optional<Eigen::Isometry3d> T_B_S = {};
  /// Returns inside this box, in the sensor's frame, are left out: they are from the platform itself.
  std::optional<Eigen::AlignedBox3d> exclude_box_S = {};
  Deskew deskew = Deskew::Auto;
  std::optional<Level> level = {};
  /// From the sensor to each point of clouds in the world frame whose true rays are not known: (0,0,-10) for a flight
  /// above them. What is between is taken to be free.
  std::optional<Eigen::Vector3d> ray_W = {};
  /// Names of what the returns carry (attributes.h): dimensions and extra bytes of LAS, properties of PLY, fields of
  /// PCD and PointCloud2, whole numbers all of them. Case and underscores do not matter.
  std::vector<std::string> carry = {};
  /// Behind those, the number of the scan, from 0, and of the return's row in it.
  bool index = false;
  /// Behind those, LAS and LAZ: kFirstReturnNames (survey_frame.h).
  bool first_returns = false;
  /// Well-known text of the coordinate system of LAS and LAZ, in place of what the files say. The unit is its unit.
  std::string crs_wkt = {};
};

/// Something about the input that is most likely a mistake, or a loss.
struct ScanWarning {
  std::string id;  ///< stable dotted name, for example "recording.cut_off"
  std::string text;
};

/// One integration step: either points_S with T_W_S, or points_W with origins_W (size n, or 1 for all). A deskewed scan
/// is the latter; T_W_S is then the sensor's pose at stamp_s.
struct ScanRecord {
  std::vector<Eigen::Vector3f> points_S;
  Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
  std::vector<Eigen::Vector3d> points_W;
  std::vector<Eigen::Vector3d> origins_W;
  std::vector<std::int32_t> attributes;  ///< [points x what is carried], row by row
  double stamp_s = 0;                    ///< 0 where unknown
  double step_m = 0;  ///< between coordinates that are next to each other, where the file says it (LAS); else 0
  std::string path;
  std::uint64_t truncated_points = 0;  ///< records announced by the header but missing in the file
  std::uint64_t excluded_points = 0;   ///< left out: inside ScanInputOptions::exclude_box_S
  std::uint64_t noise_points = 0;      ///< left out: see ScanInputOptions::keep_noise
  std::uint64_t unposed_points = 0;    ///< left out: no pose at their time, see Deskew
  bool deskewed = false;               ///< each return has been placed by the pose at its own time
  std::string skipped = {};            ///< why there are no points: the scan cannot be used; empty for all others
};

/// ScanRecord::attributes in as many columns as a field has, where the record is of scans that were read with others:
/// what is missing at the end of a row is kNoAttribute, what is too much is left out.
[[nodiscard]] ACCESSVDB_API std::vector<std::int32_t> attributesFor(const ScanRecord& record, std::size_t columns);

struct InputFile {
  std::string path;
  std::string sha256;
};

/// Scans with their poses, in order; files are read on demand. Holds one step, not one file: steps may be read in any
/// order and more than once, cheapest in ascending order.
class ACCESSVDB_API ScanSequence {
 public:
  /// Lists the scans, reads the poses, matches them and checks them. A scan that is empty, or whose header is cut off,
  /// costs that scan and a warning, unless most are so; and one that is there twice counts once.
  /// @throws InputError (code 3) unreadable or malformed; UnusableInput (code 4) no overlap, bad poses
  static ScanSequence open(const ScanInputOptions& options);
  ~ScanSequence();
  ScanSequence(ScanSequence&&) noexcept;
  ScanSequence& operator=(ScanSequence&&) noexcept;

  [[nodiscard]] std::size_t size() const;  ///< number of steps
  /// @throws InputError naming the file; UnusableInput "scans.skipped" when most steps have had to be skipped
  [[nodiscard]] ScanRecord read(std::size_t step);
  /// Time of a step, without reading it: of the scan, or of a cloud's first return. Nothing where unknown.
  [[nodiscard]] std::optional<double> stamp_s(std::size_t step) const;
  /// The pose of a step as it was given, T_W_B, or the one `shift_s` later: without ScanInputOptions::T_B_S and level.
  /// Nothing for clouds in the world frame, and where no pose is at that time.
  [[nodiscard]] std::optional<Eigen::Isometry3d> givenPose(std::size_t step, double shift_s = 0) const;
  /// ScanRecord::T_W_S of a step, without reading it. Nothing for clouds in the world frame.
  [[nodiscard]] std::optional<Eigen::Isometry3d> sensorPose(std::size_t step) const;
  [[nodiscard]] std::string path(std::size_t step) const;          ///< the file of a step, without reading it
  [[nodiscard]] const std::vector<std::string>& notices() const;   ///< frame, quaternion order, matching rule, repairs
  [[nodiscard]] const std::vector<ScanWarning>& warnings() const;  ///< not among the notices
  /// What only reading showed, of the steps that were read so far: scans that are skipped.
  [[nodiscard]] std::vector<ScanWarning> readWarnings() const;
  /// The coordinate system of clouds in the world frame, as all of their files say it; empty for others.
  [[nodiscard]] const SurveyFrame& frame() const;
  [[nodiscard]] std::string matchingRule() const;        ///< one line, also part of the notices
  [[nodiscard]] bool deskews() const;                    ///< motion within scans is removed, where poses cover a scan
  [[nodiscard]] std::vector<std::string> paths() const;  ///< every file that is or will be read
  [[nodiscard]] std::optional<double> recordedRangeNoise_m() const;  ///< from range_noise.txt next to the scans, if any
  /// Memory that is held between reads: poses or the list of steps, a trajectory, the content of a compressed PCD.
  [[nodiscard]] std::uint64_t heldBytes() const;
  [[nodiscard]] std::uint64_t inputBytes() const;  ///< total size of the scan files

 private:
  struct Impl;
  explicit ScanSequence(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// The well-known text of a coordinate system: a code such as "EPSG:32632", which PROJ's program projinfo looks up, or
/// a file with such text, which it checks if it is installed. @throws InputError "las.crs", "input.geographic",
/// "input.unit"
[[nodiscard]] ACCESSVDB_API std::string crsWkt(const std::string& crs);
/// The same with its unit.
[[nodiscard]] ACCESSVDB_API SurveyFrame crsFrame(const std::string& crs);
/// What a LAS file says of its coordinate system. @throws InputError
[[nodiscard]] ACCESSVDB_API SurveyFrame frameOfLas(const std::filesystem::path& file);

/// Lower-case hexadecimal SHA-256 of a file. @throws InputError
[[nodiscard]] ACCESSVDB_API std::string sha256OfFile(const std::filesystem::path& path);
/// The same of what a field gets of scans, to the bit: returns, and whence and when they were taken.
/// @param before  the result for those before; empty for the first one
[[nodiscard]] ACCESSVDB_API std::string sha256OfScans(const std::string& before, const ScanRecord& next);

/// Query positions from a text file, one "x y z" or "x,y,z" per line. @throws InputError naming the line
[[nodiscard]] ACCESSVDB_API std::vector<Eigen::Vector3d> readPositions(const std::filesystem::path& path);
/// Poses of a tool, world from tool, one "x y z qw qx qy qz" per line: the tip in metres and a unit quaternion. With a
/// line of these names before them, in any order and with more columns. @throws InputError naming the line
[[nodiscard]] ACCESSVDB_API std::vector<Eigen::Isometry3d> readToolPoses(const std::filesystem::path& path);

}  // namespace accessvdb::io

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Clouds in the world frame, cut into steps. Holds one part of one file, and where each step begins.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/scan_io.h"
#include "io/clouds/point_cloud.h"
#include "io/poses/trajectory.h"

namespace accessvdb::io {

class TrajectoryCoverage;

/// Where the sensor was: with ReadOptions::rays, each return has a vector to it, or a position; else the trajectory
/// says it for each return's time; else it is before each point by ray_W; else it is one position for each file.
struct CloudInput {
  std::vector<std::filesystem::path> files = {};
  ScanKind kind = ScanKind::Ply;
  ReadOptions read = {};
  std::optional<Trajectory> trajectory = {};    ///< needs ReadOptions::times
  double time_offset_s = 0;                     ///< added to the cloud's stamps
  std::optional<Eigen::Vector3d> ray_W = {};    ///< from the sensor to each point
  std::vector<Eigen::Vector3d> sensors_W = {};  ///< [files]
  std::size_t rays_per_step = 1;
  int every = 1;  ///< use every n-th step
};

class CloudSteps {
 public:
  /// Reads all files once, to find where steps begin and to check all that only the whole can tell.
  /// @throws InputError; UnusableInput (no points, surface normals instead of rays, as TrajectoryCoverage::check)
  explicit CloudSteps(CloudInput input);

  [[nodiscard]] std::size_t size() const { return steps_.size(); }
  [[nodiscard]] ScanRecord read(std::size_t step);
  [[nodiscard]] std::uint64_t heldBytes() const;  ///< see ScanSequence
  [[nodiscard]] std::optional<double> stamp_s(std::size_t step) const { return steps_.at(step).stamp_s; }
  [[nodiscard]] const std::filesystem::path& path(std::size_t step) const { return input_.files[steps_.at(step).file]; }
  [[nodiscard]] const std::vector<std::string>& notices() const { return notices_; }
  /// Of all files. @throws the constructor: UnusableInput "scans.frame" if they are in different ones
  [[nodiscard]] const SurveyFrame& frame() const { return frame_; }
  /// Of each file, CloudReader::unitDoubt() or systemDoubt() with its name.
  [[nodiscard]] const std::vector<std::string>& unitDoubts() const { return unit_doubts_; }
  [[nodiscard]] const std::vector<std::string>& systemDoubts() const { return system_doubts_; }

 private:
  struct Step {
    std::size_t file = 0;
    CloudReader::Place place;
    std::size_t returns = 0;             ///< in the file
    std::size_t used = 0;                ///< of these, with a position of the sensor: only they are handed out
    std::optional<double> stamp_s = {};  ///< of its first return
  };

  void findSteps();
  void noteFrame(std::size_t file);
  void open(std::size_t file);
  void checkSize(std::size_t file) const;
  void checkReader(const CloudTotals& totals, bool all_unit);
  /// @return how many of the part have a position
  std::size_t addTo(TrajectoryCoverage& coverage, const PointCloud& part);
  /// In metres, for the file that is open. @param given  in the file's units
  [[nodiscard]] Eigen::Vector3d inMetres(const Eigen::Vector3d& given) const;
  [[nodiscard]] std::optional<Eigen::Vector3d> sensorAt(double stamp_s);
  void append(const PointCloud& part, ScanRecord& record);

  CloudInput input_;
  std::vector<Step> steps_;
  std::vector<std::uint64_t> file_bytes_;  ///< [files] when they were first read
  std::vector<std::string> notices_, unit_doubts_, system_doubts_;
  std::uint64_t truncated_points_ = 0, noise_points_ = 0;
  SurveyFrame frame_;
  std::unique_ptr<CloudReader> reader_;  ///< of file_
  std::size_t file_ = 0;
  std::size_t near_ = 0;  ///< see Trajectory::at
};

}  // namespace accessvdb::io

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/scans/scan_options.h"

#include <cmath>
#include <utility>

#include "accessvdb/error.h"
#include "io/poses/pose_checks.h"
#include "io/poses/pose_gap.h"
#include "io/recordings/recording_index.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {

void checkOptions(const ScanInputOptions& options) {
  if (options.every < 1)
    throw InvalidArgument("usage.every", "ScanInputOptions::every", "must be at least 1", "1 uses all scans");
  if (options.rays_per_step < 1)
    throw InvalidArgument("usage.rays_per_step", "rays_per_step", "must be at least 1", "The default is 20000");
  if (!std::isfinite(options.time_offset_s))
    throw InvalidArgument("usage.time_offset", "time_offset_s", "must be a finite number", "Use seconds");
  if (!(options.max_gap_s >= kLeastPoseGap_s && options.max_gap_s <= kMostPoseGap_s))
    throw InvalidArgument("usage.max_gap", "max_gap_s", "must be within 0.001 .. 10 seconds", "The default is 0.2");
  if (options.match != Match::Auto && options.poses.empty())
    throw InvalidArgument("usage.match", "ScanInputOptions::match", "is for scans with a pose file",
                          "Add ScanInputOptions::poses, or omit it");
  if (options.T_B_S) (void)PoseChecker("T_B_S").fromMatrix(options.T_B_S->matrix().topRows<3>(), 0);
  if (const auto& box = options.exclude_box_S; box && !(box->sizes().minCoeff() > 0 && box->sizes().allFinite()))
    throw InvalidArgument("usage.exclude_box", "exclude_box_S", "must have a finite size above 0 along each axis",
                          "Use X0,Y0,Z0,X1,Y1,Z1, the lower corner first");
  if (!options.trajectory.empty() && (!options.poses.empty() || options.sensor_at_W || !options.calib.empty()))
    throw InvalidArgument("usage.trajectory", "ScanInputOptions::trajectory",
                          "excludes ScanInputOptions::poses, sensor_at_W and ScanInputOptions::calib",
                          "Use ScanInputOptions::trajectory for a cloud in the world frame, ScanInputOptions::poses "
                          "for scans in the sensor's");
  if (!options.stations.empty() &&
      (!options.poses.empty() || options.sensor_at_W || !options.calib.empty() || !options.trajectory.empty()))
    throw InvalidArgument(
        "usage.stations", "ScanInputOptions::stations",
        "excludes ScanInputOptions::poses, sensor_at_W, ScanInputOptions::trajectory and ScanInputOptions::calib",
        "Use ScanInputOptions::stations for clouds in the world frame, ScanInputOptions::poses for scans in the "
        "scanner's");
  if (options.level && !(std::abs(options.level->roll_rad) <= 4 && std::abs(options.level->pitch_rad) <= 4))
    throw InvalidArgument("usage.level", "ScanInputOptions::level", "must be two finite angles",
                          "Use ROLL,PITCH in degrees, or imu");
  if (const auto& ray = options.ray_W) {
    if (!(ray->norm() > 0 && ray->norm() <= 1e5))
      throw InvalidArgument("usage.ray", "ray_W", "must be a vector longer than 0, from the sensor to a point",
                            "Use X,Y,Z in metres, for example 0,0,-10 for a flight above the cloud");
    if (!options.poses.empty() || options.sensor_at_W || !options.calib.empty() || !options.trajectory.empty() ||
        !options.stations.empty())
      throw InvalidArgument("usage.ray", "ray_W",
                            "excludes ScanInputOptions::poses, sensor_at_W, ScanInputOptions::trajectory, "
                            "ScanInputOptions::stations and ScanInputOptions::calib",
                            "Omit it where it is known where the sensor was");
  }
  if (!options.sensor_at_W) return;
  if (!options.sensor_at_W->allFinite())
    throw InvalidArgument("usage.sensor_at", "sensor_at_W", "must be three finite numbers", "Use X,Y,Z in metres");
  if (!options.poses.empty())
    throw InvalidArgument("usage.sensor_at", "sensor_at_W", "and a pose file exclude each other",
                          "Omit one of the two");
}

void checkKind(const ScanInputOptions& options, const ScanFileList& scans) {
  const bool recording = isRecording(scans.kind);
  for (const auto& [flag, value] : {std::pair("ScanInputOptions::topic", &options.topic),
                                    {"pose_topic", &options.pose_topic},
                                    {"fixed_frame", &options.fixed_frame}})
    if (!recording && !value->empty())
      throw InvalidArgument("usage.recording", flag, "is for recordings (.mcap, .db3, .bag)", "Omit it");
  if (recording &&
      (options.sensor_at_W || !options.calib.empty() || !options.trajectory.empty() || !options.stations.empty()))
    throw InvalidArgument("usage.recording", forMessage(scans.files.front().native()),
                          "is a recording, which excludes sensor_at_W, ScanInputOptions::calib, "
                          "ScanInputOptions::trajectory and ScanInputOptions::stations",
                          "Use its own poses, or ScanInputOptions::poses with a pose file in TUM format");
  if (scans.kind == ScanKind::Ptx && (!options.poses.empty() || options.sensor_at_W || !options.trajectory.empty() ||
                                      !options.stations.empty() || options.ray_W))
    throw InvalidArgument("usage.ptx", forMessage(scans.files.front().native()),
                          "has the scanners' poses in itself (PTX), which excludes ScanInputOptions::poses, "
                          "sensor_at_W, ScanInputOptions::trajectory, "
                          "ScanInputOptions::stations and ray_W",
                          "Omit them");
  if (options.match != Match::Auto && recording)
    throw InvalidArgument("usage.match", "ScanInputOptions::match",
                          "is for scans in files: the clouds of a recording have times", "Omit it");
  if (options.ray_W && recording)
    throw InvalidArgument("usage.recording", "ray_W", "is for clouds in the world frame, not for recordings",
                          "Omit it");
  if (options.level && options.level->from_imu && !recording)
    throw InvalidArgument("usage.level", "Level::from_imu", "is for recordings (.mcap, .db3, .bag)",
                          "Use ScanInputOptions::level ROLL,PITCH in degrees");
  if (options.time_offset_s != 0 && !recording && options.trajectory.empty() && options.poses.empty())
    throw InvalidArgument("usage.time_offset", "time_offset_s", "is for times that are looked up in poses",
                          "Add ScanInputOptions::trajectory or ScanInputOptions::poses, or omit it");
}

}  // namespace accessvdb::io

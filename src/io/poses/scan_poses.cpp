// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/scan_poses.h"

#include <algorithm>
#include <exception>
#include <functional>
#include <system_error>

#include "accessvdb/error.h"
#include "accessvdb/program/path_facts.h"
#include "io/poses/pose_checks.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {
namespace {

namespace fs = std::filesystem;

std::optional<fs::path> findTimes(const ScanFileList& scans, const fs::path& poses) {
  if (auto beside = besideScans(scans, "times.txt")) return beside;
  fs::path beside_poses = poses.parent_path() / "times.txt";
  if (isFile(beside_poses)) return beside_poses;
  return std::nullopt;
}

/// KITTI keeps the stamps of its poses in times.txt, one per pose.
void stampPoses(PoseFile& poses, const std::vector<double>& times) {
  if (poses.stamped || times.size() != poses.poses.size()) return;
  if (std::adjacent_find(times.begin(), times.end(), std::greater_equal<>()) != times.end()) return;
  for (std::size_t i = 0; i < times.size(); ++i) poses.poses[i].stamp_s = times[i];
  poses.stamped = true;
}

ScanPoses fromPoseFile(const ScanFileList& scans, const ScanInputOptions& options) {
  ScanPoses result;
  PoseFile poses = readPoseFile(options.poses, options.pose_format, options.calib, options.sort_poses);
  result.files.push_back(options.poses);
  if (!options.calib.empty()) result.files.push_back(options.calib);
  std::vector<double> times;
  std::string times_name;
  if (const auto path = findTimes(scans, options.poses)) {
    times = readTimes(*path);
    times_name = forMessage(path->native());
    result.files.push_back(*path);
    stampPoses(poses, times);
  }
  std::vector<std::string> stems;
  for (const fs::path& file : scans.files) stems.push_back(file.stem().string());
  result.notices = poses.notices;
  result.match =
      matchPoses(stems, poses, times, times_name,
                 {.match = options.match, .time_offset_s = options.time_offset_s, .max_gap_s = options.max_gap_s});
  result.warnings = poses.warnings;
  result.warnings.insert(result.warnings.end(), result.match.warnings.begin(), result.match.warnings.end());
  result.stamped = poses.stamped;
  if (poses.stamped) result.track = std::move(poses.poses);
  return result;
}

/// @param asked  whether the format was requested; otherwise several identity poses count as none
ScanPoses fromViewpoints(const ScanFileList& scans, bool asked) {
  ScanPoses result;
  std::size_t missing = 0, identity = 0, bad = 0;
  std::exception_ptr first;
  std::string problem;
  for (std::size_t i = 0; i < scans.files.size(); ++i) {
    const auto viewpoint = readPcdViewpoint(scans.files[i]);
    MatchedScan scan{i, Eigen::Isometry3d::Identity(), 0};
    if (viewpoint) {
      const auto& v = *viewpoint;
      PoseChecker checker(forMessage(scans.files[i].native()) + " VIEWPOINT");
      try {
        scan.T_W_S = checker.fromQuaternion({v[0], v[1], v[2]}, {v[3], v[4], v[5], v[6]}, 0);
      } catch (const UnusableInput& error) {
        if (!checker.foundNone()) throw;
        if (bad++ == 0) {
          first = std::current_exception();
          problem = error.subject() + ": " + error.problem();
        }
        continue;
      }
      if (result.notices.empty()) checker.addNotice(result.notices);
    } else {
      ++missing;
    }
    identity += scan.T_W_S.matrix().isIdentity(0) ? 1 : 0;
    result.match.scans.push_back(scan);
  }
  if (bad > 0 && 2 * bad >= scans.files.size()) std::rethrow_exception(first);
  if (bad > 0)
    result.warnings.push_back({"poses.skipped", std::to_string(bad) + " of " + std::to_string(scans.files.size()) +
                                                    " scans are skipped, because their poses are none: " + problem});
  if (!asked && scans.files.size() > 1 && identity + bad == scans.files.size())
    throw UnusableInput("poses.none", forMessage(scans.folder.native()),
                        "there is no pose file and no scan has a VIEWPOINT other than the identity",
                        "Use ScanInputOptions::poses; for a static sensor, with identical poses");
  result.match.rule = "matching: each scan has its pose in its VIEWPOINT line";
  result.notices.push_back("poses: PCD VIEWPOINT, sensor to world, quaternion order w x y z");
  if (missing != 0)
    result.notices.push_back("poses: " + std::to_string(missing) + " of " + std::to_string(scans.files.size()) +
                             " scans have no VIEWPOINT line; their pose is taken to be the identity");
  return result;
}

}  // namespace

std::optional<fs::path> besideScans(const ScanFileList& scans, const std::string& name) {
  for (const fs::path& folder : {scans.folder, scans.folder / ".."}) {
    fs::path candidate = folder / name;
    if (isFile(candidate)) return candidate.lexically_normal();
  }
  return std::nullopt;
}

ScanPoses posesForScans(const ScanFileList& scans, const ScanInputOptions& options) {
  if (!options.poses.empty()) return fromPoseFile(scans, options);
  if (!options.calib.empty())
    throw InvalidArgument("usage.calib", forMessage(options.calib.native()), "a calibration needs a pose file",
                          "Add ScanInputOptions::poses");
  if (scans.kind == ScanKind::Pcd &&
      (options.pose_format == PoseFormat::Auto || options.pose_format == PoseFormat::Viewpoint))
    return fromViewpoints(scans, options.pose_format == PoseFormat::Viewpoint);
  if (options.pose_format == PoseFormat::Auto && scans.kind == ScanKind::KittiBin && scans.files.size() == 1) {
    ScanPoses result;
    result.match.scans.push_back({});
    result.match.rule = "matching: one scan without a pose, the sensor is assumed to be at the origin";
    return result;
  }
  throw UnusableInput("poses.none", forMessage(scans.folder.native()), "there are no poses for these scans",
                      "Use ScanInputOptions::poses, or for one cloud sensor_at_W X,Y,Z");
}

}  // namespace accessvdb::io

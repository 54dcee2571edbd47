// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The sensor's motion within one scan, and how it is removed: each return is placed by the pose at its own time.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "accessvdb/scan_io.h"
#include "io/clouds/point_times.h"

namespace accessvdb::io {

/// T_W_S at so many milliseconds from the scan's stamp; nothing where there is no pose.
using PoseAtMillisecond = std::function<std::optional<Eigen::Isometry3d>(std::int64_t)>;

/// From the last whole millisecond before a range to the first after it: those at which poses are asked for.
struct WholeMilliseconds {
  std::int64_t first = 0, last = 0;
};
[[nodiscard]] WholeMilliseconds around(const OffsetRange& range);

/// Poses at each whole millisecond; between two of them the transform is a straight line, which at 1000 degrees per
/// second is off by 4e-5 of the range.
class ScanMotion {
 public:
  ScanMotion(const PoseAtMillisecond& poseAt, const OffsetRange& range);

  [[nodiscard]] std::optional<Eigen::Affine3d> at(double offset_s) const;

 private:
  std::int64_t first_ms_ = 0;
  std::vector<std::optional<Eigen::Isometry3d>> poses_;
};

struct TimedScan {
  const std::vector<Eigen::Vector3f>& points_S;
  const std::vector<double>& times;  ///< [points_S]
  TimeScale scale;
  double stamp_s = 0;                                       ///< as TimeSpan::stamp_s
  Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();  ///< at the stamp; for what is no return
  std::optional<Eigen::AlignedBox3d> exclude_box_S;
  std::span<const std::int32_t> attributes = {};  ///< a row for each point, or empty
};

/// A registered scan: its points are where they were measured, with the motion removed.
struct TimedRays {
  const std::vector<Eigen::Vector3d>& points_W;
  const std::vector<double>& times;  ///< [points_W]
  TimeScale scale;
  double stamp_s = 0;  ///< as TimeSpan::stamp_s
  Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
  std::optional<Eigen::AlignedBox3d> exclude_box_S;
  std::span<const std::int32_t> attributes = {};  ///< a row for each point, or empty
};

struct MovedScan {
  std::vector<Eigen::Vector3d> points_W, origins_W;  ///< equal for "no return", so that it stays one
  std::vector<std::int32_t> attributes;              ///< of those
  std::uint64_t returns = 0;                         ///< of the scan, without excluded ones
  std::uint64_t unposed = 0;                         ///< of these left out: no pose at their time
  std::uint64_t excluded = 0;                        ///< inside exclude_box_S
};

[[nodiscard]] MovedScan removeMotion(const TimedScan& scan, const PoseAtMillisecond& poseAt);
/// Each ray begins where the sensor was when its point was measured.
[[nodiscard]] MovedScan beginWhereMeasured(const TimedRays& rays, const PoseAtMillisecond& poseAt);

/// Fewer returns with a pose make a scan that is used as it is, or not at all.
[[nodiscard]] inline bool coversScan(const MovedScan& moved) { return moved.unposed * 100 <= moved.returns; }

/// What the times of one scan mean.
struct TimesOfScan {
  const std::vector<double>& times;  ///< [points]
  TimeScale scale;
  OffsetRange usual;        ///< of scans that are timed right
  double stamp_s = 0;       ///< as TimeSpan::stamp_s
  bool registered = false;  ///< the points are where they were measured
  bool insist = false;      ///< Deskew::On: what has no pose is left out, however much it is
  std::optional<Eigen::AlignedBox3d> exclude_box_S;
};

enum class Placed {
  ByTimes,    ///< the record holds rays
  AsIs,       ///< too few returns have a pose at their time: nothing was done
  OtherTimes  ///< they are not the times of a scan, and it cannot be used
};

/// The one rule for scans of files, of recordings, and for live ones.
/// @param record  with T_W_S of the sensor, and points_S, or points_W if they are registered
[[nodiscard]] Placed placeByTimes(const TimesOfScan& times, const PoseAtMillisecond& poseAt, ScanRecord& record);

/// Points that are where they were measured, from one world to another. (0,0,0), which drivers write for "no return"
/// into such clouds too, stays what it is until the scan is placed.
void moveRegistered(const Eigen::Isometry3d& T, std::vector<Eigen::Vector3d>& points);

/// Rays to exactly (0,0,0) are no returns, in the world frame either: as returns they would free what lies between the
/// sensor and the world's origin. They end where they begin.
void placeNoReturns(ScanRecord& record);

/// The same for a scan that counts as measured at one moment.
void placeAtOnce(bool registered, const std::optional<Eigen::AlignedBox3d>& exclude_box_S, ScanRecord& record);

}  // namespace accessvdb::io

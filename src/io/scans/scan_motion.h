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

struct MovedScan {
  std::vector<Eigen::Vector3d> points_W, origins_W;  ///< equal for "no return", so that it stays one
  std::vector<std::int32_t> attributes;              ///< of those
  std::uint64_t returns = 0;                         ///< of the scan, without excluded ones
  std::uint64_t unposed = 0;                         ///< of these left out: no pose at their time
  std::uint64_t excluded = 0;                        ///< inside exclude_box_S
};

[[nodiscard]] MovedScan removeMotion(const TimedScan& scan, const PoseAtMillisecond& poseAt);

/// Whether the times can be those of the scan: nearly all returns were measured when those of other scans are.
[[nodiscard]] bool areTimesOf(const std::vector<Eigen::Vector3f>& points_S, const std::vector<double>& times,
                              const TimeScale& scale, double stamp_s, const OffsetRange& usual);

/// Puts it into a record.
void takeMoved(MovedScan moved, ScanRecord& record);

/// Fewer returns with a pose make a scan that is used as it is, or not at all.
[[nodiscard]] inline bool coversScan(const MovedScan& moved) { return moved.unposed * 100 <= moved.returns; }

}  // namespace accessvdb::io

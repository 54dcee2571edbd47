// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/scans/scan_motion.h"

#include <algorithm>
#include <cmath>

namespace accessvdb::io {

ScanMotion::ScanMotion(const PoseAtMillisecond& poseAt, const OffsetRange& range) {
  const auto millisecond = [](double offset_s) {
    return static_cast<std::int64_t>(std::floor(std::clamp(offset_s, -kLongestScan_s, kLongestScan_s) * 1e3));
  };
  first_ms_ = millisecond(range.first_s);
  const std::int64_t last_ms = millisecond(range.last_s) + 1;
  for (std::int64_t ms = first_ms_; ms <= last_ms; ++ms) poses_.push_back(poseAt(ms));
}

std::optional<Eigen::Affine3d> ScanMotion::at(double offset_s) const {
  const double ms = offset_s * 1e3, below = std::floor(ms);
  if (!(below >= static_cast<double>(first_ms_) && below - static_cast<double>(first_ms_) < 1e6)) return std::nullopt;
  const auto i = static_cast<std::size_t>(static_cast<std::int64_t>(below) - first_ms_);
  if (i >= poses_.size() || !poses_[i]) return std::nullopt;
  const double share = ms - below;
  constexpr double kNanosecond = 1e-6;  // as fine as times are: the last pose counts for the point that has its time
  if (share <= kNanosecond) return Eigen::Affine3d(poses_[i]->matrix());
  if (i + 1 >= poses_.size() || !poses_[i + 1]) return std::nullopt;
  Eigen::Affine3d between;
  between.matrix() = (1 - share) * poses_[i]->matrix() + share * poses_[i + 1]->matrix();
  return between;
}

MovedScan removeMotion(const TimedScan& scan, const PoseAtMillisecond& poseAt) {
  MovedScan moved;
  const std::size_t count = scan.points_S.size();
  moved.points_W.reserve(count);
  moved.origins_W.reserve(count);
  const auto span = timeSpanOf(scan.points_S, scan.times, scan.stamp_s);
  const TimeSpan none = {scan.stamp_s, scan.scale.absolute ? scan.stamp_s / scan.scale.unit_s : 0,
                         scan.scale.absolute ? scan.stamp_s / scan.scale.unit_s : 0};
  const TimeSpan known[] = {span.value_or(none)};
  const ScanMotion motion(poseAt, offsetRange(known, scan.scale));
  const std::size_t width = count == 0 ? 0 : scan.attributes.size() / count;
  const auto keepAttributes = [&](std::size_t i) {
    const auto row = scan.attributes.subspan(i * width, width);
    moved.attributes.insert(moved.attributes.end(), row.begin(), row.end());
  };
  for (std::size_t i = 0; i < count; ++i) {
    const Eigen::Vector3d p_S = scan.points_S[i].cast<double>();
    if (!isReturn(scan.points_S[i])) {
      const Eigen::Vector3d sensor_W = scan.T_W_S.translation();
      moved.origins_W.push_back(sensor_W);
      moved.points_W.push_back(p_S.isZero(0) ? sensor_W : p_S);
      keepAttributes(i);
      continue;
    }
    if (scan.exclude_box_S && scan.exclude_box_S->contains(p_S)) {
      ++moved.excluded;
      continue;
    }
    ++moved.returns;
    const auto T_W_S = motion.at(scan.scale.offset_s(scan.times[i], scan.stamp_s));
    if (!T_W_S) {
      ++moved.unposed;
      continue;
    }
    moved.points_W.push_back(*T_W_S * p_S);
    moved.origins_W.emplace_back(T_W_S->translation());
    keepAttributes(i);
  }
  return moved;
}

bool areTimesOf(const std::vector<Eigen::Vector3f>& points_S, const std::vector<double>& times, const TimeScale& scale,
                double stamp_s, const OffsetRange& usual) {
  std::uint64_t returns = 0, elsewhere = 0;
  for (std::size_t i = 0; i < points_S.size(); ++i) {
    if (!isReturn(points_S[i])) continue;
    ++returns;
    const double offset_s = scale.offset_s(times[i], stamp_s);
    elsewhere += offset_s < usual.first_s || offset_s > usual.last_s ? 1 : 0;  // NaN has no pose, and is counted there
  }
  return 100 * elsewhere <= returns;
}

void takeMoved(MovedScan moved, ScanRecord& record) {
  record.points_W = std::move(moved.points_W);
  record.origins_W = std::move(moved.origins_W);
  record.attributes = std::move(moved.attributes);
  record.excluded_points = moved.excluded;
  record.unposed_points = moved.unposed;
  record.deskewed = true;
}

}  // namespace accessvdb::io

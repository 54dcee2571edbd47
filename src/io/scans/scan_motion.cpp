// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/scans/scan_motion.h"

#include <algorithm>
#include <cmath>

#include "io/scans/exclude_box.h"

namespace accessvdb::io {

WholeMilliseconds around(const OffsetRange& range) {
  const auto millisecond = [](double offset_s) {
    return static_cast<std::int64_t>(std::floor(std::clamp(offset_s, -kLongestScan_s, kLongestScan_s) * 1e3));
  };
  return {millisecond(range.first_s), millisecond(range.last_s) + 1};
}

ScanMotion::ScanMotion(const PoseAtMillisecond& poseAt, const OffsetRange& range) {
  const WholeMilliseconds ms = around(range);
  first_ms_ = ms.first;
  for (std::int64_t at = ms.first; at <= ms.last; ++at) poses_.push_back(poseAt(at));
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

namespace {

/// @param inSensor  (point, pose at its time if there is one): where it is for the sensor, nothing if nobody knows
/// @param inWorld   (point, pose)
template <typename Scan, typename Point, typename InSensor, typename InWorld>
MovedScan moveEach(const Scan& scan, const std::vector<Point>& points, const PoseAtMillisecond& poseAt,
                   const InSensor& inSensor, const InWorld& inWorld) {
  MovedScan moved;
  const std::size_t count = points.size();
  moved.points_W.reserve(count);
  moved.origins_W.reserve(count);
  const auto span = timeSpanOf(points, scan.times, scan.stamp_s);
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
    const Eigen::Vector3d p = points[i].template cast<double>();
    if (!isReturn(points[i])) {
      const Eigen::Vector3d sensor_W = scan.T_W_S.translation();
      moved.origins_W.push_back(sensor_W);
      moved.points_W.push_back(p.isZero(0) ? sensor_W : p);
      keepAttributes(i);
      continue;
    }
    const auto T_W_S = motion.at(scan.scale.offset_s(scan.times[i], scan.stamp_s));
    if (const auto p_S = inSensor(p, T_W_S); scan.exclude_box_S && p_S && scan.exclude_box_S->contains(*p_S)) {
      ++moved.excluded;
      continue;
    }
    ++moved.returns;
    if (!T_W_S) {
      ++moved.unposed;
      continue;
    }
    moved.points_W.push_back(inWorld(p, *T_W_S));
    moved.origins_W.emplace_back(T_W_S->translation());
    keepAttributes(i);
  }
  return moved;
}

}  // namespace

MovedScan removeMotion(const TimedScan& scan, const PoseAtMillisecond& poseAt) {
  using Pose = std::optional<Eigen::Affine3d>;
  return moveEach(
      scan, scan.points_S, poseAt, [](const Eigen::Vector3d& p_S, const Pose&) { return std::optional(p_S); },
      [](const Eigen::Vector3d& p_S, const Eigen::Affine3d& T_W_S) -> Eigen::Vector3d { return T_W_S * p_S; });
}

MovedScan beginWhereMeasured(const TimedRays& rays, const PoseAtMillisecond& poseAt) {
  using Pose = std::optional<Eigen::Affine3d>;
  return moveEach(
      rays, rays.points_W, poseAt,
      [&](const Eigen::Vector3d& p_W, const Pose& T_W_S) -> std::optional<Eigen::Vector3d> {
        if (!T_W_S || !rays.exclude_box_S) return std::nullopt;
        return T_W_S->inverse() * p_W;
      },
      [](const Eigen::Vector3d& p_W, const Eigen::Affine3d&) { return p_W; });
}

namespace {

/// Nearly all returns were measured when those of other scans are.
template <typename Point>
bool areTimesOf(const std::vector<Point>& points, const TimesOfScan& of) {
  std::uint64_t returns = 0, elsewhere = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!isReturn(points[i])) continue;
    ++returns;
    const double offset_s = of.scale.offset_s(of.times[i], of.stamp_s);
    elsewhere += offset_s < of.usual.first_s || offset_s > of.usual.last_s ? 1 : 0;
    // NaN has no pose, and is counted there.
  }
  return 100 * elsewhere <= returns;
}

}  // namespace

Placed placeByTimes(const TimesOfScan& of, const PoseAtMillisecond& poseAt, ScanRecord& record) {
  if (of.registered ? !areTimesOf(record.points_W, of) : !areTimesOf(record.points_S, of)) return Placed::OtherTimes;
  MovedScan moved = of.registered ? beginWhereMeasured({record.points_W, of.times, of.scale, of.stamp_s, record.T_W_S,
                                                        of.exclude_box_S, record.attributes},
                                                       poseAt)
                                  : removeMotion({record.points_S, of.times, of.scale, of.stamp_s, record.T_W_S,
                                                  of.exclude_box_S, record.attributes},
                                                 poseAt);
  if (!of.insist && !coversScan(moved)) return Placed::AsIs;
  record.points_S.clear();
  record.points_W = std::move(moved.points_W);
  record.origins_W = std::move(moved.origins_W);
  record.attributes = std::move(moved.attributes);
  record.excluded_points = moved.excluded;
  record.unposed_points = moved.unposed;
  record.deskewed = !of.registered;
  return Placed::ByTimes;
}

void moveRegistered(const Eigen::Isometry3d& T, std::vector<Eigen::Vector3d>& points) {
  if (T.matrix().isIdentity(0)) return;
  for (Eigen::Vector3d& p : points) {
    if (!p.isZero(0)) p = T * p;
  }
}

void placeAtOnce(bool registered, const std::optional<Eigen::AlignedBox3d>& exclude_box_S, ScanRecord& record) {
  if (exclude_box_S)
    record.excluded_points =
        registered
            ? leaveOutInside(*exclude_box_S, record.T_W_S.inverse(Eigen::Isometry), record.points_W, record.attributes)
            : leaveOutInside(*exclude_box_S, Eigen::Isometry3d::Identity(), record.points_S, record.attributes);
  if (!registered) return;
  record.origins_W = {record.T_W_S.translation()};
  placeNoReturns(record);
}

void placeNoReturns(ScanRecord& record) {
  const std::size_t origins = record.origins_W.size();
  for (std::size_t n = 0; n < record.points_W.size(); ++n) {
    if (record.points_W[n].isZero(0)) record.points_W[n] = record.origins_W[origins == 1 ? 0 : n];
  }
}

}  // namespace accessvdb::io

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/paper_triggers.h"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace accessvdb::internal {

PaperTriggers::PaperTriggers(const PointScorer& scorer) : scorer_(scorer), random_(scorer.params().update.seed) {}

void PaperTriggers::note(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                         std::span<const std::span<const DistanceChange>> distances) {
  if (p_L.empty()) return;
  last_distance_m_.grow(scorer_.points().size(), std::numeric_limits<float>::quiet_NaN());
  noteDistances(distances);
  noteSample(p_L, q_L);
  noteMotion(q_L.front());
}

PaperRequests PaperTriggers::take() { return {jumped_.take(), sampled_.take(), std::exchange(blocked_, false)}; }

/// (i) The TSDF at a point's voxel changed by more than 2 v since the last frame. Not limited to points that were hit
/// again: when a surface recedes, its returns move with it.
void PaperTriggers::noteDistances(std::span<const std::span<const DistanceChange>> distances) {
  const PointStore& points = scorer_.points();
  const DistanceCode& code = scorer_.reads().distance_code;
  const auto unobserved_m = static_cast<float>(scorer_.params().tsdf.truncation_distance_m);
  const auto bound_m = static_cast<float>(2 * scorer_.params().tsdf.voxel_size_m);
  tbb::enumerable_thread_specific<std::vector<std::uint32_t>> jumped;
  tbb::parallel_for(std::size_t{0}, distances.size(), [&](std::size_t part) {
    std::vector<std::uint32_t>& found = jumped.local();
    for (const DistanceChange& leaf : distances[part]) {
      const std::uint32_t block = points.index().blockAt(parentOf(leaf.origin_ijk));
      if (block == kNone) continue;
      for (const std::uint32_t id : points.index().blocks()[block].ids) {
        const std::uint32_t packed = leaf.packed[bitInParent(points.voxelOf(points.first_L(id)))];
        const float now_m = code.observed(packed) ? code.distance_m(packed) : unobserved_m;
        float& last_m = last_distance_m_[id];
        if (std::fabs(now_m - last_m) > bound_m) found.push_back(id);  // false for a new point: NaN
        last_m = now_m;
      }
    }
  });
  for (const auto& found : jumped) jumped_.add(found);
  // Points whose voxel the scan did not change.
  for (; known_points_ < points.size(); ++known_points_) {
    float& last_m = last_distance_m_[known_points_];
    if (std::isnan(last_m)) last_m = unobserved_m;
  }
}

/// (ii) Points within r_u of up to 256 voxels written by this scan. There is no list of written voxels: each voxel is
/// drawn from the region of a random return, so voxels that many returns wrote to are drawn more often.
void PaperTriggers::noteSample(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L) {
  const FieldParams& params = scorer_.params();
  const PointStore& points = scorer_.points();
  std::vector<Eigen::Vector3d> voxels_L(static_cast<std::size_t>(params.update.changed_voxel_sample));
  for (Eigen::Vector3d& x_L : voxels_L) {
    const std::size_t i = draw(p_L.size());
    x_L = drawWrittenVoxel(p_L[i], q_L[q_L.size() == 1 ? 0 : i]);
  }
  const double radius_m = params.update.changed_voxel_radius_voxels * params.tsdf.voxel_size_m;
  const auto reach = static_cast<std::int32_t>(params.update.changed_voxel_radius_voxels / 8) + 1;  // blocks
  tbb::enumerable_thread_specific<std::vector<std::uint32_t>> sampled;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, voxels_L.size(), 8), [&](const auto& range) {
    std::vector<std::uint32_t>& found = sampled.local();
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      const Eigen::Vector3d& x_L = voxels_L[n];
      const Index3 leaf = parentOf(points.voxelOf(x_L));
      const auto takeNear = [&](std::uint32_t b) {
        for (const std::uint32_t id : points.index().blocks()[b].ids) {
          if ((points.first_L(id).cast<double>() - x_L).norm() <= radius_m) found.push_back(id);
        }
      };
      points.index().forEachBlock({leaf[0] - reach, leaf[1] - reach, leaf[2] - reach},
                                  {leaf[0] + reach, leaf[1] + reach, leaf[2] + reach}, takeNear);
    }
  });
  for (const auto& found : sampled) sampled_.add(found);
}

Eigen::Vector3d PaperTriggers::drawWrittenVoxel(const Eigen::Vector3f& p_L, const Eigen::Vector3f& q_L) {
  const TsdfParams& tsdf = scorer_.params().tsdf;
  const double v = tsdf.voxel_size_m;
  const Index3 centre = scorer_.points().voxelOf(p_L);
  const int reach = static_cast<int>(std::ceil(tsdf.truncation_distance_m / v));
  const auto side = static_cast<std::size_t>(2 * reach + 1);
  // The cones fill 1/40 of the cube, so this ends long before the limit; the return's own voxel is always written.
  constexpr int kMostTries = 4000;
  for (int tries = 0; tries < kMostTries; ++tries) {
    Eigen::Vector3d x_L;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      x_L[static_cast<Eigen::Index>(axis)] = (centre[axis] + static_cast<int>(draw(side)) - reach) * v;
    }
    if (writes(p_L.cast<double>(), q_L.cast<double>(), x_L)) return x_L;
  }
  return Eigen::Vector3d(centre[0], centre[1], centre[2]) * v;
}

/// docs/PAPER_MAP.md, "Integration", up to rounding.
bool PaperTriggers::writes(const Eigen::Vector3d& p_L, const Eigen::Vector3d& q_L, const Eigen::Vector3d& x_L) const {
  const TsdfParams& tsdf = scorer_.params().tsdf;
  const Eigen::Vector3d from_return = x_L - p_L, ray = p_L - q_L;
  if (from_return.lpNorm<Eigen::Infinity>() > tsdf.truncation_distance_m) return false;
  if (tsdf.region == UpdateRegion::FullCube) {
    const Eigen::Vector3d from_sensor = x_L - q_L;
    return from_sensor.dot(ray) > tsdf.cone_cos_min * from_sensor.norm() * ray.norm();
  }
  return from_return.norm() <= tsdf.voxel_size_m ||
         std::fabs(from_return.dot(ray)) > tsdf.cone_cos_min * from_return.norm() * ray.norm();
}

/// (iii) The sensor moved: every point that is not accessible may have gained a side it was observed from. The map is
/// not windowed, so this covers all points of the map.
void PaperTriggers::noteMotion(const Eigen::Vector3f& q_L) {
  // Measured from the last time it fired, not from the last scan: slow motion adds up.
  const auto bound_m = static_cast<float>(scorer_.params().update.requeue_motion_m);
  if (last_sensor_L_ && !((q_L - *last_sensor_L_).norm() > bound_m)) return;
  blocked_ = blocked_ || last_sensor_L_.has_value();
  last_sensor_L_ = q_L;
}

std::size_t PaperTriggers::draw(std::size_t count) {
  return static_cast<std::size_t>(static_cast<double>(random_() >> 11) * 0x1.0p-53 * static_cast<double>(count));
}

std::uint64_t PaperTriggers::bytes() const { return last_distance_m_.bytes() + jumped_.bytes() + sampled_.bytes(); }

}  // namespace accessvdb::internal

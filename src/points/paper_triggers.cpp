// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/paper_triggers.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace accessvdb::internal {

PaperTriggers::PaperTriggers(const PointScorer& scorer) : scorer_(scorer), random_(scorer.params().update.seed) {}

void PaperTriggers::fire(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                         const Enqueue& enqueue) {
  if (p_L.empty()) return;
  fireOnDistance(p_L, enqueue);
  fireOnSample(p_L, q_L, enqueue);
  fireOnMotion(q_L.front(), enqueue);
}

/// (i) The TSDF at a point's voxel changed by more than 2 v since the last frame. Not only at points that were hit
/// again: a surface that moves back takes its returns with it.
void PaperTriggers::fireOnDistance(std::span<const Eigen::Vector3f> p_L, const Enqueue& enqueue) {
  last_distance_m_.grow(scorer_.points().size(), std::numeric_limits<float>::quiet_NaN());
  const std::vector<std::uint32_t> ids = pointsInWrittenBlocks(p_L);
  std::vector<float> distances_m(ids.size());
  scorer_.reads().distances(ids, distances_m);
  const auto bound_m = static_cast<float>(2 * scorer_.params().tsdf.voxel_size_m);
  for (std::size_t n = 0; n < ids.size(); ++n) {
    float& last_m = last_distance_m_[ids[n]];
    if (std::fabs(distances_m[n] - last_m) > bound_m) enqueue(ids[n]);  // false at birth: NaN
    last_m = distances_m[n];
  }
}

std::vector<std::uint32_t> PaperTriggers::pointsInWrittenBlocks(std::span<const Eigen::Vector3f> p_L) {
  const PointStore& points = scorer_.points();
  block_stamp_.grow(points.index().blocks().size(), 0);
  ++scan_;
  const auto tau_m = static_cast<float>(scorer_.params().tsdf.truncation_distance_m);
  const Eigen::Vector3f reach_m(tau_m, tau_m, tau_m);
  std::vector<std::uint32_t> ids;
  for (const Eigen::Vector3f& p : p_L) {
    points.index().forEachBlock(parentOf(points.voxelOf(p - reach_m)), parentOf(points.voxelOf(p + reach_m)),
                                [&](std::uint32_t b) {
                                  if (block_stamp_[b] == scan_) return;
                                  block_stamp_[b] = scan_;
                                  const std::span<const std::uint32_t> of_block = points.index().blocks()[b].ids;
                                  ids.insert(ids.end(), of_block.begin(), of_block.end());
                                });
  }
  std::sort(ids.begin(), ids.end());
  return ids;
}

/// (ii) Points within r_u of up to 256 voxels written by this scan. There is no list of written voxels: a voxel is
/// drawn from the region of a random return, so voxels that many returns wrote to are drawn more often (as in SPEC c).
void PaperTriggers::fireOnSample(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                                 const Enqueue& enqueue) {
  const FieldParams& params = scorer_.params();
  const PointStore& points = scorer_.points();
  const double radius_m = params.update.changed_voxel_radius_voxels * params.tsdf.voxel_size_m;
  const auto reach = static_cast<std::int32_t>(params.update.changed_voxel_radius_voxels / 8) + 1;  // blocks
  for (int n = 0; n < params.update.changed_voxel_sample; ++n) {
    const std::size_t i = draw(p_L.size());
    const Eigen::Vector3d x_L = drawWrittenVoxel(p_L[i], q_L[q_L.size() == 1 ? 0 : i]);
    const Index3 leaf = parentOf(points.voxelOf(x_L.cast<float>()));
    const auto enqueueNear = [&](std::uint32_t b) {
      for (const std::uint32_t id : points.index().blocks()[b].ids) {
        if ((points.first_L(id).cast<double>() - x_L).norm() <= radius_m) enqueue(id);
      }
    };
    points.index().forEachBlock({leaf[0] - reach, leaf[1] - reach, leaf[2] - reach},
                                {leaf[0] + reach, leaf[1] + reach, leaf[2] + reach}, enqueueNear);
  }
}

Eigen::Vector3d PaperTriggers::drawWrittenVoxel(const Eigen::Vector3f& p_L, const Eigen::Vector3f& q_L) {
  const TsdfParams& tsdf = scorer_.params().tsdf;
  const double v = tsdf.voxel_size_m;
  const Index3 centre = scorer_.points().voxelOf(p_L);
  const int reach = static_cast<int>(std::ceil(tsdf.truncation_distance_m / v));
  const auto side = static_cast<std::size_t>(2 * reach + 1);
  // The cones fill 1/40 of the cube, so this ends long before the bound; the return's own voxel is always written.
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

/// SPEC a.3, up to rounding.
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

/// (iii) The sensor moved: every point that is not accessible may have gained an observation side. The map is not
/// windowed, so these are all points of the map.
void PaperTriggers::fireOnMotion(const Eigen::Vector3f& q_L, const Enqueue& enqueue) {
  if (!last_sensor_L_) {
    last_sensor_L_ = q_L;
    return;
  }
  // Since the last firing, not since the last scan: slow motion adds up.
  if (!((q_L - *last_sensor_L_).norm() > static_cast<float>(scorer_.params().update.requeue_motion_m))) return;
  last_sensor_L_ = q_L;
  // Points beyond are new: they are in the queue anyway.
  for (std::uint32_t id = 0; id < scorer_.device().size(); ++id) {
    if (scorer_.record(id).label != PointLabel::Accessible) enqueue(id);
  }
}

std::size_t PaperTriggers::draw(std::size_t count) {
  return static_cast<std::size_t>(static_cast<double>(random_() >> 11) * 0x1.0p-53 * static_cast<double>(count));
}

std::uint64_t PaperTriggers::bytes() const { return last_distance_m_.bytes() + block_stamp_.bytes(); }

}  // namespace accessvdb::internal

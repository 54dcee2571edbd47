// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/neighbourhood.h"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>

#include "hostdev/surface_normal.h"

namespace accessvdb::internal {
namespace {

/// Points that share their seen directions (SPEC: the 10 nearest, the point itself among them).
constexpr std::size_t kViewNeighbours = 10;
constexpr std::size_t kFewestForNormal = 3;

}  // namespace

NeighbourhoodSearch::NeighbourhoodSearch(const PointStore& points, const FieldParams& resolved)
    : points_(points),
      k_(resolved.scoring.neighbours),
      join_views_(resolved.scoring.join_neighbour_views),
      voxel_size_m_(resolved.tsdf.voxel_size_m),
      radius_m_(std::max(10.0 * resolved.tsdf.voxel_size_m, 0.1)) {}

void NeighbourhoodSearch::compute(std::span<const std::uint32_t> ids, std::span<Neighbourhood> out) const {
  // Group by block: points of one block share what is gathered around it.
  struct Job {
    std::uint32_t block, slot;
  };
  std::vector<Job> jobs(ids.size());
  for (std::size_t n = 0; n < ids.size(); ++n) jobs[n] = {points_.blockOf(ids[n]), static_cast<std::uint32_t>(n)};
  tbb::parallel_sort(jobs.begin(), jobs.end(), [](const Job& a, const Job& b) {
    return a.block != b.block ? a.block < b.block : a.slot < b.slot;
  });
  std::vector<std::size_t> begin;
  for (std::size_t n = 0; n < jobs.size(); ++n) {
    if (n == 0 || jobs[n].block != jobs[n - 1].block) begin.push_back(n);
  }
  begin.push_back(jobs.size());
  struct Scratch {
    NearestPoints nearest;
    std::vector<std::uint32_t> ids;
  };
  tbb::enumerable_thread_specific<Scratch> scratches([this] {
    return Scratch{NearestPoints(points_, static_cast<std::size_t>(k_), voxel_size_m_, radius_m_), {}};
  });
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, begin.size() - 1), [&](const auto& range) {
    Scratch& scratch = scratches.local();
    for (std::size_t g = range.begin(); g != range.end(); ++g) {
      scratch.ids.clear();
      for (std::size_t n = begin[g]; n < begin[g + 1]; ++n) scratch.ids.push_back(ids[jobs[n].slot]);
      const Index3& leaf = points_.index().blocks()[jobs[begin[g]].block].leaf;
      scratch.nearest.forEach(leaf, scratch.ids, [&](std::uint32_t n, std::span<const NearPoint> nearest) {
        out[jobs[begin[g] + n].slot] = fromNearest(scratch.ids[n], nearest, scratch.nearest.positions());
      });
    }
  });
}

Neighbourhood NeighbourhoodSearch::fromNearest(std::uint32_t id, std::span<const NearPoint> nearest,
                                               const NearPositions& positions) const {
  Neighbourhood result;
  result.reach_m = nearest.size() < static_cast<std::size_t>(k_)
                       ? static_cast<float>(radius_m_)
                       : static_cast<float>(std::sqrt(nearest.back().squared_distance));
  result.seen = points_.seen(id);
  if (join_views_) {
    for (std::size_t n = 0; n < std::min(nearest.size(), kViewNeighbours); ++n) {
      result.seen = result.seen | points_.seen(nearest[n].id);
    }
  }
  if (nearest.size() < kFewestForNormal) return result;

  const Eigen::Vector3d centre = points_.pca_L(id).cast<double>();
  const auto offset = [&](const NearPoint& near) -> Eigen::Vector3d {
    const std::size_t at = near.position;
    return Eigen::Vector3f(positions.x()[at], positions.y()[at], positions.z()[at]).cast<double>() - centre;
  };
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();  // relative to the point, so that nothing cancels
  for (const NearPoint& near : nearest) mean += offset(near);
  mean /= static_cast<double>(nearest.size());
  kernels::Covariance covariance;
  for (const NearPoint& near : nearest) {
    const Eigen::Vector3d e = offset(near) - mean;
    covariance.xx += e.x() * e.x();
    covariance.xy += e.x() * e.y();
    covariance.xz += e.x() * e.z();
    covariance.yy += e.y() * e.y();
    covariance.yz += e.y() * e.z();
    covariance.zz += e.z() * e.z();
  }
  kernels::smallestEigenvector(covariance, result.normal_L.data());
  const Eigen::Vector3d to_sensor = points_.meanSensor_L(id) - points_.first_L(id).cast<double>();
  if (result.normal_L.cast<double>().dot(to_sensor) < 0) result.normal_L = -result.normal_L;
  return result;
}

}  // namespace accessvdb::internal

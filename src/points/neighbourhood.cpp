// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/neighbourhood.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "hostdev/surface_normal.h"

namespace accessvdb::internal {
namespace {

/// Points that share their seen directions (SPEC: the 10 nearest, the point itself among them).
constexpr std::size_t kViewNeighbours = 10;
constexpr std::size_t kFewestForNormal = 3;

struct Candidate {
  double squared_distance;
  std::uint32_t id;
  bool operator<(const Candidate& other) const {
    return squared_distance != other.squared_distance ? squared_distance < other.squared_distance : id < other.id;
  }
};

struct NearBlock {
  double squared_distance;  ///< between the boxes of the two blocks
  std::uint32_t block;
};

}  // namespace

struct NeighbourhoodSearch::Scratch {
  std::vector<NearBlock> near;
  std::vector<Candidate> nearest;  ///< max-heap of the best so far
};

NeighbourhoodSearch::NeighbourhoodSearch(const PointStore& points, const FieldParams& resolved)
    : points_(points),
      k_(resolved.scoring.neighbours),
      join_views_(resolved.scoring.join_neighbour_views),
      voxel_size_m_(resolved.tsdf.voxel_size_m),
      radius_m_(std::max(10.0 * resolved.tsdf.voxel_size_m, 0.1)) {}

void NeighbourhoodSearch::compute(std::span<const std::uint32_t> ids, std::span<Neighbourhood> out) const {
  // Group by block: points of one block share the list of blocks around it.
  struct Job {
    std::uint32_t block, slot;
  };
  std::vector<Job> jobs(ids.size());
  tbb::parallel_for(std::size_t{0}, ids.size(), [&](std::size_t n) {
    jobs[n] = {points_.index().blockAt(parentOf(points_.voxelOf(points_.first_L(ids[n])))),
               static_cast<std::uint32_t>(n)};
  });
  std::sort(jobs.begin(), jobs.end(),
            [](const Job& a, const Job& b) { return a.block != b.block ? a.block < b.block : a.slot < b.slot; });
  std::vector<std::size_t> begin;
  std::vector<std::uint32_t> slots(jobs.size());
  for (std::size_t n = 0; n < jobs.size(); ++n) {
    if (n == 0 || jobs[n].block != jobs[n - 1].block) begin.push_back(n);
    slots[n] = jobs[n].slot;
  }
  begin.push_back(jobs.size());
  tbb::enumerable_thread_specific<Scratch> scratches;
  tbb::parallel_for(std::size_t{0}, begin.size() - 1, [&](std::size_t g) {
    const std::span<const std::uint32_t> group(slots.data() + begin[g], begin[g + 1] - begin[g]);
    computeBlock(points_.index().blocks()[jobs[begin[g]].block].leaf, ids, group, out, scratches.local());
  });
}

void NeighbourhoodSearch::computeBlock(const Index3& leaf, std::span<const std::uint32_t> ids,
                                       std::span<const std::uint32_t> slots, std::span<Neighbourhood> out,
                                       Scratch& scratch) const {
  const auto& blocks = points_.index().blocks();
  const double radius_voxels = radius_m_ / voxel_size_m_;
  const auto reach = static_cast<std::int32_t>((radius_voxels + 8.0) / 8.0) + 1;
  scratch.near.clear();
  points_.index().forEachBlock(
      {leaf[0] - reach, leaf[1] - reach, leaf[2] - reach}, {leaf[0] + reach, leaf[1] + reach, leaf[2] + reach},
      [&](std::uint32_t block) {
        double squared = 0;
        for (std::size_t axis = 0; axis < 3; ++axis) {
          const double gap = std::max(0, std::abs(blocks[block].leaf[axis] - leaf[axis]) - 1) * 8.0;
          squared += gap * gap;
        }
        squared *= voxel_size_m_ * voxel_size_m_ * (1 - 2e-6);  // positions are rounded to float32
        if (squared <= radius_m_ * radius_m_) scratch.near.push_back({squared, block});
      });
  std::sort(scratch.near.begin(), scratch.near.end(), [](const NearBlock& a, const NearBlock& b) {
    return a.squared_distance != b.squared_distance ? a.squared_distance < b.squared_distance : a.block < b.block;
  });

  const auto k = static_cast<std::size_t>(k_);
  const double squared_radius = radius_m_ * radius_m_;
  for (const std::uint32_t slot : slots) {
    const std::uint32_t id = ids[slot];
    const Eigen::Vector3f& centre = points_.pca_L(id);
    auto& nearest = scratch.nearest;
    nearest.clear();
    for (const NearBlock& near : scratch.near) {
      if (nearest.size() == k && near.squared_distance > nearest.front().squared_distance) break;
      const PointBlock& block = blocks[near.block];
      if (nearest.size() == k) {  // distance from the point to the block's box
        double squared = 0;
        for (std::size_t axis = 0; axis < 3; ++axis) {
          const double low = (block.leaf[axis] * 8 - 0.5) * voxel_size_m_, high = low + 8 * voxel_size_m_;
          const auto x = static_cast<double>(centre[static_cast<Eigen::Index>(axis)]);
          const double gap = std::max({0.0, low - x, x - high}) * (1 - 1e-6);  // positions are rounded to float32
          squared += gap * gap;
        }
        if (squared > nearest.front().squared_distance) continue;
      }
      for (const std::uint32_t other : block.ids) {
        const Eigen::Vector3f& p = points_.pca_L(other);
        const double dx = static_cast<double>(p.x()) - static_cast<double>(centre.x());
        const double dy = static_cast<double>(p.y()) - static_cast<double>(centre.y());
        const double dz = static_cast<double>(p.z()) - static_cast<double>(centre.z());
        const Candidate candidate = {dx * dx + dy * dy + dz * dz, other};
        if (candidate.squared_distance > squared_radius) continue;
        if (nearest.size() < k) {
          nearest.push_back(candidate);
          std::push_heap(nearest.begin(), nearest.end());
        } else if (candidate < nearest.front()) {
          std::pop_heap(nearest.begin(), nearest.end());
          nearest.back() = candidate;
          std::push_heap(nearest.begin(), nearest.end());
        }
      }
    }
    std::sort_heap(nearest.begin(), nearest.end());

    Neighbourhood& result = out[slot];
    result = {};
    result.reach_m = nearest.size() < k ? static_cast<float>(radius_m_)
                                        : static_cast<float>(std::sqrt(nearest.back().squared_distance));
    result.seen = points_.seen(id);
    if (join_views_) {
      for (std::size_t n = 0; n < std::min(nearest.size(), kViewNeighbours); ++n) {
        result.seen = result.seen | points_.seen(nearest[n].id);
      }
    }
    if (nearest.size() < kFewestForNormal) continue;

    Eigen::Vector3d mean = Eigen::Vector3d::Zero();  // relative to the point, so that nothing cancels
    for (const Candidate& c : nearest) mean += points_.pca_L(c.id).cast<double>() - centre.cast<double>();
    mean /= static_cast<double>(nearest.size());
    kernels::Covariance covariance;
    for (const Candidate& c : nearest) {
      const Eigen::Vector3d e = (points_.pca_L(c.id).cast<double>() - centre.cast<double>()) - mean;
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
  }
}

}  // namespace accessvdb::internal

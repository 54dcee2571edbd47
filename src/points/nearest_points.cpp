// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/nearest_points.h"

#include <algorithm>
#include <cmath>

#include "points/ids_in_box.h"
#include "processor/prefetch.h"

namespace accessvdb::internal {
namespace {

/// Positions and means are rounded to float32, so far from the origin they may lie this far outside their voxel: at
/// 2^20 voxels, the largest distance a map allows, float32 has 8 steps per voxel.
constexpr double kRoundingVoxels = 0.25;
/// An offset in steps is off by half a step per axis; a ball in metres contains all points of a ball smaller by this.
constexpr double kRoundingSteps = 1;

}  // namespace

NearestPoints::NearestPoints(const PointStore& points, std::size_t k, std::size_t named, double voxel_size_m,
                             double radius_m, const NearKernels& kernels)
    : points_(points),
      kernels_(kernels),
      k_(k),
      named_(named),
      voxel_size_m_(voxel_size_m),
      radius_m_(radius_m),
      steps_per_m_(kernels::neighbourStepsPerMetre(radius_m)),
      radius_squared_(kernels::neighbourRadiusSquared(radius_m)),
      most_rings_(static_cast<std::int32_t>(std::ceil((radius_m / voxel_size_m + 2 * kRoundingVoxels) / 8))),
      guess_(static_cast<std::int64_t>(0.5 * static_cast<double>(k) * voxel_size_m * voxel_size_m * steps_per_m_ *
                                       steps_per_m_)) {}

void NearestPoints::gather(const Index3& leaf, std::int32_t rings) {
  const auto& blocks = points_.index().blocks();
  positions_.clear();
  ids_.clear();
  complete_ = rings == most_rings_;
  const double most_voxels = radius_m_ / voxel_size_m_ + 2 * kRoundingVoxels;
  points_.index().forEachBlock({leaf[0] - rings, leaf[1] - rings, leaf[2] - rings},
                               {leaf[0] + rings, leaf[1] + rings, leaf[2] + rings},
                               [&](std::uint32_t b, const Index3& at) {
                                 const auto squared = static_cast<double>(gapSquared(at, leaf));
                                 if (squared > most_voxels * most_voxels) return;
                                 for (const std::uint32_t id : blocks[b].ids) {
                                   const Eigen::Vector3f& p = points_.pca_L(id);
                                   positions_.add(p.x(), p.y(), p.z());
                                   ids_.push_back(id);
                                 }
                               });
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<Eigen::Index>(axis);
    box_low_[a] = ((leaf[axis] - rings) * 8 - 0.5 + kRoundingVoxels) * voxel_size_m_;
    box_high_[a] = ((leaf[axis] + rings + 1) * 8 - 0.5 - kRoundingVoxels) * voxel_size_m_;
  }
  found_.resize(positions_.lanes() + NearPositions::kLanes);
}

/// Gathers what is as near to these points as the last neighbours were.
void NearestPoints::gatherNear(std::span<const std::uint32_t> ids) {
  const double reach_voxels = std::sqrt(static_cast<double>(guess_)) / steps_per_m_ / voxel_size_m_;
  const auto margin = static_cast<std::int32_t>(std::min(reach_voxels + 2 * kRoundingVoxels, 8.0)) + 1;
  Index3 low = points_.voxelOf(points_.first_L(ids.front())), high = low;
  for (const std::uint32_t id : ids) {
    const Index3 voxel = points_.voxelOf(points_.first_L(id));
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], voxel[axis]);
      high[axis] = std::max(high[axis], voxel[axis]);
    }
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<Eigen::Index>(axis);
    low[axis] -= margin;
    high[axis] += margin;
    box_low_[a] = (low[axis] - 0.5 + kRoundingVoxels) * voxel_size_m_;
    box_high_[a] = (high[axis] + 0.5 - kRoundingVoxels) * voxel_size_m_;
  }
  positions_.clear();
  ids_.clear();
  complete_ = false;
  // Blocks and their ids are scattered in memory, as points are.
  const auto& blocks = points_.index().blocks();
  near_blocks_.clear();
  points_.index().forEachBlock(parentOf(low), parentOf(high), [&](std::uint32_t b) {
    prefetchRead(&blocks[b], sizeof(PointBlock));
    near_blocks_.push_back(b);
  });
  constexpr std::size_t kBlocksAhead = 3;
  const auto prefetchIds = [&](std::size_t n) {
    if (n < near_blocks_.size()) prefetchRead(blocks[near_blocks_[n]].ids.data());
  };
  for (std::size_t n = 0; n < kBlocksAhead; ++n) prefetchIds(n);
  for (std::size_t n = 0; n < near_blocks_.size(); ++n) {
    prefetchIds(n + kBlocksAhead);
    forEachIdInBox(blocks[near_blocks_[n]], low, high, [this](std::uint32_t id) { ids_.push_back(id); });
  }
  constexpr std::size_t kAhead = 12;  // points are scattered in memory
  for (std::size_t n = 0; n < std::min(kAhead, ids_.size()); ++n) prefetchRead(&points_.pca_L(ids_[n]));
  for (std::size_t n = 0; n < ids_.size(); ++n) {
    if (n + kAhead < ids_.size()) prefetchRead(&points_.pca_L(ids_[n + kAhead]));
    const Eigen::Vector3f& p = points_.pca_L(ids_[n]);
    positions_.add(p.x(), p.y(), p.z());
  }
  found_.resize(positions_.lanes() + NearPositions::kLanes);
}

/// Measures the gathered points that are about as near as this. @return how many are within the squared distance
std::size_t NearestPoints::measure(const Eigen::Vector3f& centre, std::int64_t squared) {
  const double most_m = (std::sqrt(static_cast<double>(squared)) + kRoundingSteps) / steps_per_m_;
  const auto bound = static_cast<float>(most_m * most_m * (1 + 2.5 * static_cast<double>(kFloatSlack)));
  offsets_.count = kernels_.within(positions_.x(), positions_.y(), positions_.z(), positions_.lanes(), centre.data(),
                                   bound, found_.data());
  const std::size_t room = (offsets_.count + OffsetArrays::kPadded - 1) / OffsetArrays::kPadded * OffsetArrays::kPadded;
  if (near_m_.size() < 3 * room) {
    near_m_.resize(3 * room);
    steps_.resize(4 * room);
    listed_.resize(room);
  }
  offsets_.x_m = near_m_.data(), offsets_.y_m = offsets_.x_m + room, offsets_.z_m = offsets_.y_m + room;
  offsets_.x = steps_.data(), offsets_.y = offsets_.x + room, offsets_.z = offsets_.y + room;
  offsets_.squared = offsets_.z + room;
  for (std::size_t n = 0; n < offsets_.count; ++n) {
    const std::uint32_t at = found_[n];
    offsets_.x_m[n] = positions_.x()[at], offsets_.y_m[n] = positions_.y()[at], offsets_.z_m[n] = positions_.z()[at];
  }
  kernels_.measure(offsets_, centre.data(), steps_per_m_);
  return kernels_.count_within(offsets_, static_cast<double>(squared));
}

/// The least squared distance within which there are n measured points or more.
/// @param most  a squared distance  @param within  the number of points within it, at least n
double NearestPoints::nth(std::size_t n, double most, std::size_t within) const {
  double below = -1;  // fewer than n are within this
  std::size_t fewer = 0;
  for (int step = 0; within > n && most - below > 1; ++step) {
    // On a surface the number of points grows with the squared distance. Halving now and then makes sure of an end.
    const double share =
        step % 4 == 3 ? 0.5 : (static_cast<double>(n - fewer) + 0.5) / static_cast<double>(within - fewer);
    const double middle = std::clamp(std::floor(below + (most - below) * share), below + 1, most - 1);
    const std::size_t count = kernels_.count_within(offsets_, middle);
    if (count >= n) {
      most = middle, within = count;
    } else {
      below = middle, fewer = count;
    }
  }
  return most;
}

/// Points with lower ids are nearer than others at the same distance.
/// @param squared  their squared distance  @param more  how many of them no longer count
void NearestPoints::dropFarthest(double squared, std::size_t more) {
  std::size_t ties = 0;
  for (std::size_t n = 0; n < offsets_.count; ++n) {
    if (offsets_.squared[n] == squared) listed_[ties++] = static_cast<std::uint32_t>(n);
  }
  std::sort(listed_.begin(), listed_.begin() + static_cast<std::ptrdiff_t>(ties),
            [this](std::uint32_t a, std::uint32_t b) { return ids_[found_[a]] > ids_[found_[b]]; });
  for (std::size_t n = 0; n < more; ++n) offsets_.squared[listed_[n]] = OffsetArrays::kDropped;
}

/// Names the nearest. @param most  the squared distance of the farthest neighbour  @param within  number of neighbours
void NearestPoints::name(double most, std::size_t within) {
  const double bound = within > named_ ? nth(named_, most, within) : most;
  const std::size_t count = kernels_.list_within(offsets_, bound, listed_.data());
  const auto end = listed_.begin() + static_cast<std::ptrdiff_t>(count);
  if (count > named_) {  // some are equally far away
    std::sort(listed_.begin(), end, [this](std::uint32_t a, std::uint32_t b) {
      const double of_a = offsets_.squared[a], of_b = offsets_.squared[b];
      return of_a != of_b ? of_a < of_b : ids_[found_[a]] < ids_[found_[b]];
    });
  }
  names_.resize(std::min(count, named_));
  for (std::size_t n = 0; n < names_.size(); ++n) names_[n] = ids_[found_[listed_[n]]];
}

/// Fills neighbours_. @return false if points not yet gathered may be nearer
bool NearestPoints::find(std::uint32_t id) {
  const Eigen::Vector3f& centre = points_.pca_L(id);
  const Eigen::Vector3d c = centre.cast<double>();
  const double covered_m = std::min((c - box_low_).minCoeff(), (box_high_ - c).minCoeff());
  const bool all_gathered = complete_ || covered_m >= radius_m_;
  const double covered_steps = std::floor(covered_m * steps_per_m_) - kRoundingSteps;
  if (!all_gathered && covered_steps < 0) return false;
  const std::int64_t limit = all_gathered
                                 ? radius_squared_
                                 : static_cast<std::int64_t>(covered_steps) * static_cast<std::int64_t>(covered_steps);
  std::int64_t squared = std::min(guess_, limit);
  std::size_t within = 0;
  for (;;) {
    within = measure(centre, squared);
    if (within >= k_) break;
    if (squared >= limit) {
      if (!all_gathered) return false;
      break;
    }
    // On a surface the number of points grows with the squared distance.
    const double missing = 1.3 * static_cast<double>(k_) / static_cast<double>(within + 1);
    const double larger = static_cast<double>(squared + 1) * std::clamp(missing, 1.3, 4.0);
    squared = std::min(static_cast<std::int64_t>(larger), limit);
  }
  const double most = within > k_ ? nth(k_, static_cast<double>(squared), within) : static_cast<double>(squared);
  OffsetSums sums = kernels_.sums_within(offsets_, most);
  if (const auto count = static_cast<std::size_t>(sums.count); count > k_) {  // some are equally far away
    dropFarthest(most, count - k_);
    sums = kernels_.sums_within(offsets_, most);
  }
  within = static_cast<std::size_t>(sums.count);
  const auto whole = [](double sum) { return static_cast<std::int64_t>(sum); };
  neighbours_.sums = {sums.count,     whole(sums.x),  whole(sums.y),  whole(sums.z),  whole(sums.xx),
                      whole(sums.xy), whole(sums.xz), whole(sums.yy), whole(sums.yz), whole(sums.zz)};
  neighbours_.farthest = within < k_ ? radius_squared_ : whole(sums.farthest);
  name(most, within);
  neighbours_.nearest = names_;
  if (within == k_) guess_ = neighbours_.farthest + neighbours_.farthest / 3;
  return true;
}

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/nearest_points.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace accessvdb::internal {
namespace {

/// Positions are float32 and means are rounded to it, so far from the origin they may lie this far outside of their
/// voxel: at 2^20 voxels, the most that a map allows, float32 has 8 steps a voxel.
constexpr double kRoundingVoxels = 0.25;
/// Above it, sorting costs less than comparing all with all.
constexpr std::size_t kMostRanked = 256;

}  // namespace

NearestPoints::NearestPoints(const PointStore& points, std::size_t k, double voxel_size_m, double radius_m,
                             const NearKernels& kernels)
    : points_(points),
      kernels_(kernels),
      k_(k),
      voxel_size_m_(voxel_size_m),
      radius_m_(radius_m),
      most_rings_(static_cast<std::int32_t>(std::ceil((radius_m / voxel_size_m + 2 * kRoundingVoxels) / 8))),
      guess_(0.5 * static_cast<double>(k) * voxel_size_m * voxel_size_m) {}

void NearestPoints::gather(const Index3& leaf, std::int32_t rings) {
  const auto& blocks = points_.index().blocks();
  positions_.clear();
  ids_.clear();
  complete_ = rings == most_rings_;
  const double most_voxels = radius_m_ / voxel_size_m_ + 2 * kRoundingVoxels;
  points_.index().forEachBlock({leaf[0] - rings, leaf[1] - rings, leaf[2] - rings},
                               {leaf[0] + rings, leaf[1] + rings, leaf[2] + rings}, [&](std::uint32_t b) {
                                 double squared = 0;  // voxels between the two blocks
                                 for (std::size_t axis = 0; axis < 3; ++axis) {
                                   const int blocks_between = std::abs(blocks[b].leaf[axis] - leaf[axis]) - 1;
                                   const double gap = std::max(0, blocks_between) * 8.0;
                                   squared += gap * gap;
                                 }
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

/// All gathered points up to a squared distance.
void NearestPoints::list(const Eigen::Vector3f& centre, double squared) {
  const auto bound = static_cast<float>(squared * (1 + 2.5 * static_cast<double>(kFloatSlack)));
  const std::size_t count = kernels_.within(positions_.x(), positions_.y(), positions_.z(), positions_.lanes(),
                                            centre.data(), bound, found_.data());
  const auto cx = static_cast<double>(centre.x()), cy = static_cast<double>(centre.y());
  const auto cz = static_cast<double>(centre.z());
  unsorted_.clear();
  for (std::size_t n = 0; n < count; ++n) {
    const std::uint32_t at = found_[n];
    const double dx = static_cast<double>(positions_.x()[at]) - cx;
    const double dy = static_cast<double>(positions_.y()[at]) - cy;
    const double dz = static_cast<double>(positions_.z()[at]) - cz;
    const double exact = dx * dx + dy * dy + dz * dz;
    if (exact <= squared) unsorted_.push_back({exact, ids_[at], at});
  }
}

/// Fills nearest_. @return false where points that are not gathered may be nearer
bool NearestPoints::find(std::uint32_t id) {
  const Eigen::Vector3f& centre = points_.pca_L(id);
  const Eigen::Vector3d c = centre.cast<double>();
  const double covered_m = std::min((c - box_low_).minCoeff(), (box_high_ - c).minCoeff());
  const bool all_gathered = complete_ || covered_m >= radius_m_;
  if (!all_gathered && covered_m < 0) return false;
  const double limit = all_gathered ? radius_m_ * radius_m_ : covered_m * covered_m;
  double squared = std::min(guess_, limit);
  for (;;) {
    list(centre, squared);
    if (unsorted_.size() >= k_) break;
    if (squared >= limit) {
      if (!all_gathered) return false;
      break;
    }
    // On a surface the number of points grows with the squared distance.
    const double missing = 1.3 * static_cast<double>(k_) / static_cast<double>(unsorted_.size() + 1);
    squared = std::min(squared * std::clamp(missing, 1.3, 4.0), limit);
  }
  sortNearest();
  if (nearest_.size() == k_) {
    guess_ = 1.3 * nearest_.back().squared_distance;
    // A guess of nothing would never grow.
    guess_ = std::max(guess_, 1e-3 * voxel_size_m_ * voxel_size_m_);
  }
  return true;
}

void NearestPoints::sortNearest() {
  const std::size_t count = unsorted_.size();
  if (count > kMostRanked) {
    nearest_ = unsorted_;
    std::sort(nearest_.begin(), nearest_.end(), [](const NearPoint& a, const NearPoint& b) {
      return a.squared_distance != b.squared_distance ? a.squared_distance < b.squared_distance : a.id < b.id;
    });
  } else {
    keys_.resize(count);
    ranks_.resize(count);
    // Doubles that are not negative are in the order of their bits.
    for (std::size_t n = 0; n < count; ++n) keys_[n] = std::bit_cast<std::int64_t>(unsorted_[n].squared_distance);
    kernels_.ranks(keys_.data(), count, ranks_.data());
    nearest_.assign(count, NearPoint{0, kNone, 0});
    for (std::size_t n = 0; n < count; ++n) {
      NearPoint point = unsorted_[n];
      auto at = static_cast<std::size_t>(ranks_[n]);
      for (; nearest_[at].id != kNone; ++at) {  // equal distances: by id
        if (point.id < nearest_[at].id) std::swap(point, nearest_[at]);
      }
      nearest_[at] = point;
    }
  }
  if (nearest_.size() > k_) nearest_.resize(k_);
}

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/coarse_to_fine.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace accessvdb::internal {
namespace {

constexpr double kCoarseStep_deg = 20, kFineWindow_deg = 25;
/// Resolved points within this radius share their best direction.
constexpr float kResolvedRadius_m = 0.3f;

std::int32_t blocksApart(const Index3& a, const Index3& b) {
  return std::max({std::abs(a[0] - b[0]), std::abs(a[1] - b[1]), std::abs(a[2] - b[2])});
}

}  // namespace

kernels::CoarseToFine coarseToFineRule(const FieldParams& resolved) {
  const int directions = resolved.approach.num_directions;
  kernels::CoarseToFine rule;
  rule.on = resolved.approach.coarse_to_fine;
  rule.num_directions = directions;
  rule.window = static_cast<int>(kFineWindow_deg * directions / 360);
  rule.radius_m = kResolvedRadius_m;
  const int step = std::max(1, static_cast<int>(std::lround(kCoarseStep_deg * directions / 360)));
  for (int d = 0; d < directions; d += step) rule.coarse.set(d);
  return rule;
}

CandidateDirections::CandidateDirections(const PointScorer& scorer, std::uint16_t collision_limit)
    : scorer_(scorer), rule_(coarseToFineRule(scorer.params())), collision_limit_(collision_limit) {}

bool CandidateDirections::resolved(std::uint32_t id) const {
  const PointRecord& record = scorer_.record(id);
  return kernels::isResolved(record.score, record.direction, collision_limit_);
}

void CandidateDirections::beginBatch() {
  any_resolved_ = false;
  if (!rule_.on) return;
  // Points added after the last update have no record yet.
  const std::uint32_t known = std::min(scorer_.points().size(), scorer_.device().size());
  for (std::uint32_t id = 0; id < known && !any_resolved_; ++id) any_resolved_ = resolved(id);
}

DirectionMask CandidateDirections::candidates(std::uint32_t id) const {
  return rule_.candidates(rule_.on && any_resolved_ ? directionOfNearestResolved(id) : kNoDirection);
}

std::uint16_t CandidateDirections::directionOfNearestResolved(std::uint32_t id) const {
  const PointStore& points = scorer_.points();
  const Eigen::Vector3f& p_L = points.first_L(id);
  const Index3 leaf = parentOf(points.voxelOf(p_L));
  const auto block_m = static_cast<float>(8 * scorer_.params().tsdf.voxel_size_m);
  const auto last_ring = static_cast<std::int32_t>(kResolvedRadius_m / block_m) + 1;
  float least_m = kResolvedRadius_m;
  std::uint32_t nearest = kNone;
  std::int32_t ring = 0;
  const auto visit = [&](std::uint32_t b) {
    const PointBlock& block = points.index().blocks()[b];
    if (blocksApart(block.leaf, leaf) != ring) return;
    for (const std::uint32_t other : block.ids) {
      // Points added after the last update have no record yet.
      if (other == id || other >= scorer_.device().size()) continue;
      if (!resolved(other)) continue;
      const float distance_m = kernels::distanceBetween_m(points.first_L(other).data(), p_L.data());
      if (distance_m < least_m || (distance_m == least_m && other < nearest)) {
        least_m = distance_m;
        nearest = other;
      }
    }
  };
  for (; ring <= last_ring; ++ring) {
    if (static_cast<float>(ring - 1) * block_m > least_m) break;  // this ring is at least that far away
    points.index().forEachBlock({leaf[0] - ring, leaf[1] - ring, leaf[2] - ring},
                                {leaf[0] + ring, leaf[1] + ring, leaf[2] + ring}, visit);
  }
  return nearest == kNone ? kNoDirection : scorer_.record(nearest).direction;
}

}  // namespace accessvdb::internal

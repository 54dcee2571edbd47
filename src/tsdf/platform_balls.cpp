// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/platform_balls.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <tuple>
#include <utility>

#include "hostdev/return_leaves.h"

namespace accessvdb::internal {
namespace {

using Voxel = std::array<std::int32_t, 3>;

Voxel voxelOf(const ReturnRay& ball) { return {ball.base_ijk[0], ball.base_ijk[1], ball.base_ijk[2]}; }

/// Of all positions in a voxel the least one, so that the order of the returns does not matter.
std::vector<ReturnRay> oneOfEachVoxel(std::span<const Eigen::Vector3f> q_L, double voxel_size_m) {
  std::vector<ReturnRay> balls;
  for (const Eigen::Vector3f& q : q_L) balls.push_back(ballAround(q.data(), voxel_size_m));
  const auto key = [](const ReturnRay& ball) {
    return std::tuple(voxelOf(ball), ball.offset[0], ball.offset[1], ball.offset[2]);
  };
  std::ranges::sort(balls, {}, key);
  const auto same = std::ranges::unique(balls, {}, voxelOf);
  balls.erase(same.begin(), same.end());
  return balls;
}

bool collides(const PackedMap& map, const RegionShape& shape, const ReturnRay& ball) {
  ConstPackedAccessor accessor(map.tree());
  bool found = false;
  kernels::forEachLeafAround(ball, shape.ball_radius, [&](const std::int32_t* at) {
    const openvdb::Coord origin(at[0] * 8, at[1] * 8, at[2] * 8);
    const PackedLeaf* leaf = accessor.probeConstLeaf(origin);
    const LeafBits* left_out = map.leftOut().find(origin);
    if (found || (leaf == nullptr && left_out == nullptr)) return;
    LeafBits bits = leaf == nullptr ? LeafBits{} : map.collidingIn(*leaf);
    if (left_out != nullptr)
      for (std::size_t word = 0; word < 8; ++word) bits[word] |= (*left_out)[word];
    const std::int32_t origin_ijk[3] = {origin.x(), origin.y(), origin.z()};
    for (int voxel = 0; voxel < 512 && !found; ++voxel) {
      found = (bits[static_cast<std::size_t>(voxel >> 6)] >> (voxel & 63) & 1) != 0 &&
              kernels::isInBall(origin_ijk, voxel, ball, shape.ball_radius * shape.ball_radius);
    }
  });
  return found;
}

}  // namespace

PlatformBalls platformBalls(const PackedMap& map, const RegionShape& shape, std::span<const ReturnRay> rays,
                            std::span<const Eigen::Vector3f> q_L) {
  PlatformBalls all;
  if (!(shape.ball_radius > 0)) return all;
  all.balls = oneOfEachVoxel(q_L, map.params().voxel_size_m);
  // A return within the ball is of the platform, or the ball is larger than it.
  const auto isHit = [&](const ReturnRay& ball) {
    return std::ranges::any_of(rays, [&](const ReturnRay& ray) {
      float sum = 0;
      for (int axis = 0; axis < 3; ++axis) {
        const float e =
            static_cast<float>(ray.base_ijk[axis] - ball.base_ijk[axis]) + ray.offset[axis] - ball.offset[axis];
        sum += e * e;
      }
      return sum <= shape.ball_radius * shape.ball_radius;
    });
  };
  const std::size_t count = all.balls.size();
  std::erase_if(all.balls, [&](const ReturnRay& ball) { return isHit(ball) || collides(map, shape, ball); });
  all.contradicted = count - all.balls.size();
  return all;
}

}  // namespace accessvdb::internal

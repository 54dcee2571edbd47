// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/corridor_offsets.h"

#include <algorithm>
#include <cmath>

namespace accessvdb::internal {
namespace {

/// Rounding of float32 positions far from the origin, in voxels; ScanGate admits coordinates up to where it is 0.16.
constexpr double kCorridorRounding = 0.25;

}  // namespace

CorridorOffsets::CorridorOffsets(const kernels::ApproachView& approach, double voxel_size_m, std::int32_t most_reach) {
  if (kernels::isWide(approach.num_directions)) return;
  const auto samples = static_cast<std::size_t>(approach.num_directions) * static_cast<std::size_t>(approach.num_arm);
  const auto voxels = [&](std::size_t n, std::size_t axis) {
    return static_cast<double>(approach.arm_offsets[3 * n + axis]) / voxel_size_m;
  };
  const auto low = [](double offset) { return static_cast<std::int32_t>(std::floor(offset - kCorridorRounding)); };
  const auto high = [](double offset) { return static_cast<std::int32_t>(std::ceil(offset + kCorridorRounding)); };
  double farthest = 0;
  for (std::size_t n = 0; n < samples; ++n) {
    if (approach.arm_offsets[3 * n + 2] != 0) return;
    farthest = std::max({farthest, std::abs(voxels(n, 0)), std::abs(voxels(n, 1))});
  }
  if (samples == 0 || !(farthest < most_reach - 1)) return;
  reach_ = high(farthest);
  const auto size = static_cast<std::size_t>(2 * reach_ + 1);
  table_.assign(size * size, kernels::DirectionMask{});
  for (std::size_t n = 0; n < samples; ++n) {
    const int d = static_cast<int>(n / static_cast<std::size_t>(approach.num_arm));
    for (std::int32_t x = low(voxels(n, 0)); x <= high(voxels(n, 0)); ++x) {
      for (std::int32_t y = low(voxels(n, 1)); y <= high(voxels(n, 1)); ++y) {
        table_[static_cast<std::size_t>(x + reach_) * size + static_cast<std::size_t>(y + reach_)].set(d);
      }
    }
  }
}

}  // namespace accessvdb::internal

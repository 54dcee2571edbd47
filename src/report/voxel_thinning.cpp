// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "report/voxel_thinning.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace accessvdb::internal {

std::size_t VoxelThinning::CellHash::operator()(const Cell& cell) const noexcept {
  std::uint64_t hash = static_cast<std::uint64_t>(cell.reason) + (std::uint64_t{cell.tools} << 8);
  for (const double index : cell.ijk) {
    // Constants of the finaliser of SplitMix64.
    hash = (hash ^ std::bit_cast<std::uint64_t>(index)) * 0xbf58476d1ce4e5b9u;
    hash = (hash ^ (hash >> 27)) * 0x94d049bb133111ebu;
  }
  return static_cast<std::size_t>(hash ^ (hash >> 31));
}

bool VoxelThinning::keep(const SurfacePoint& point) {
  if (cell_m_ > 0) {
    Cell cell = {{}, point.reason, point.tools};
    for (int axis = 0; axis < 3; ++axis) {
      // + 0.0 turns -0 into 0, which hashes alike.
      cell.ijk[static_cast<std::size_t>(axis)] = std::floor((point.position_W[axis] - origin_W_[axis]) / cell_m_) + 0.0;
    }
    if (!cells_.insert(cell).second) return false;
  }
  ++kept_;
  return true;
}

double thinningCell_m(const FieldFolder& folder, std::uint64_t most) {
  if (folder.points <= most) return 0;
  // On a surface the number of cells goes with the square of their edge.
  const double surplus = static_cast<double>(folder.points) / static_cast<double>(most);
  double cell_m = folder.voxel_size_m * std::sqrt(surplus);
  for (;;) {
    VoxelThinning thinning(folder.origin_W, cell_m);
    std::uint64_t seen = 0;
    folder.visit([&](const PointFile&, const SurfacePoint& point, std::span<const std::int32_t>) {
      ++seen;
      thinning.keep(point);
      return thinning.kept() <= most;
    });
    if (thinning.kept() <= most) return cell_m;
    const double unseen = static_cast<double>(folder.points) / static_cast<double>(seen);
    cell_m *= std::clamp(std::sqrt(unseen), 1.1, 2.0);
  }
}

}  // namespace accessvdb::internal

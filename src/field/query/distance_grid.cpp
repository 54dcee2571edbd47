// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Exact Euclidean distances, one axis after the other (Saito and Toriwaki 1994).
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/distance_field.h"
#include "accessvdb/error.h"
#include "accessvdb/tsdf_volume.h"
#include "tsdf/leaf_facts.h"

namespace accessvdb {
namespace {

constexpr double kMostVoxels = 134217728;
constexpr double kMostReach = 512;
constexpr std::int32_t kNothingNear = 1 << 29;

/// Voxels low .. high of the map.
struct GridBox {
  std::array<std::int32_t, 3> low, high;
  [[nodiscard]] std::size_t size(std::size_t axis) const {
    return static_cast<std::size_t>(high[axis] - low[axis] + 1);
  }
  [[nodiscard]] std::size_t index(std::int32_t x, std::int32_t y, std::int32_t z) const {
    return (static_cast<std::size_t>(x - low[0]) * size(1) + static_cast<std::size_t>(y - low[1])) * size(2) +
           static_cast<std::size_t>(z - low[2]);
  }
};

/// Calls visit(x, y, z, collides, known) for each voxel of the box that a leaf or what was left out says something of.
template <typename Visit>
void forEachFact(const internal::PackedMap& map, const GridBox& box, const Visit& visit) {
  const auto perLeaf = [&](const openvdb::Coord& origin, const LeafChange& facts) {
    for (std::int32_t x = std::max(origin.x(), box.low[0]); x <= std::min(origin.x() + 7, box.high[0]); ++x) {
      for (std::int32_t y = std::max(origin.y(), box.low[1]); y <= std::min(origin.y() + 7, box.high[1]); ++y) {
        for (std::int32_t z = std::max(origin.z(), box.low[2]); z <= std::min(origin.z() + 7, box.high[2]); ++z) {
          const auto word = static_cast<std::size_t>(x & 7);
          const std::uint64_t bit = std::uint64_t{1} << (8 * (y & 7) + (z & 7));
          const bool collides = (facts.collides_on[word] & bit) != 0;
          visit(x, y, z, collides, collides || (facts.arm_free_on[word] & bit) != 0);
        }
      }
    }
  };
  tbb::parallel_for(box.low[0] >> 3, (box.high[0] >> 3) + 1, [&](std::int32_t slice) {
    internal::ConstPackedAccessor accessor(map.tree());
    for (std::int32_t y = box.low[1] & ~7; y <= box.high[1]; y += 8) {
      for (std::int32_t z = box.low[2] & ~7; z <= box.high[2]; z += 8) {
        const openvdb::Coord origin(8 * slice, y, z);
        if (const auto facts = internal::factsAt(map, accessor, origin)) perLeaf(origin, *facts);
      }
    }
  });
}

/// Rows of squares along one axis: each becomes the least of all within reach, plus the square of the way there.
/// @param stride  between two voxels along the axis  @param runs  of `length` voxels that are side by side in memory
void lowerAlong(std::vector<std::int32_t>& squares, std::size_t count, std::size_t stride, std::size_t first,
                std::size_t length, std::int32_t reach, std::vector<std::int32_t>& room) {
  room.resize(count * length);
  for (std::size_t n = 0; n < count; ++n) {
    std::int32_t* const to = room.data() + n * length;
    std::fill_n(to, length, kNothingNear);
    const std::size_t begin = n > static_cast<std::size_t>(reach) ? n - static_cast<std::size_t>(reach) : 0,
                      end = std::min(count, n + static_cast<std::size_t>(reach) + 1);
    for (std::size_t m = begin; m < end; ++m) {
      const auto d = static_cast<std::int32_t>(m > n ? m - n : n - m), more = d * d;
      const std::int32_t* const from = squares.data() + first + m * stride;
      for (std::size_t k = 0; k < length; ++k) to[k] = std::min(to[k], from[k] + more);
    }
  }
  for (std::size_t n = 0; n < count; ++n)
    std::copy_n(room.data() + n * length, length, squares.data() + first + n * stride);
}

GridBox boxOf(const AccessibilityField& field, const Eigen::Vector3d& low_W, const Eigen::Vector3d& high_W) {
  const double v = field.params().tsdf.voxel_size_m;
  const Eigen::Vector3d low = (low_W - field.origin_W()) / v, high = (high_W - field.origin_W()) / v;
  constexpr double kFarthest = 1 << 30;
  if (!(low.array() <= high.array()).all() || !(low.array().abs() < kFarthest).all() ||
      !(high.array().abs() < kFarthest).all()) {
    throw InvalidArgument("distance.box", "", "the box is empty, not finite or outside the map's range",
                          "Give two corners in the world frame, the lower one first");
  }
  GridBox box = {};
  for (Eigen::Index axis = 0; axis < 3; ++axis) {  // the centre of voxel i is at i
    box.low[static_cast<std::size_t>(axis)] = static_cast<std::int32_t>(std::floor(low[axis] + 0.5));
    box.high[static_cast<std::size_t>(axis)] = static_cast<std::int32_t>(std::floor(high[axis] + 0.5));
  }
  return box;
}

}  // namespace

DistanceGrid distanceGrid(const AccessibilityField& field, const Eigen::Vector3d& low_W, const Eigen::Vector3d& high_W,
                          double most_m) {
  const double v = field.params().tsdf.voxel_size_m, reach_voxels = most_m / v * (1 + 1e-9);
  if (!(reach_voxels >= 1)) {
    throw InvalidArgument("distance.range", std::to_string(most_m) + " m", "is less than a voxel",
                          "Use " + std::to_string(v) + " m or more");
  }
  const GridBox box = boxOf(field, low_W, high_W);
  GridBox wide = box;
  double voxels = 1;
  for (std::size_t axis = 0; axis < 3; ++axis) voxels *= static_cast<double>(box.size(axis)) + 2 * reach_voxels + 1;
  if (!(voxels <= kMostVoxels) || reach_voxels > kMostReach) {
    throw ResourceLimit("distance.size", "",
                        "the box with " + std::to_string(most_m) + " m around it has too many voxels",
                        "Use a smaller box or range: at most 2^27 voxels, and 512 voxels of range");
  }
  const auto reach = static_cast<std::int32_t>(reach_voxels);
  for (std::size_t axis = 0; axis < 3; ++axis) wide.low[axis] -= reach, wide.high[axis] += reach;
  DistanceGrid grid;
  grid.voxel_size_m = v;
  grid.most_m = most_m;
  grid.first_W = field.origin_W() + v * Eigen::Vector3d(box.low[0], box.low[1], box.low[2]);
  for (std::size_t axis = 0; axis < 3; ++axis) grid.size[axis] = box.size(axis);
  grid.known.assign(grid.size[0] * grid.size[1] * grid.size[2], 0);
  const std::size_t X = wide.size(0), Y = wide.size(1), Z = wide.size(2);
  std::vector<std::int32_t> squares(X * Y * Z, kNothingNear);
  const int threads = field.params().threads;
  tbb::task_arena arena(threads > 0 ? threads : static_cast<int>(tbb::task_arena::automatic));
  arena.execute([&] {
    forEachFact(field.volume().packed(), wide,
                [&](std::int32_t x, std::int32_t y, std::int32_t z, bool collides, bool known) {
                  if (collides) squares[wide.index(x, y, z)] = 0;
                  const bool inside = x >= box.low[0] && x <= box.high[0] && y >= box.low[1] && y <= box.high[1] &&
                                      z >= box.low[2] && z <= box.high[2];
                  if (inside) grid.known[box.index(x, y, z)] = known ? 1 : 0;
                });
    tbb::parallel_for(std::size_t{0}, X, [&](std::size_t x) {
      std::vector<std::int32_t> room;
      for (std::size_t y = 0; y < Y; ++y) lowerAlong(squares, Z, 1, (x * Y + y) * Z, 1, reach, room);
      lowerAlong(squares, Y, Z, x * Y * Z, Z, reach, room);
    });
    tbb::parallel_for(std::size_t{0}, Y, [&](std::size_t y) {
      std::vector<std::int32_t> room;
      lowerAlong(squares, X, Y * Z, y * Z, Z, reach, room);
    });
  });
  grid.distance_m.resize(grid.known.size());
  std::size_t n = 0;
  for (std::int32_t x = box.low[0]; x <= box.high[0]; ++x) {
    for (std::int32_t y = box.low[1]; y <= box.high[1]; ++y) {
      for (std::int32_t z = box.low[2]; z <= box.high[2]; ++z) {
        const double distance_m = v * std::sqrt(static_cast<double>(squares[wide.index(x, y, z)]));
        grid.distance_m[n++] = static_cast<float>(std::min(distance_m, most_m));
      }
    }
  }
  return grid;
}

}  // namespace accessvdb

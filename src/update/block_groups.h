// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Groups of blocks (launch/point_delta.h): small voxels make many blocks, and flips affect adjacent blocks in nearly
/// the same way. So a backend looks at cubes of blocks at once.
#pragma once

#include <algorithm>
#include <cstdint>

#include "launch/point_delta.h"
#include "points/place_map.h"
#include "points/surface_index.h"

namespace accessvdb::internal {

/// Edge of a group, in leaves, as a power of two: as many as fit into 8 cm. Larger groups are fewer, but each has to
/// consider more directions than its points need; with voxels of 10 mm and more, each block is a group.
inline int blockGroupLog2(double voxel_size_m) {
  constexpr double kEdge_m = 0.08, kRounding = 1 + 1e-6;
  int log2 = 0;
  while (log2 < kernels::kMaxGroupLog2 && (16 << log2) * voxel_size_m <= kEdge_m * kRounding) ++log2;
  return log2;
}

/// Numbers groups in the order in which their blocks arrive.
class BlockGroups {
 public:
  explicit BlockGroups(int group_log2) : log2_(group_log2) {}

  /// @param block  a new one; blocks are numbered from 0. @return number of its group
  std::uint32_t add(std::uint32_t block, const Index3& leaf) {
    // If each block is a group, there is nothing to look up.
    const std::uint32_t group =
        log2_ == 0 ? block : number_of_.insert({leaf[0] >> log2_, leaf[1] >> log2_, leaf[2] >> log2_}, size_).first;
    size_ = std::max(size_, group + 1);
    return group;
  }
  [[nodiscard]] std::uint32_t size() const { return size_; }
  [[nodiscard]] std::uint64_t bytes() const { return number_of_.bytes(); }

 private:
  int log2_;
  PlaceMap number_of_;
  std::uint32_t size_ = 0;
};

}  // namespace accessvdb::internal

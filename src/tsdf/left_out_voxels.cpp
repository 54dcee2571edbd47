// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/left_out_voxels.h"

#include <algorithm>

namespace accessvdb::internal {

void LeftOutVoxels::set(const openvdb::Coord& origin_ijk, const LeafBits& voxels) {
  if (voxels == LeafBits{}) {
    leaves_.erase(origin_ijk);
  } else if (keeps_) {
    leaves_[origin_ijk] = voxels;
  }
}

std::vector<std::pair<openvdb::Coord, LeafBits>> LeftOutVoxels::inOrder() const {
  std::vector<std::pair<openvdb::Coord, LeafBits>> leaves(leaves_.begin(), leaves_.end());
  std::sort(leaves.begin(), leaves.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  return leaves;
}

void LeftOutVoxels::stopKeeping() {
  leaves_.clear();
  keeps_ = false;
}

std::uint64_t LeftOutVoxels::bytes() const {
  constexpr std::uint64_t kNodeBytes = sizeof(std::pair<const openvdb::Coord, LeafBits>) + 2 * sizeof(void*);
  return leaves_.size() * kNodeBytes + leaves_.bucket_count() * sizeof(void*);
}

}  // namespace accessvdb::internal

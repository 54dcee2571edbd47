// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "change/gone_points.h"

#include <algorithm>
#include <bit>

namespace accessvdb::internal {
namespace {

/// Points of some voxels.
struct PointsAround {
  std::vector<std::uint32_t> inside;  ///< whose own voxel it is
  std::vector<std::uint32_t> near;    ///< in it or beside it; some of them several times

  void add(const SurfaceIndex& index, const Index3& leaf, const LeafBits& voxels) {
    for (std::int32_t x = 0; x < 8; ++x) {
      for (std::uint64_t left = voxels[static_cast<std::size_t>(x)]; left != 0; left &= left - 1) {
        const int yz = std::countr_zero(left);
        const Index3 voxel = {8 * leaf[0] + x, 8 * leaf[1] + (yz >> 3), 8 * leaf[2] + (yz & 7)};
        for (std::int32_t n = 0; n < 27; ++n) {
          const std::uint32_t id = index.find({voxel[0] + n / 9 - 1, voxel[1] + n / 3 % 3 - 1, voxel[2] + n % 3 - 1});
          if (id == kNone) continue;
          near.push_back(id);
          if (n == 13) inside.push_back(id);
        }
      }
    }
  }
};

}  // namespace

void GonePoints::grow(std::uint32_t size) {
  if (size <= least_weight_.size()) return;
  least_weight_.resize(size, 0);
  gone_.resize(size, 0);
}

void GonePoints::markGone(std::span<const std::uint32_t> ids) {
  for (const std::uint32_t id : ids) {
    count_ += gone_[id] == 0 ? 1 : 0;
    gone_[id] = 1;
  }
  changed_ = changed_ || !ids.empty();
}

void GonePoints::noteRemoved(const PointStore& points, const VoxelSet& voxels, bool as_free) {
  PointsAround around;
  for (const LeafVoxels& part : voxels) {
    const openvdb::Coord& origin = part.origin_ijk;
    around.add(points.index(), {origin.x() >> 3, origin.y() >> 3, origin.z() >> 3}, part.bits);
  }
  for (const std::uint32_t id : around.near) {
    if (id < size()) least_weight_[id] = 0;
  }
  if (!as_free || around.inside.empty()) return;
  grow(*std::max_element(around.inside.begin(), around.inside.end()) + 1);
  markGone(around.inside);
}

void GonePoints::noteOpened(const PointStore& points, std::span<const OpenedLeaf> opened, const ReadWeights& read) {
  PointsAround around;
  for (const OpenedLeaf& leaf : opened) around.add(points.index(), leaf.leaf, leaf.voxels);
  std::vector<std::uint32_t>& near = around.near;
  std::sort(near.begin(), near.end());
  near.erase(std::unique(near.begin(), near.end()), near.end());
  if (near.empty()) return;
  grow(near.back() + 1);
  std::vector<std::uint16_t> weights(near.size());
  read(near, weights);
  for (std::size_t n = 0; n < near.size(); ++n) {
    least_weight_[near[n]] = std::max(least_weight_[near[n]], weights[n]);
  }
  markGone(around.inside);
}

void GonePoints::noteReturns(std::span<const std::uint32_t> touched) {
  if (count_ == 0) return;
  for (const std::uint32_t id : touched) {
    if (!isGone(id)) continue;
    gone_[id] = 0;
    --count_;
    changed_ = true;
  }
}

void GonePoints::publish() {
  if (!changed_) return;
  published_ = gone_;
  changed_ = false;
}

void GonePoints::restore(std::uint32_t id, std::uint16_t least_weight, bool gone) {
  grow(id + 1);
  least_weight_[id] = least_weight;
  gone_[id] = gone ? 1 : 0;
  count_ += gone ? 1 : 0;
  changed_ = true;
}

}  // namespace accessvdb::internal

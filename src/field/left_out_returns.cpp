// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/left_out_returns.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "field/state/state_reader.h"

namespace accessvdb::internal {

const GatedScan& LeftOutReturns::placed(const GatedScan& scan, FrameStats& stats) {
  if (map_.grows()) return scan;
  placed_.p_L.clear();
  placed_.q_L.clear();
  placed_.attributes.clear();
  const std::size_t width = points_.attributes().columns();
  if (scan.q_L.size() == 1) placed_.q_L = scan.q_L;
  ConstPackedAccessor accessor(map_.tree());
  for (std::size_t n = 0; n < scan.p_L.size(); ++n) {
    const Index3 voxel = points_.voxelOf(scan.p_L[n]);
    if (!map_.hasPlaceFor({voxel[0], voxel[1], voxel[2]}, accessor)) continue;
    placed_.p_L.push_back(scan.p_L[n]);
    if (scan.q_L.size() != 1) placed_.q_L.push_back(scan.q_L[n]);
    const auto own = scan.attributes.begin() + static_cast<std::ptrdiff_t>(n * width);
    placed_.attributes.insert(placed_.attributes.end(), own, own + static_cast<std::ptrdiff_t>(width));
  }
  if (placed_.p_L.empty()) placed_.q_L.assign(1, scan.q_L[0]);
  stats.left_out_returns = scan.p_L.size() - placed_.p_L.size();
  return placed_;
}

void LeftOutReturns::note(std::span<const openvdb::Coord> leaves) {
  if (leaves.empty()) return;
  LeftOutVoxels& voxels = map_.leftOut();
  if (voxels.keeps()) left_out_.noteLeaves(leaves);
  const double v = map_.params().voxel_size_m;
  const auto close = [&](const openvdb::Coord& origin) {
    const Eigen::Vector3d middle_L = v * (Eigen::Vector3d(origin.x(), origin.y(), origin.z()).array() + 3.5).matrix();
    left_out_.close(gate_.origin_W() + middle_L, 4 * v);
  };
  if (voxels.leaves() > voxels.most()) {
    for (const auto& [origin, bits] : voxels.inOrder()) close(origin);
    voxels.stopKeeping();
    left_out_.forgetLeaves();
  } else if (!voxels.keeps()) {
    std::ranges::for_each(leaves, close);
  }
}

void LeftOutReturns::keepShut(std::span<const OpenedLeaf> opened) {
  LeftOutVoxels& voxels = map_.leftOut();
  if (voxels.empty()) return;
  // All are judged before any is left out: none depends on another.
  std::vector<std::pair<openvdb::Coord, LeafBits>> shut;
  for (const OpenedLeaf& leaf : opened) {
    const LeafBits near = left_out_.nearLeftOut(leaf, voxels);
    if (near == LeafBits{}) continue;
    shut.emplace_back(openvdb::Coord(8 * leaf.leaf[0], 8 * leaf.leaf[1], 8 * leaf.leaf[2]), near);
  }
  for (auto& [origin, bits] : shut) {
    if (const LeafBits* before = voxels.find(origin)) {
      for (std::size_t x = 0; x < 8; ++x) bits[x] |= (*before)[x];
    }
    voxels.set(origin, bits);
    left_out_.noteLeaves(std::span(&origin, 1));
  }
}

void LeftOutReturns::restore(StateReader& state, Mirrors& mirrors) {
  LeftOutVoxels& voxels = map_.leftOut();
  state.readLeftOut(voxels, left_out_);
  std::vector<openvdb::Coord> leaves;
  std::vector<LeafChange> blocked;
  for (const auto& [origin, bits] : voxels.inOrder()) {
    leaves.push_back(origin);
    LeafChange& change = blocked.emplace_back();
    change.origin_ijk = {origin.x(), origin.y(), origin.z()};
    change.collides_on = change.arm_free_off = bits;
  }
  left_out_.noteLeaves(leaves);
  if (!blocked.empty()) mirrors.take(blocked, {});
}

}  // namespace accessvdb::internal

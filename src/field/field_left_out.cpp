// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Returns that are left out because the map may not grow, or because a program had no time for them: what blocks in
/// their place (docs/design/left_out.md, "What is left out blocks").
#include <algorithm>

#include "field/field_impl.h"

namespace accessvdb {

void AccessibilityField::stopGrowing(std::size_t most_left_out_leaves) {
  if (impl_->params.tsdf.region == UpdateRegion::Projective) {
    throw InvalidArgument("projective.limit", "", "the projective baseline cannot keep a map from growing",
                          "Use another UpdateRegion");
  }
  impl_->steps.requireWhole();
  impl_->volume.packed().stopGrowing(most_left_out_leaves);
}

void AccessibilityField::leaveOut(std::span<const Eigen::Vector3d> centres_W, double radius_m) {
  if (!(radius_m >= 0 && radius_m <= internal::LeftOutPoints::kLargestRadius_m)) {
    throw InvalidArgument("left_out.radius", "radius_m", "must be 0 .. 1000000 m", "Pass one in metres");
  }
  impl_->steps.run([&] {
    impl_->labels_current = false;
    for (const Eigen::Vector3d& centre_W : centres_W) impl_->left_out.close(centre_W, radius_m);
  });
}

bool AccessibilityField::grows() const { return impl_->volume.packed().grows(); }

/// In a map that no longer grows: the returns of a scan for which it has a place.
const internal::GatedScan& AccessibilityField::Impl::placedReturns(const internal::GatedScan& scan, FrameStats& stats) {
  placed_scan.p_L.clear();
  placed_scan.q_L.clear();
  if (scan.q_L.size() == 1) placed_scan.q_L = scan.q_L;
  internal::ConstPackedAccessor accessor(volume.packed().tree());
  for (std::size_t n = 0; n < scan.p_L.size(); ++n) {
    const internal::Index3 voxel = points.voxelOf(scan.p_L[n]);
    if (!volume.packed().hasPlaceFor({voxel[0], voxel[1], voxel[2]}, accessor)) continue;
    placed_scan.p_L.push_back(scan.p_L[n]);
    if (scan.q_L.size() != 1) placed_scan.q_L.push_back(scan.q_L[n]);
  }
  if (placed_scan.p_L.empty()) placed_scan.q_L.assign(1, scan.q_L[0]);
  stats.left_out_returns = scan.p_L.size() - placed_scan.p_L.size();
  return placed_scan;
}

/// @param leaves  in which more was left out
void AccessibilityField::Impl::noteLeftOut(std::span<const openvdb::Coord> leaves) {
  internal::LeftOutVoxels& voxels = volume.packed().leftOut();
  if (voxels.keeps()) left_out.noteLeaves(leaves);
  const double v = params.tsdf.voxel_size_m;
  const auto close = [&](const openvdb::Coord& origin) {
    const Eigen::Vector3d middle_L = v * (Eigen::Vector3d(origin.x(), origin.y(), origin.z()).array() + 3.5).matrix();
    left_out.close(gate.origin_W() + middle_L, 4 * v);
  };
  if (voxels.leaves() > voxels.most()) {
    for (const auto& [origin, bits] : voxels.inOrder()) close(origin);
    voxels.stopKeeping();
    left_out.forgetLeaves();
  } else if (!voxels.keeps()) {
    std::ranges::for_each(leaves, close);
  }
}

/// What has gone is judged by the returns around, and where some are missing, a ray that opens a voxel may be wrong. So
/// before the map opens such voxels, they are left out: they collided, and go on to do so.
void AccessibilityField::Impl::keepShut(std::span<const internal::OpenedLeaf> opened) {
  internal::LeftOutVoxels& voxels = volume.packed().leftOut();
  // All are judged before any is left out: none depends on another.
  std::vector<std::pair<openvdb::Coord, LeafBits>> shut;
  for (const internal::OpenedLeaf& leaf : opened) {
    const LeafBits near = left_out.nearLeftOut(leaf, voxels);
    if (near == LeafBits{}) continue;
    shut.emplace_back(openvdb::Coord(8 * leaf.leaf[0], 8 * leaf.leaf[1], 8 * leaf.leaf[2]), near);
  }
  for (auto& [origin, bits] : shut) {
    if (const LeafBits* before = voxels.find(origin)) {
      for (std::size_t x = 0; x < 8; ++x) bits[x] |= (*before)[x];
    }
    voxels.set(origin, bits);
    left_out.noteLeaves(std::span(&origin, 1));
  }
}

void AccessibilityField::Impl::restoreLeftOut(internal::StateReader& state) {
  internal::LeftOutVoxels& voxels = volume.packed().leftOut();
  state.readLeftOut(voxels, left_out);
  std::vector<openvdb::Coord> leaves;
  std::vector<LeafChange> blocked;
  for (const auto& [origin, bits] : voxels.inOrder()) {
    leaves.push_back(origin);
    LeafChange& change = blocked.emplace_back();
    change.origin_ijk = {origin.x(), origin.y(), origin.z()};
    change.collides_on = change.arm_free_off = bits;
  }
  left_out.noteLeaves(leaves);
  if (!blocked.empty()) mirror.apply(blocked);
}

}  // namespace accessvdb

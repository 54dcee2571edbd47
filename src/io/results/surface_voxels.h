// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Converts surface points to voxels of a grid.
#pragma once

#include <tbb/parallel_for.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "accessvdb/surface_points.h"
#include "accessvdb/write_options.h"
#include "vdb/standard_grids.h"

namespace accessvdb::internal {

/// The voxel of a position (voxel_rule.h): the one whose centre, indexToWorld(ijk), is nearest.
/// @param p_L  local frame, metres. @throws InvalidArgument for a position that has no voxel (non-finite, too far)
[[nodiscard]] openvdb::Coord voxelAt(const Eigen::Vector3d& p_L, double voxel_size_m);

/// Linear transform of all our grids: voxel size v, voxel (0,0,0) at the local origin; rotated if y is up.
[[nodiscard]] openvdb::math::Transform::Ptr fieldTransform(double voxel_size_m, io::UpAxis up = io::UpAxis::Z);

/// A vector of the local (z up) frame in the frame of the file: itself, or (x, z, -y).
[[nodiscard]] openvdb::Vec3f toFileFrame(const Eigen::Vector3f& v_L, io::UpAxis up);

/// "z" or "y", as in the metadata.
[[nodiscard]] const char* name(io::UpAxis up);

/// Surface points sorted by leaf, so that grids can be built leaf by leaf on all threads.
/// If two points share a voxel, the one with the lower index is kept.
class SurfaceVoxels {
 public:
  struct Entry {
    openvdb::Coord ijk;
    std::uint32_t index;  ///< of the point
  };
  /// @param points  must live as long
  explicit SurfaceVoxels(const SurfacePoints& points);

  /// Grid with the voxels of all points for which `keep` is true, active, value from `value`; both take a SurfacePoint.
  template <typename GridT, typename Keep, typename Value>
  [[nodiscard]] typename GridT::Ptr grid(const std::string& name, const typename GridT::ValueType& background,
                                         const Keep& keep, const Value& value) const;

  [[nodiscard]] const std::vector<Entry>& entries() const { return entries_; }
  /// Where in entries() each leaf begins, in the order of leaf origins, and the end.
  [[nodiscard]] const std::vector<std::size_t>& leafBegins() const { return leaf_begins_; }

 private:
  const SurfacePoints& points_;
  std::vector<Entry> entries_;            ///< by leaf, then by index; one entry per voxel
  std::vector<std::size_t> leaf_begins_;  ///< first entry of each leaf, and the end
};

template <typename GridT, typename Keep, typename Value>
typename GridT::Ptr SurfaceVoxels::grid(const std::string& name, const typename GridT::ValueType& background,
                                        const Keep& keep, const Value& value) const {
  using LeafT = typename GridT::TreeType::LeafNodeType;
  const std::size_t leaf_count = leaf_begins_.size() - 1;
  std::vector<std::unique_ptr<LeafT>> leaves(leaf_count);
  tbb::parallel_for(std::size_t{0}, leaf_count, [&](std::size_t i) {
    for (std::size_t e = leaf_begins_[i]; e < leaf_begins_[i + 1]; ++e) {
      const SurfacePoint point = points_.at(entries_[e].index);
      if (!keep(point)) continue;
      const openvdb::Coord& ijk = entries_[e].ijk;
      if (!leaves[i]) leaves[i] = std::make_unique<LeafT>(ijk, background, false);
      leaves[i]->setValueOn(LeafT::coordToOffset(ijk), value(point, entries_[e].index));
    }
  });
  auto grid = GridT::create(background);
  for (auto& leaf : leaves) {
    if (leaf) grid->tree().addLeaf(leaf.release());
  }
  grid->setName(name);
  grid->setTransform(fieldTransform(points_.voxel_size_m()));
  return grid;
}

}  // namespace accessvdb::internal

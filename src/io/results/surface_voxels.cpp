// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Surface points sorted by the leaf that contains them.
#include "io/results/surface_voxels.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <cmath>
#include <tuple>

#include "accessvdb/error.h"
#include "io/streams/voxel_rule.h"

namespace accessvdb::internal {
namespace {

// Far inside int32, so that neighbours and leaf origins of any accepted voxel exist too.
constexpr double kMaxVoxelIndex = 1 << 30;
constexpr openvdb::Int32 kLeafMask = ~openvdb::Int32{7};
static_assert(openvdb::FloatTree::LeafNodeType::LOG2DIM == 3);

std::tuple<openvdb::Int32, openvdb::Int32, openvdb::Int32> leafKey(const openvdb::Coord& ijk) {
  return {ijk.x() & kLeafMask, ijk.y() & kLeafMask, ijk.z() & kLeafMask};
}

/// By leaf, then by voxel, then by index. Written out: of tuples it took a third of a query's time.
bool isBefore(const SurfaceVoxels::Entry& a, const SurfaceVoxels::Entry& b) {
  for (int axis = 0; axis < 3; ++axis) {
    const openvdb::Int32 leaf_a = a.ijk[axis] & kLeafMask, leaf_b = b.ijk[axis] & kLeafMask;
    if (leaf_a != leaf_b) return leaf_a < leaf_b;
  }
  for (int axis = 0; axis < 3; ++axis) {
    if (a.ijk[axis] != b.ijk[axis]) return a.ijk[axis] < b.ijk[axis];
  }
  return a.index < b.index;
}

}  // namespace

openvdb::Coord voxelAt(const Eigen::Vector3d& p_L, double voxel_size_m) {
  openvdb::Coord ijk;
  for (int axis = 0; axis < 3; ++axis) {
    const double index = voxelOfCoordinate(p_L[axis], voxel_size_m);
    if (!(std::abs(index) <= kMaxVoxelIndex)) {
      throw InvalidArgument("position.range", "",
                            "position (" + std::to_string(p_L.x()) + ", " + std::to_string(p_L.y()) + ", " +
                                std::to_string(p_L.z()) + ") m from the map's origin has no voxel",
                            "Use finite coordinates in the map's own world frame");
    }
    ijk[axis] = static_cast<openvdb::Int32>(index);
  }
  return ijk;
}

openvdb::math::Transform::Ptr fieldTransform(double voxel_size_m, io::UpAxis up) {
  if (!(voxel_size_m > 0) || !std::isfinite(voxel_size_m)) {
    throw InvalidArgument("field.voxel_size", "", "the field's voxel size is not a positive number",
                          "Set FieldSnapshot::voxel_size_m");
  }
  if (up == io::UpAxis::Z) return openvdb::math::Transform::createLinearTransform(voxel_size_m);
  // Rows are the images of the index axes: x stays, y becomes -z, z becomes y.
  const double v = voxel_size_m;
  return openvdb::math::Transform::createLinearTransform(
      openvdb::Mat4R(v, 0.0, 0.0, 0.0, 0.0, 0.0, -v, 0.0, 0.0, v, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0));
}

openvdb::Vec3f toFileFrame(const Eigen::Vector3f& v_L, io::UpAxis up) {
  // 0.0f - y, so that a zero does not become -0.
  return up == io::UpAxis::Z ? openvdb::Vec3f(v_L.x(), v_L.y(), v_L.z())
                             : openvdb::Vec3f(v_L.x(), v_L.z(), 0.0f - v_L.y());
}

const char* name(io::UpAxis up) { return up == io::UpAxis::Y ? "y" : "z"; }

SurfaceVoxels::SurfaceVoxels(const SurfacePoints& points) : points_(points), entries_(points.size()) {
  static_cast<void>(fieldTransform(points.voxel_size_m()));  // checks the voxel size before anything divides by it
  tbb::parallel_for(std::size_t{0}, entries_.size(), [&](std::size_t i) {
    entries_[i] = {voxelAt(points.position_W(i) - points.origin_W(), points.voxel_size_m()),
                   static_cast<std::uint32_t>(i)};
  });
  tbb::parallel_sort(entries_.begin(), entries_.end(), [](const Entry& a, const Entry& b) { return isBefore(a, b); });
  entries_.erase(
      std::unique(entries_.begin(), entries_.end(), [](const Entry& a, const Entry& b) { return a.ijk == b.ijk; }),
      entries_.end());
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    if (i == 0 || leafKey(entries_[i].ijk) != leafKey(entries_[i - 1].ijk)) leaf_begins_.push_back(i);
  }
  leaf_begins_.push_back(entries_.size());
}

}  // namespace accessvdb::internal

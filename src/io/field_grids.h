// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Converts surface points to voxels of a grid, and writes grids to a .vdb file one after the other.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "accessvdb/field_export.h"
#include "vdb/standard_grids.h"

namespace accessvdb::internal {

/// The voxel whose centre, indexToWorld(ijk), is nearest: floor(x / v + 0.5) on each axis, in double.
/// @param p_L  local frame, metres. @throws InvalidArgument for a position that has no voxel (non-finite, too far)
[[nodiscard]] openvdb::Coord voxelAt(const Eigen::Vector3d& p_L, double voxel_size_m);

/// Linear transform of all our grids: voxel size v, voxel (0,0,0) at the local origin; rotated if y is up.
[[nodiscard]] openvdb::math::Transform::Ptr fieldTransform(double voxel_size_m, io::UpAxis up = io::UpAxis::Z);

/// A vector of the local (z up) frame in the frame of the file: itself, or (x, z, -y).
[[nodiscard]] openvdb::Vec3f toFileFrame(const Eigen::Vector3f& v_L, io::UpAxis up);

/// "z" or "y", as in the metadata.
[[nodiscard]] const char* name(io::UpAxis up);

/// The surface points of a snapshot sorted by leaf, so that grids can be built leaf by leaf on all threads.
/// If two points share a voxel, the one with the lower index is kept.
class SurfaceVoxels {
 public:
  struct Entry {
    openvdb::Coord ijk;
    std::uint32_t index;  ///< the point's index in the snapshot
  };
  explicit SurfaceVoxels(const FieldSnapshot& field);

  /// Grid with the voxels of all points for which `keep` is true, active, value from `value`; both take a SurfacePoint.
  template <typename GridT, typename Keep, typename Value>
  [[nodiscard]] typename GridT::Ptr grid(const std::string& name, const typename GridT::ValueType& background,
                                         const Keep& keep, const Value& value) const;

  [[nodiscard]] const std::vector<Entry>& entries() const { return entries_; }
  /// Where in entries() each leaf begins, in the order of leaf origins, and the end.
  [[nodiscard]] const std::vector<std::size_t>& leafBegins() const { return leaf_begins_; }

 private:
  const FieldSnapshot& field_;
  std::vector<Entry> entries_;            ///< by leaf, then by index; one entry per voxel
  std::vector<std::size_t> leaf_begins_;  ///< first entry of each leaf, and the end
};

/// One grid of a file: its name, and how to make it on demand.
struct LazyGrid {
  std::string name;
  std::function<openvdb::GridBase::Ptr()> make;
};

/// Writes grids one after the other: only one is in memory at a time. With offsets if the stream can seek.
void writeGrids(std::ostream& stream, const std::vector<LazyGrid>& grids, const openvdb::MetaMap& metadata,
                io::Compression compression = io::Compression::Auto);

/// OpenVDB's flags for a compression, given the available codecs. @throws InvalidArgument for a missing one
[[nodiscard]] std::uint32_t compressionFlags(io::Compression compression, bool has_blosc, bool has_zip);
/// The same for the OpenVDB of this process.
[[nodiscard]] std::uint32_t compressionFlags(io::Compression compression);

/// Origin, voxel size, version, up axis and the given pairs; pairs with names already used are skipped.
[[nodiscard]] openvdb::MetaMap fieldMetadata(const FieldSnapshot& field, const io::FieldMetadata& metadata,
                                             const io::WriteOptions& options = {});

/// field.vdb from the points and from the three grids of the volume, each made on demand.
struct VolumeGrids {
  std::function<openvdb::FloatGrid::Ptr()> distance;
  std::function<openvdb::FloatGrid::Ptr()> weight;
  std::function<openvdb::BoolGrid::Ptr()> cleared;
};
void writeFieldGrids(const std::filesystem::path& path, const VolumeGrids& volume, const FieldSnapshot& field,
                     const io::FieldMetadata& metadata, const io::WriteOptions& options = {});

}  // namespace accessvdb::internal

#include "io/surface_voxels_grid.h"

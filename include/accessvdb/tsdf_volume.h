// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The map: an unbounded, sparse OpenVDB volume of truncated signed distances, weights and cleared flags.
///
/// While being authored, all three are one OpenVDB tree (docs/design/map.md, "The authored map"); distance(), weight()
/// and cleared() return ordinary OpenVDB grids. The value of voxel ijk is at indexToWorld(ijk), the voxel is +-v/2
/// around it (OpenVDB's convention). Grids are in the local frame: metres, z up, offset by origin_W from the world's
/// origin.
#pragma once

#include <openvdb/openvdb.h>

#include <Eigen/Core>
#include <cstdint>
#include <memory>

#include "accessvdb/export.h"
#include "accessvdb/params.h"
#include "accessvdb/voxel_state.h"

namespace accessvdb {

namespace internal {
class PackedMap;
}

class ACCESSVDB_API TsdfVolume {
 public:
  /// @param params  resolved parameters. @throws InvalidArgument
  explicit TsdfVolume(const TsdfParams& params);
  ~TsdfVolume();
  TsdfVolume(TsdfVolume&&) noexcept;
  TsdfVolume& operator=(TsdfVolume&&) noexcept;

  [[nodiscard]] const TsdfParams& params() const;
  [[nodiscard]] double voxelSize_m() const;
  [[nodiscard]] double truncationDistance_m() const;

  [[nodiscard]] VoxelState at(const openvdb::Coord& ijk) const;

  /// Copies in the usual types, built in parallel; cost and memory grow with the number of leaves.
  [[nodiscard]] openvdb::FloatGrid::Ptr distance() const;  ///< "distance", metres, background tau, active = observed
  [[nodiscard]] openvdb::FloatGrid::Ptr weight() const;    ///< "weight", observations, background 0, active = observed
  [[nodiscard]] openvdb::BoolGrid::Ptr cleared() const;    ///< "cleared", background false, active = cleared
  /// The same in the core of a tile alone.
  [[nodiscard]] openvdb::FloatGrid::Ptr distance(const FieldWindow& tile) const;
  [[nodiscard]] openvdb::FloatGrid::Ptr weight(const FieldWindow& tile) const;
  [[nodiscard]] openvdb::BoolGrid::Ptr cleared(const FieldWindow& tile) const;

  [[nodiscard]] std::uint64_t leafCount() const;
  [[nodiscard]] std::uint64_t activeVoxelCount() const;  ///< observed voxels
  [[nodiscard]] std::uint64_t memoryBytes() const;
  /// Bounding box of all leaves in voxels (inclusive); empty if the map is empty.
  [[nodiscard]] openvdb::CoordBBox leafBounds() const;

  /// For internal use by the library's stages.
  [[nodiscard]] internal::PackedMap& packed() { return *packed_; }
  [[nodiscard]] const internal::PackedMap& packed() const { return *packed_; }

 private:
  std::unique_ptr<internal::PackedMap> packed_;
};

}  // namespace accessvdb

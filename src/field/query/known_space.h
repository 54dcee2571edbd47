// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the map knows of space, as bits that many rays are cast through.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "tsdf/packed_map.h"
#include "vdb/standard_grids.h"

namespace accessvdb::internal {

/// Least voxels of leaves of which something may be known, in order.
[[nodiscard]] std::vector<openvdb::Coord> knownLeafOrigins(const PackedMap& map);

/// Voxels of one of KnownSpace's leaves that are known to be free.
[[nodiscard]] openvdb::Index freeVoxels(const openvdb::BoolTree::LeafNodeType& leaf);

/// A copy of the map's two facts (leaf_facts.h). Positions are in voxels: voxel i is centred at i + 1/2.
class KnownSpace {
 public:
  /// With the threads of the arena that calls it.
  explicit KnownSpace(const PackedMap& map);

  /// For one thread.
  class Reader {
   public:
    explicit Reader(const KnownSpace& space) : accessor_(space.tree_), surface_(space.surface_) {}

    [[nodiscard]] bool collides(const openvdb::Coord& ijk) const { return accessor_.getValue(ijk); }
    [[nodiscard]] bool isKnown(const openvdb::Coord& ijk) const { return accessor_.isValueOn(ijk); }
    [[nodiscard]] bool isFree(const openvdb::Coord& ijk) const { return isKnown(ijk) && !collides(ijk); }
    /// Whether all voxels that a ball touches are free.
    [[nodiscard]] bool ballIsFree(const Eigen::Vector3d& centre, double radius) const;
    /// Voxels that collide on a way, in three parts of it: up to ends[0], from there up to ends[1], and to ends[2].
    /// @param along  unit  @param ends  ascending  @param most  the walk ends after so many
    [[nodiscard]] std::array<int, 3> collidingOn(const Eigen::Vector3d& from, const Eigen::Vector3d& along,
                                                 const std::array<double, 3>& ends, int most) const;

   private:
    openvdb::tree::ValueAccessor<const openvdb::BoolTree> accessor_, surface_;
  };

  [[nodiscard]] const openvdb::BoolTree& tree() const { return tree_; }

 private:
  openvdb::BoolTree tree_{false};     ///< value: collides; active: known
  openvdb::BoolTree surface_{false};  ///< its leaves in which something collides: most of a ray is in none
};

}  // namespace accessvdb::internal

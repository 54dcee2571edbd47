// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Live NanoVDB mirrors of the map: one of the two facts that scoring needs (value bit = collides, active bit =
/// arm_free), and an optional one of its distances.
///
/// Built once, then patched leaf by leaf; never converted as a whole. Neither the grid nor any node ever moves. A voxel
/// without a leaf reads as the background, inactive: for scoring that is false, tool free and arm blocked.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "hostdev/nanovdb_compat.h"
#include "launch/grid_growth.h"
#include "launch/mirror_arena.h"
#include "mirror/distance_leaves.h"
#include "mirror/occupancy_leaves.h"

namespace accessvdb::internal {

/// What the last call did.
struct MirrorTraffic {
  std::uint64_t leaves_patched = 0;  ///< existing leaves that were changed
  std::uint64_t leaves_added = 0;    ///< or adopted
  std::uint64_t bytes_written = 0;   ///< written to the arena
};

/// One writer, one thread. Readers must be ordered after the call that wrote (see MirrorArena).
/// @tparam Leaves  what the leaves contain and how a change is applied: OccupancyLeaves, DistanceLeaves
template <class Leaves>
class NanoMirror {
 public:
  using Change = typename Leaves::Change;
  using Grid = nanovdb::NanoGrid<typename Leaves::Build>;
  static constexpr std::uint32_t kDefaultRootCapacity = 4096;
  static constexpr std::uint32_t kMaxRootCapacity = 65536;

  /// An empty grid; index space maps to the local frame by the voxel size.
  /// @param arena          nothing committed yet; owned
  /// @param voxel_size_m   finite, > 0
  /// @param root_capacity  maximum number of root tiles of 4096^3 voxels, 1 to kMaxRootCapacity; 32 B each are reserved
  /// @throw InvalidArgument, ResourceLimit
  explicit NanoMirror(std::unique_ptr<kernels::MirrorArena> arena, double voxel_size_m,
                      std::uint32_t root_capacity = kDefaultRootCapacity, Leaves leaves = {});
  ~NanoMirror();
  NanoMirror(const NanoMirror&) = delete;
  NanoMirror& operator=(const NanoMirror&) = delete;

  /// For each LeafChange: collides' = (collides | collides_on) & ~collides_off, arm_free' = (arm_free | arm_free_on) &
  /// ~arm_free_off; a leaf is added when a bit is set in it. For each DistanceChange: observed voxels of its rows
  /// become active with their distance; a leaf is added when it has rows. A leaf may occur more than once, at the cost
  /// of a sort. All or nothing: after a ResourceLimit, no bit has changed and the grid is as readable as before. After
  /// an error of the device it is unknown what was written, and every later call fails.
  /// @throw ResourceLimit  `map.root_tiles`, or the arena cannot grow
  /// @throw InternalError  an origin that is not a multiple of 8; an earlier call failed while writing
  /// @throw DeviceError
  void apply(std::span<const Change> changes);
  /// All lists as one call: one flush of the arena for any number of them.
  void applyLists(std::span<const std::span<const Change>> lists);

  // Nodes that someone else adds, such as a device: it is told the space, room is reserved, it writes them by the rule
  // of launch/grid_growth.h, and adopt() takes them over. apply() may run before and after, but not in between. Bits of
  // leaves that there are may be changed by both at any time, one after the other.

  /// @throw InternalError  an earlier call failed while writing
  [[nodiscard]] kernels::GridSpace space() const;
  /// Backs `more_bytes` behind the first unused byte (growthBytes()) and makes them part of the grid; the space stays
  /// as it is. The writer must be ordered after this call as readers are. After a ResourceLimit nothing has changed.
  /// @throw ResourceLimit  the arena cannot grow
  /// @throw InternalError, DeviceError  as apply()
  void reserve(std::uint64_t more_bytes);
  /// Takes over what was added to space(), one growth at a time and in their order; writes nothing. After an error
  /// every later call fails, because what is in the grid is not what the host knows.
  /// @throw InternalError  `mirror.adopted`: a node that is there already, lacks its parent, is not aligned, or for
  ///   which no room was reserved
  void adopt(const kernels::GridGrowth& growth);

  /// In the arena's address space; constant for the mirror's lifetime.
  [[nodiscard]] const Grid* grid() const noexcept;

  [[nodiscard]] std::uint64_t leafCount() const noexcept;
  [[nodiscard]] std::uint32_t rootTileCount() const noexcept;
  [[nodiscard]] std::uint64_t usedBytes() const noexcept;       ///< arena bytes handed out to nodes
  [[nodiscard]] std::uint64_t committedBytes() const noexcept;  ///< committed by the arena
  [[nodiscard]] std::uint64_t hostBytes() const noexcept;       ///< size of the host's own copy of the topology
  [[nodiscard]] const MirrorTraffic& lastTraffic() const noexcept;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

using NanoVdbMirror = NanoMirror<OccupancyLeaves>;
using DistanceMirror = NanoMirror<DistanceLeaves>;

}  // namespace accessvdb::internal

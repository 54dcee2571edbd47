// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The live NanoVDB mirror of the two facts that scoring needs: value bit = collides, active bit = arm_free.
///
/// Built once, then patched leaf by leaf; never converted as a whole. Neither the grid nor any node ever moves. A voxel
/// without a leaf reads false, inactive: tool free, arm blocked.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "accessvdb/leaf_change.h"
#include "hostdev/nanovdb_compat.h"
#include "launch/mirror_arena.h"

namespace accessvdb::internal {

/// What the last `apply` did.
struct MirrorTraffic {
  std::uint64_t leaves_patched = 0;  ///< leaves that were there and came in a change
  std::uint64_t leaves_added = 0;
  std::uint64_t bytes_written = 0;  ///< to the arena
};

/// One writer, one thread. Readers must be ordered after the call that wrote (see MirrorArena).
class NanoVdbMirror {
 public:
  static constexpr std::uint32_t kDefaultRootCapacity = 4096;
  static constexpr std::uint32_t kMaxRootCapacity = 65536;

  /// An empty grid; index space to local frame is a scale by the voxel size.
  /// @param arena          nothing committed yet; owned
  /// @param voxel_size_m   finite, > 0
  /// @param root_capacity  most root tiles of 4096^3 voxels, 1 to kMaxRootCapacity; 32 B each are reserved
  /// @throw InvalidArgument, ResourceLimit
  explicit NanoVdbMirror(std::unique_ptr<kernels::MirrorArena> arena, double voxel_size_m,
                         std::uint32_t root_capacity = kDefaultRootCapacity);
  ~NanoVdbMirror();
  NanoVdbMirror(const NanoVdbMirror&) = delete;
  NanoVdbMirror& operator=(const NanoVdbMirror&) = delete;

  /// For each change: collides' = (collides | collides_on) & ~collides_off, arm_free' = (arm_free | arm_free_on) &
  /// ~arm_free_off. A leaf is added when bits come on in it. A leaf may come more than once, at the cost of a sort.
  /// All or nothing: after a ResourceLimit no bit has changed and the grid is as readable as before. After an error of
  /// the device it is not known what was written, and every later call fails.
  /// @throw ResourceLimit  `map.root_tiles`, or the arena cannot grow
  /// @throw InternalError  an origin that is no multiple of 8; an earlier call failed while it wrote
  /// @throw DeviceError
  void apply(std::span<const LeafChange> changes);
  /// All parts as one call: one flush of the arena, however many parts.
  void applyParts(std::span<const std::span<const LeafChange>> parts);

  /// In the address space of the arena; constant for life.
  [[nodiscard]] const kernels::OccupancyGrid* grid() const noexcept;

  [[nodiscard]] std::uint64_t leafCount() const noexcept;
  [[nodiscard]] std::uint32_t rootTileCount() const noexcept;
  [[nodiscard]] std::uint64_t usedBytes() const noexcept;       ///< of the arena, handed out to nodes
  [[nodiscard]] std::uint64_t committedBytes() const noexcept;  ///< of the arena
  [[nodiscard]] std::uint64_t hostBytes() const noexcept;       ///< of the host's own copy of the topology
  [[nodiscard]] const MirrorTraffic& lastTraffic() const noexcept;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

namespace accessvdb {

/// Limits a field to one tile of a larger map, with the same results there as in one piece, bit for bit.
///
/// The core is a box in voxels of the local frame, unbounded in z: voxels low <= ijk < high. Points in the core are
/// scored. Returns around it are taken in as far as the core's points depend on them; points outside are not scored.
/// For equal results every tile needs the same FieldParams::origin_W, the scans in the same order and one update() at
/// the end. Scans may be passed whole: returns that are too far away are skipped. What the field hands out and writes
/// are the points of the core, and field.vdb has the map's leaves in the core; volume() also has those around it.
struct FieldWindow {
  std::array<std::int32_t, 2> core_low = {}, core_high = {};  ///< [x, y] multiples of kEdge

  /// Edges of cores are multiples of this many voxels, so a core consists of whole nodes of the map's tree.
  static constexpr std::int32_t kEdge = 128;
};

}  // namespace accessvdb

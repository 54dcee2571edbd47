// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Returns that are left out because the map may not grow: which they are, and what blocks in their place
/// (docs/design/left_out.md, "What is left out blocks").
#pragma once

#include <span>

#include "accessvdb/types.h"
#include "change/gone_cells.h"
#include "field/left_out_points.h"
#include "field/mirrors.h"
#include "field/scan_gate.h"
#include "points/point_store.h"
#include "tsdf/packed_map.h"

namespace accessvdb::internal {

class StateReader;

class LeftOutReturns {
 public:
  /// All of them must outlive this.
  LeftOutReturns(PackedMap& map, const PointStore& points, const ScanGate& gate, LeftOutPoints& left_out)
      : map_(map), points_(points), gate_(gate), left_out_(left_out) {}

  /// The returns of a scan for which the map has a place: what can become points. Valid until the next call.
  [[nodiscard]] const GatedScan& placed(const GatedScan& scan, FrameStats& stats);
  /// @param leaves  in which more was left out
  void note(std::span<const openvdb::Coord> leaves);
  /// What has gone is judged by the returns around, and where some are missing, a ray that opens a voxel may be wrong.
  /// So before the map opens such voxels, they are left out: they collided, and go on to do so.
  void keepShut(std::span<const OpenedLeaf> opened);
  /// Only for a new field, whose map and mirrors are restored.
  void restore(StateReader& state, Mirrors& mirrors);

 private:
  PackedMap& map_;
  const PointStore& points_;
  const ScanGate& gate_;
  LeftOutPoints& left_out_;
  GatedScan placed_;  ///< kept so that memory is reused
};

}  // namespace accessvdb::internal

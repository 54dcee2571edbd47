// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which points would open if some voxels went (docs/design/change.md, "By hand"): their bits are switched in the
/// mirror, the blocked points that read them are tried again, and the bits are switched back.
#pragma once

#include <memory>
#include <optional>
#include <span>

#include "accessvdb/what_if.h"
#include "field/tools/scoring_setup.h"
#include "mirror/nanovdb_mirror.h"
#include "tsdf/removed_voxels.h"
#include "update/cell_directions.h"
#include "update/leaf_footprint.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

/// What does not change from call to call.
struct WhatIfTables {
  explicit WhatIfTables(const ScoringSetup& setup, double voxel_size_m);
  LeafFootprint footprint;
  CellDirections cells;
};

/// The parts of a field that are read, and the mirror, which is as it was afterwards.
struct WhatIfInputs {
  const PackedMap& map;
  const PointScorer& scorer;
  const ScoringSetup& setup;
  const WhatIfTables& tables;
  NanoVdbMirror& mirror;
  Eigen::Vector3d origin_W;
  std::span<const std::uint8_t> withheld;  ///< points that stay unscored are not 0 (LeftOutPoints); by id
};

/// @param voxels  observed
/// @throws whatever the mirror or the backend throws; then the mirror may lack obstacles, and must not be used again
[[nodiscard]] WhatIf openedWithout(const WhatIfInputs& parts, const VoxelSet& voxels);

}  // namespace accessvdb::internal

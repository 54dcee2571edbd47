// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Parts of a map taken out by hand, and what would open without them.
#pragma once

#include "accessvdb/region.h"
#include "accessvdb/what_if.h"
#include "field/field_stages.h"
#include "field/regions/region_voxels.h"

namespace accessvdb::internal {

/// @throws InvalidArgument "region.unsupported"
void requireRegions(const FieldStages& field);
/// @throws InvalidArgument "region.tools", "region.stale", and as requireRegions()
void requireCurrentLabels(FieldStages& field);

/// @throws as requireRegions()
[[nodiscard]] VoxelSet voxelsIn(const FieldStages& field, const Region& region);
Removal removeRegion(FieldStages& field, const Region& region, RemovedAs as);

/// Switches bits of the mirror for a moment: a step, because one that fails half-way leaves obstacles out.
[[nodiscard]] WhatIf whatIf(FieldStages& field, const VoxelSet& voxels);
[[nodiscard]] const WhatIfTables& whatIfTables(FieldStages& field);

}  // namespace accessvdb::internal

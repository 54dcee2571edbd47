// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Parts of a map taken out by hand, and what would open without them.
#pragma once

#include "accessvdb/region.h"
#include "accessvdb/what_if.h"
#include "field/field_parts.h"
#include "field/regions/region_voxels.h"

namespace accessvdb::internal {

/// @throws InvalidArgument "region.unsupported"
void requireRegions(const FieldParts& field);
/// @throws InvalidArgument "region.tools", "region.stale", and as requireRegions()
void requireCurrentLabels(FieldParts& field);

/// @throws as requireRegions()
[[nodiscard]] VoxelSet voxelsIn(const FieldParts& field, const Region& region);
Removal removeRegion(FieldParts& field, const Region& region, RemovedAs as);

/// Switches bits of the mirror for a moment: a step, because one that fails half-way leaves obstacles out.
[[nodiscard]] WhatIf whatIf(FieldParts& field, const VoxelSet& voxels);
[[nodiscard]] const WhatIfTables& whatIfTables(FieldParts& field);

}  // namespace accessvdb::internal

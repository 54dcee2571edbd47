// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A level set of the surface for users who want a mesh: signed distances to oriented points.
#pragma once

#include "io/results/surface_voxels.h"

namespace accessvdb::internal {

/// Narrow-band signed distance, metres, to the surface that the points and their normals describe (implicit moving
/// least squares: Kolluri, "Provably good moving least squares", 2008): the mean of the distances to the tangent planes
/// of the points around, weighted by nearness. Positive on the side that the normals point to, which is the side that
/// the sensor saw. Band: 3 voxels to each side, background 3 voxels. Holes up to 4 voxels wide are bridged.
///
/// Space beyond the band is inside if the band encloses it facing away (a solid seen from all around), else outside.
/// So a surface seen from only one side becomes a slab, 3 voxels thick, whose back is not a measurement. Points without
/// a normal are skipped. Same bytes for any number of threads.
[[nodiscard]] openvdb::FloatGrid::Ptr surfaceLevelSet(const SurfacePoints& points, const SurfaceVoxels& surface);

}  // namespace accessvdb::internal

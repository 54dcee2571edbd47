// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What goes into fusing a scan besides its returns, and what comes out.
#pragma once

#include <openvdb/Types.h>

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "accessvdb/distance_change.h"
#include "accessvdb/leaf_change.h"
#include "tsdf/leaf_kernels.h"

namespace accessvdb::internal {

/// What one scan did to the map.
struct IntegrationResult {
  std::uint64_t touched_leaves = 0;
  std::uint64_t new_leaves = 0;
  std::uint64_t contradicted_platforms = 0;  ///< PlatformBalls::contradicted
  FoldCounts counts;
  std::uint64_t flips_hash = 0;  ///< of `changes` (hostdev/flips_hash.h); 0 unless requested (hashFlips)
  /// Leaves with flipped facts, each at most once; in the integrator's memory, valid until the next integrate().
  std::vector<std::span<const LeafChange>> changes;
  /// Leaves with changed distances, likewise; empty unless requested (ScanIntegrator::noteDistances).
  std::vector<std::span<const DistanceChange>> distances;
  /// Lowest voxels of the leaves in which more was left out than before; only in a map that no longer grows.
  std::vector<openvdb::Coord> left_out;
};

/// The sensor's pose during a scan; only the projective baseline uses it.
struct ScanFrame {
  Eigen::Matrix3d R_W_S = Eigen::Matrix3d::Identity();  ///< rotation, sensor to world (and to the local frame)
  Eigen::Vector3d origin_W = {0, 0, 0};                 ///< origin of the local frame, metres
};

}  // namespace accessvdb::internal

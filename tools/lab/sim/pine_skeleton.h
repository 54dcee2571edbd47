// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The axes and thicknesses of a Pinus radiata, before any triangle.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "sim/pine_params.h"

namespace accessvdb::sim {

/// The convex hull of two spheres; a_W is the end nearer to the root.
struct RoundCone {
  Eigen::Vector3d a_W, b_W;
  double radius_a_m, radius_b_m;
};

/// By order of branching. Parts overlap where they join.
struct PineSkeleton {
  std::vector<RoundCone> trunk;     ///< from the ground up, one per internode
  std::vector<RoundCone> branches;  ///< first order, in whorls around the trunk; several per branch
  std::vector<RoundCone> twigs;     ///< second order, on the branches
  std::vector<RoundCone> shoots;    ///< third order, on the twigs and at the ends of everything
  std::vector<RoundCone> needles;   ///< bundles, on shoots and on the outer part of twigs
  int whorls = 0;
  int branch_count = 0;
  double trunk_diameter_m = 0;  ///< at 1.3 m
};

/// The same seed gives the same bytes. @throws InvalidArgument unless 2 m <= height <= 60 m
[[nodiscard]] PineSkeleton growPine(const PineParams& params);

}  // namespace accessvdb::sim

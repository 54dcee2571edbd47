// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Independent oracle: docs/PAPER_MAP.md, "Integration" and "Ray-cleared band", as plain loops in double over every
/// voxel of the cube, both profiles. Lengths in voxels inside. Records how close each decision was.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <limits>
#include <map>
#include <span>
#include <vector>

#include "accessvdb/params.h"

namespace accessvdb::test {

struct LoopVoxel {
  double sum_m = 0;
  std::uint64_t count = 0;
  bool cleared = false;
  double update_margin = std::numeric_limits<double>::infinity();   ///< voxels, smallest over all returns
  double cleared_margin = std::numeric_limits<double>::infinity();  ///< same, over returns whose choice could matter
};

class LoopTsdf {
 public:
  explicit LoopTsdf(const TsdfParams& params) : params_(params) {}
  void integrate(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L);

  std::map<std::array<std::int32_t, 3>, LoopVoxel> voxels;
  std::uint64_t updates = 0;

 private:
  void integrateReturn(const Eigen::Vector3d& p, const Eigen::Vector3d& q);
  TsdfParams params_;
};

/// Returns on a wavy sheet around the origin (all octants), seen from a few metres: [n] in metres.
std::vector<Eigen::Vector3f> wavySheet(std::size_t n, double voxel_size_m, unsigned seed);

}  // namespace accessvdb::test

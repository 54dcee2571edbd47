// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "live/lost_returns.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace accessvdb::internal {

void LostReturns::add(const Eigen::Vector3d& p_W, double spread_m) {
  constexpr double kFarthest = 0x1p52;
  const Eigen::Vector3d cube = (p_W / edge_m_).array().floor();
  if (!(cube.lpNorm<Eigen::Infinity>() < kFarthest)) return;
  spread_m_ = std::max(spread_m_, spread_m);
  cubes_.insert(
      {static_cast<std::int64_t>(cube.x()), static_cast<std::int64_t>(cube.y()), static_cast<std::int64_t>(cube.z())});
  while (cubes_.size() > kMostCubes) {
    const std::set<Cube> small = std::exchange(cubes_, {});
    edge_m_ *= 2;
    for (const Cube& of : small) cubes_.insert({of[0] >> 1, of[1] >> 1, of[2] >> 1});
  }
}

std::vector<Eigen::Vector3d> LostReturns::centres_W() const {
  std::vector<Eigen::Vector3d> centres;
  for (const Cube& cube : cubes_) {
    const Eigen::Vector3d corner(static_cast<double>(cube[0]), static_cast<double>(cube[1]),
                                 static_cast<double>(cube[2]));
    centres.emplace_back(edge_m_ * (corner.array() + 0.5).matrix());
  }
  return centres;
}

}  // namespace accessvdb::internal

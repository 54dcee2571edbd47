// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Random numbers and parameters of the point tests.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "accessvdb/params.h"
#include "launch/direction_table.h"

namespace accessvdb::test {

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  double uniform(double low, double high) {
    return low + (high - low) * static_cast<double>(engine_() >> 11) * 0x1.0p-53;
  }
  std::int32_t below(std::int32_t n) { return static_cast<std::int32_t>(engine_() % static_cast<std::uint64_t>(n)); }
  std::int32_t between(std::int32_t low, std::int32_t high) { return low + below(high - low + 1); }
  std::uint64_t bits() { return engine_(); }
  Eigen::Vector3f point(double half) {
    return {static_cast<float>(uniform(-half, half)), static_cast<float>(uniform(-half, half)),
            static_cast<float>(uniform(-half, half))};
  }
  std::mt19937_64& engine() { return engine_; }

 private:
  std::mt19937_64 engine_;
};

/// The parameters of the point stages, with every rule already applied.
inline FieldParams pointParams(double voxel_size_m, int num_directions = 36, int neighbours = 10) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_size_m;
  params.tsdf.truncation_distance_m = 4 * voxel_size_m;
  params.approach.num_directions = num_directions;
  params.scoring.neighbours = neighbours;
  return params;
}

inline kernels::DirectionTable directionTable(int num_directions) {
  kernels::DirectionTable table;
  for (int d = 0; d < num_directions; ++d) {
    table.xy.push_back(static_cast<float>(std::cos(2 * std::numbers::pi * d / num_directions)));
    table.xy.push_back(static_cast<float>(std::sin(2 * std::numbers::pi * d / num_directions)));
  }
  return table;
}

}  // namespace accessvdb::test

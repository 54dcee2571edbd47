// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A return near a leaf, at random.
#pragma once

#include <cmath>
#include <cstddef>
#include <random>

#include "tsdf/leaf_kernels.h"

namespace accessvdb::internal {

inline float uniform(std::mt19937& random, float low, float high) {
  return low + (high - low) * static_cast<float>(random() % 65536) / 65536.0f;
}

inline ReturnInLeaf randomReturn(std::mt19937& random) {
  ReturnInLeaf ray;
  float norm = 0;
  for (std::size_t a = 0; a < 3; ++a) {
    ray.leaf[a] = std::floor(uniform(random, -14, 7));
    ray.offset[a] = uniform(random, -0.5f, 0.5f);
    ray.to_sensor[a] = uniform(random, -1, 1);
    norm += ray.to_sensor[a] * ray.to_sensor[a];
  }
  for (float& u : ray.to_sensor) u /= std::sqrt(norm);
  ray.range = uniform(random, 3, 900);
  ray.box_x = {uniform(random, -30, -2), uniform(random, 2, 30)};
  return ray;
}

}  // namespace accessvdb::internal

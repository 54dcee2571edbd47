// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The stream on which both backends are compared.
#pragma once

#include "support/walk_generator.h"

namespace accessvdb::test {

inline WalkOptions parityWalk(std::uint64_t seed, int frames, int rays_per_frame) {
  WalkOptions options = shortWalk(frames, rays_per_frame);
  options.seed = seed;
  options.offset_W = {-3, 2, 0};  // both signs of every coordinate
  return options;
}

}  // namespace accessvdb::test

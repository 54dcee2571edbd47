// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Small random worlds, tools and parameters, the same for the same seed: the inputs of parity tests.
#pragma once

#include <cstdint>
#include <random>
#include <vector>

#include "accessvdb/params.h"
#include "accessvdb/tool_geometry.h"
#include "parity/scoring_reference.h"

namespace accessvdb::test {

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  double uniform(double low, double high) {
    return low + (high - low) * static_cast<double>(engine_() >> 11) * 0x1.0p-53;
  }
  int below(int n) { return static_cast<int>(engine_() % static_cast<std::uint64_t>(n)); }

 private:
  std::mt19937_64 engine_;
};

/// A box with its tip somewhere near the origin, a few voxels thick and up to 14 long.
[[nodiscard]] ToolGeometry boxTool(Random& random, double voxel_size_m);

/// A world of a few dozen voxels: clutter, or a rough wall with clutter in front of it, anywhere around the origin.
[[nodiscard]] std::vector<RayScan> randomScans(Random& random, double v);

[[nodiscard]] FieldParams randomParams(Random& random);
/// A set of orientations that is not yaw, yaw directions to go with it, and often rolls.
void chooseOrientations(Random& random, ApproachParams& approach);

[[nodiscard]] ToolGeometry randomTool(Random& random, double v);

}  // namespace accessvdb::test

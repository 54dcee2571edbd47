// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which Pinus radiata.
#pragma once

#include <cstdint>

namespace accessvdb::sim {

/// Every number and its source: docs/PAPER.md, "The pine".
struct PineParams {
  double height_m = 12.0;
  std::uint64_t seed = 1;
};

}  // namespace accessvdb::sim

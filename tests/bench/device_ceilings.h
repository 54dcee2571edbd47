// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a device does in a second of what the stages on it are made of, and of nothing else.
#pragma once

#include <string>
#include <vector>

namespace accessvdb {

/// Seconds of each repeat, and how much was done in each.
struct Rate {
  std::string name, unit;
  double amount = 0;
  std::vector<double> seconds;
};

/// @throws Error where there is no device
std::vector<Rate> deviceCeilings(int repeats);

}  // namespace accessvdb

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The rates that a device reaches for the operations that its stages consist of.
#pragma once

#include <string>
#include <vector>

namespace accessvdb {

/// Seconds per repeat, and the amount of work in each.
struct Rate {
  std::string name, unit;
  double amount = 0;
  std::vector<double> seconds;
};

/// @throws Error if there is no device
std::vector<Rate> deviceCeilings(int repeats);

}  // namespace accessvdb

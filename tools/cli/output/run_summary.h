// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A few readable lines on what a run of `map` found.
#pragma once

#include <string>
#include <vector>

#include "runs/plausibility.h"

namespace accessvdb::tools {

/// "no_return 28.0 %, non_finite 0.1 %", shares of the returns; or "none dropped"
[[nodiscard]] std::string droppedInWords(const RunReport& report);

[[nodiscard]] std::vector<std::string> summarizeRun(const RunFacts& facts);

}  // namespace accessvdb::tools

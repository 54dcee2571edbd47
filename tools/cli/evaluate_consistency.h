// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb evaluate --consistency: recorded scans, for which there is no ground truth.
#pragma once

#include "verbs.h"

namespace accessvdb::tools {

/// Whether the arguments of `evaluate` request it.
[[nodiscard]] bool wantsConsistency(const Arguments& arguments);

/// Maps half of the scans, the other half and all, and writes consistency.json and consistency.md into --out.
/// @return the exit code: 0, or 130/143 if a signal stopped the run
int runConsistency(const Arguments& arguments, Messages& messages);

}  // namespace accessvdb::tools

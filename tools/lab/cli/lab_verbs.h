// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The verbs of the lab, one file each.
#pragma once

#include <string>

#include "output/program.h"

namespace accessvdb::tools {

inline constexpr const char* kLab = "accessvdb-lab";

int runSimulate(const Arguments& arguments, Messages& messages);
int runEvaluate(const Arguments& arguments, Messages& messages);
/// evaluate --pseudo-truth, which has flags of its own.
[[nodiscard]] bool wantsPseudoTruth(const Arguments& arguments);
int runPseudoTruth(const Arguments& arguments, Messages& messages);
int runBench(const Arguments& arguments, Messages& messages);

/// The command as it was given, for the files that it writes.
[[nodiscard]] std::string labCommandLine(const std::string& verb, const Arguments& arguments);

}  // namespace accessvdb::tools

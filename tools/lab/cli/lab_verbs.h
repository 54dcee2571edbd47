// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The verbs of the lab, one file each.
#pragma once

#include "output/program.h"

namespace accessvdb::tools {

inline constexpr const char* kLab = "accessvdb-lab";

int runSimulate(const Arguments& arguments, Messages& messages);
int runEvaluate(const Arguments& arguments, Messages& messages);
int runBench(const Arguments& arguments, Messages& messages);

}  // namespace accessvdb::tools

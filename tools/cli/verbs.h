// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The verbs of the program, one file each. Arguments are those after the verb; errors leave as exceptions.
#pragma once

#include <string>
#include <vector>

#include "error_output.h"

namespace accessvdb::tools {

using Arguments = std::vector<std::string>;

/// @return the exit code: 0, or 130/143 if a signal stopped the run
int runMap(const Arguments& arguments, Messages& messages);
int runAdvise(const Arguments& arguments, Messages& messages);
int runLive(const Arguments& arguments, Messages& messages);
int runEvaluate(const Arguments& arguments, Messages& messages);
int runSimulate(const Arguments& arguments, Messages& messages);
int runBench(const Arguments& arguments, Messages& messages);
int runInfo(const Arguments& arguments, Messages& messages);
int runQuery(const Arguments& arguments, Messages& messages);
int runTile(const Arguments& arguments, Messages& messages);
int runRender(const Arguments& arguments, Messages& messages);
int runDiff(const Arguments& arguments, Messages& messages);
int runWhatIf(const Arguments& arguments, Messages& messages);
int runReport(const Arguments& arguments, Messages& messages);

}  // namespace accessvdb::tools

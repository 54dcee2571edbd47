// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The verbs of accessvdb, one file each.
#pragma once

#include "output/program.h"

namespace accessvdb::tools {

int runMap(const Arguments& arguments, Messages& messages);
int runAdvise(const Arguments& arguments, Messages& messages);
int runLive(const Arguments& arguments, Messages& messages);
int runConsistency(const Arguments& arguments, Messages& messages);
int runInfo(const Arguments& arguments, Messages& messages);
int runQuery(const Arguments& arguments, Messages& messages);
int runTile(const Arguments& arguments, Messages& messages);
int runRender(const Arguments& arguments, Messages& messages);
int runDiff(const Arguments& arguments, Messages& messages);
int runApproaches(const Arguments& arguments, Messages& messages);
int runViews(const Arguments& arguments, Messages& messages);
int runWhatIf(const Arguments& arguments, Messages& messages);
int runExport(const Arguments& arguments, Messages& messages);
int runReport(const Arguments& arguments, Messages& messages);

/// The old spelling of runConsistency, `accessvdb evaluate --consistency`, and whether arguments have it.
int runEvaluateConsistency(const Arguments& arguments, Messages& messages);
[[nodiscard]] bool wantsConsistency(const Arguments& arguments);

}  // namespace accessvdb::tools

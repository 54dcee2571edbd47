// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// `map --rolling`: scan after scan in bounded memory, while tiles that the sensor has left wait in a folder.
#pragma once

#include <vector>

#include "accessvdb/scan_io.h"
#include "output/error_output.h"
#include "output/report.h"
#include "runs/tile_job.h"

namespace accessvdb::tools {

/// @throws InvalidArgument "usage.rolling"
void requireRollingPossible(const MapOptions& options, const FieldParams& params);

/// Maps into the folder of --rolling, and writes the result into that of --out, as tiles. Stopped by a signal, it
/// leaves a checkpoint in the folder of --rolling, and no result.
/// @param poses  files of poses, with their hashes  @param report  in: what was read already
/// @return 0, or 128 + the signal that stopped it
int mapRolling(const PlanSources& sources, const std::vector<io::InputFile>& poses, RunReport& report,
               Messages& messages);

}  // namespace accessvdb::tools

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Times of scans, by which free space ages.
#pragma once

#include "accessvdb/params.h"
#include "accessvdb/scan_io.h"
#include "options/map_options.h"
#include "output/error_output.h"

namespace accessvdb::tools {

/// Free space ages by the scans' times alone; warns where they are odd. @throws UnusableInput "stamp.missing"
void requireStamps(const MapOptions& options, const FieldParams& params, const io::ScanSequence& scans,
                   Messages& messages);

}  // namespace accessvdb::tools

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The sample-scan generator under the name that tests use.
#pragma once

#include "sample_scans/scan_folder.h"
#include "sample_scans/walk_generator.h"

namespace accessvdb::test {

using samples::AnalyticScene;
using samples::ScanNames;
using samples::WalkFrame;
using samples::WalkGenerator;
using samples::WalkOptions;
using samples::writeScanFolder;

}  // namespace accessvdb::test

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which of the options for reading scans go together.
#pragma once

#include "accessvdb/scan_io.h"
#include "io/scans/scan_files.h"

namespace accessvdb::io {

/// @throws InvalidArgument
void checkOptions(const ScanInputOptions& options);
/// What is for one kind of scans only. @throws InvalidArgument
void checkKind(const ScanInputOptions& options, const ScanFileList& scans);

}  // namespace accessvdb::io

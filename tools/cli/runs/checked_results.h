// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Verbs that read results hold them against the hashes that were written with them.
#pragma once

#include "accessvdb/output_check.h"
#include "options/flag_parser.h"
#include "output/error_output.h"

namespace accessvdb::tools {

/// Adds --allow-changed.
void addAllowChanged(FlagParser& flags, bool& allow_changed);
/// What a check found that does not end the run.
void sayFindings(const io::OutputCheck& check, Messages& messages);

}  // namespace accessvdb::tools

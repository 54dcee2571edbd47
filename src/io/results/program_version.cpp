// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/results/program_version.h"

#include "accessvdb/config.h"

namespace accessvdb::internal {

std::string programVersion() { return ACCESSVDB_VERSION; }

}  // namespace accessvdb::internal

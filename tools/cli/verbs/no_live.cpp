// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb live in a program that was built without a middleware.
#include "accessvdb/error.h"
#include "verbs/verbs.h"

namespace accessvdb::tools {

int runLive(const Arguments&, Messages&) {
  throw InvalidArgument("usage.no_dds", "live", "this program was built without Fast DDS",
                        "Build it with ACCESSVDB_DDS=ON, or use accessvdb/live_session.h from your own program");
}

}  // namespace accessvdb::tools

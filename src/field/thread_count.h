// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How many threads a field may be given.
#pragma once

namespace accessvdb::internal {

/// @param threads  0 = all  @return threads  @throws InvalidArgument "config.range", before TBB is asked
int requireThreads(int threads);

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How many threads a field is given.
#pragma once

#include <tbb/task_arena.h>

namespace accessvdb::internal {

/// @param threads  0 = all  @return threads  @throws InvalidArgument "config.range", before TBB is asked
int requireThreads(int threads);

inline tbb::task_arena makeArena(int threads) {  ///< @param threads  0 = all
  return tbb::task_arena(threads > 0 ? threads : static_cast<int>(tbb::task_arena::automatic));
}

}  // namespace accessvdb::internal

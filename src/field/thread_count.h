// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How many threads a field is given.
#pragma once

#include <tbb/task_arena.h>

namespace accessvdb::internal {

/// @param threads  0 = all  @return threads  @throws InvalidArgument "config.range", before TBB is asked
int requireThreads(int threads);

/// @param threads  0 = all  @param priority  low: workers come when others need none, and leave between two tasks
inline tbb::task_arena makeArena(int threads, tbb::task_arena::priority priority = tbb::task_arena::priority::normal) {
  return tbb::task_arena(threads > 0 ? threads : static_cast<int>(tbb::task_arena::automatic), 1, priority);
}

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Votes of the leaves that have any.
#pragma once

#include "tsdf/new_things.h"
#include "tsdf/record_pool.h"

namespace accessvdb::internal {

using VotePool = RecordPool<VoxelVotes>;

}  // namespace accessvdb::internal

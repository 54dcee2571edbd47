// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which names columns of carried attributes may have.
#pragma once

#include <vector>

#include "accessvdb/attributes.h"

namespace accessvdb::internal {

/// @throws InvalidArgument "carry.name", "carry.count"
void requireCarry(const std::vector<CarriedAttribute>& carry);

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What all queries demand of their callers.
#pragma once

#include <cstddef>
#include <string>

#include "accessvdb/error.h"

namespace accessvdb::internal {

/// @throws InvalidArgument "query.sizes"
inline void requireSizes(std::size_t questions, std::size_t answers) {
  if (questions == answers) return;
  throw InvalidArgument("query.sizes", "",
                        std::to_string(questions) + " questions and room for " + std::to_string(answers) + " answers",
                        "Pass arrays of the same length");
}

}  // namespace accessvdb::internal

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

/// @param made_by  the field's function that gives out such queries  @throws InvalidArgument "query.stale"
inline void requireCurrent(bool is_current, const std::string& made_by) {
  if (is_current) return;
  throw InvalidArgument("query.stale", "", "the field has changed since this query was made",
                        "Take a new one from " + made_by + "() after each integrateScan() and update()");
}

}  // namespace accessvdb::internal

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// GPS time and class of first returns, which points.las has where the scans are LAS.
#pragma once

#include "accessvdb/params.h"
#include "accessvdb/survey_frame.h"

namespace accessvdb::tools {

/// Adds them to what a field of these scans carries, as its last columns.
inline void addFirstReturns(const SurveyFrame& frame, FieldParams& params) {
  if (!frame.first_returns) return;
  for (const char* name : kFirstReturnNames) params.carry.push_back({name, Keep::First});
}

}  // namespace accessvdb::tools

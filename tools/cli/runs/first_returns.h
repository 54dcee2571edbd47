// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// GPS time and class of first returns, which points.las has where the scans are LAS.
#pragma once

#include <algorithm>
#include <iterator>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/attributes.h"
#include "accessvdb/scan_io.h"

namespace accessvdb::tools {

/// Adds them to what a field of these scans carries.
inline void addFirstReturns(const SurveyFrame& frame, FieldParams& params) {
  if (!frame.first_returns) return;
  for (const char* name : kFirstReturnNames) params.carry.push_back({name, Keep::First});
}

/// What the returns of a record carry, as many columns as the field has: one that goes on from a checkpoint has those
/// of the run that left it. First returns are the last columns.
inline std::vector<std::int32_t> attributesFor(const FieldParams& params, const io::ScanRecord& record) {
  const std::size_t points = record.points_W.empty() ? record.points_S.size() : record.points_W.size();
  const std::size_t width = params.carry.size(), has = points == 0 ? width : record.attributes.size() / points;
  if (has == width) return record.attributes;
  std::vector<std::int32_t> fitted(points * width, kNoAttribute);
  for (std::size_t n = 0; n < points; ++n) {
    std::copy_n(record.attributes.begin() + static_cast<std::ptrdiff_t>(n * has), std::min(has, width),
                fitted.begin() + static_cast<std::ptrdiff_t>(n * width));
  }
  return fitted;
}

}  // namespace accessvdb::tools

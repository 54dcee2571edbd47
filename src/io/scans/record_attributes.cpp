// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "accessvdb/attributes.h"
#include "accessvdb/scan_io.h"

namespace accessvdb::io {

std::vector<std::int32_t> attributesFor(const ScanRecord& record, std::size_t columns) {
  const std::size_t points = record.points_W.empty() ? record.points_S.size() : record.points_W.size();
  const std::size_t has = points == 0 ? columns : record.attributes.size() / points;
  if (has == columns) return record.attributes;
  std::vector<std::int32_t> fitted(points * columns, kNoAttribute);
  for (std::size_t n = 0; n < points; ++n) {
    std::copy_n(record.attributes.begin() + static_cast<std::ptrdiff_t>(n * has), std::min(has, columns),
                fitted.begin() + static_cast<std::ptrdiff_t>(n * columns));
  }
  return fitted;
}

}  // namespace accessvdb::io

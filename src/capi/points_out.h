// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Surface points into a caller's array.
#pragma once

#include <cstddef>
#include <vector>

#include "accessvdb/c_api.h"
#include "accessvdb/types.h"

namespace accessvdb::capi {

struct PointRange {
  std::size_t first, count;
};
/// @param points  [range.count], each of the caller's version  @throws InvalidArgument "snapshot.range"
void copyPoints(const std::vector<SurfacePoint>& all, const PointRange& range, accessvdb_point* points,
                std::size_t point_size);

}  // namespace accessvdb::capi

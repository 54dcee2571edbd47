// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Surface points into a caller's array.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/c_api.h"
#include "accessvdb/types.h"

namespace accessvdb::capi {

inline constexpr std::size_t kPointBytes1 = 80;  ///< size of the first version of accessvdb_point

/// Writes a point of the caller's version.
void writePoint(void* out, std::size_t size, const SurfacePoint& point);

struct PointRange {
  std::size_t first, count;
};
/// @param points  [range.count], each of the caller's version  @throws InvalidArgument "snapshot.range"
void copyPoints(const std::vector<SurfacePoint>& all, const PointRange& range, accessvdb_point* points,
                std::size_t point_size);

/// @param by  the function that takes one, for the message  @throws InvalidArgument "snapshot.none"
[[nodiscard]] const FieldSnapshot& takenSnapshot(const std::optional<FieldSnapshot>& snapshot, const char* by);

}  // namespace accessvdb::capi

// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Units of coordinate systems of which a file gives only the number, as EPSG 10.076 (2022) has them.
#pragma once

namespace accessvdb::io {

inline constexpr int kEpsgMetre = 9001, kEpsgFoot = 9002, kEpsgSurveyFoot = 9003;

/// @return EPSG's code of the unit; 0 for a number that is not known
[[nodiscard]] int epsgUnitOfProjection(int code);
[[nodiscard]] int epsgUnitOfHeights(int code);

}  // namespace accessvdb::io
